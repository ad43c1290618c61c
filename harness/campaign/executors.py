"""Who measures tasks: `submit(task)` gives its rows. Here, one after the other; others may send tasks elsewhere."""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Iterator
from typing import Any, Protocol

from harness.device.machine import environment_description, machine_description
from harness.errors import DefrayError
from harness.measure.scene import Scenes
from harness.records.schema import Machine
from harness.studies.study import Step, Task, Tell


class TaskFailed(Exception):
    """An error that struck one part of a task, by its id, or the whole task where `part` is None; can be pickled.

    `message`: one line for people. `traceback`: None of an error that is no fault of the program.
    """

    def __init__(self, message: str, part: str | None = None, traceback: str | None = None):
        super().__init__(message, part, traceback)
        self.message, self.part, self.traceback = message, part, traceback


class Executor(Protocol):
    """Carries out tasks; tasks and rows can be pickled, so that it may be another process or machine.

    `machine`: where rows are measured, as records describe it; rows of another device do not stand for its.
    """

    machine: Machine

    def environment(self) -> dict:
        """All that is known of the machine, for `env.json`."""

    def submit(self, task: Task, tell: Tell = lambda _: None) -> Iterable[Any]:
        """The rows of a task, as they come, whole; raises TaskFailed. `tell` may be called with its progress."""


class Local:
    """Measures here, on one device; the scene of the last task is kept for the next."""

    def __init__(self, device):
        self.device = device
        self.scenes = Scenes(device)
        self.machine = machine_description(device)

    def environment(self) -> dict:
        """All that is known of this machine."""
        return environment_description(self.device)

    def submit(self, task: Task, tell: Tell = lambda _: None) -> Iterator[Any]:
        """The rows of a task, measured as they are asked for."""
        running = None

        def note(step: Step) -> None:
            nonlocal running
            running = step.part
            tell(step)

        try:
            yield from task.study.measure(task, self.scenes, note)
        except Exception as error:  # a fault in one part must not cost the others theirs
            known = isinstance(error, DefrayError)
            text = None if known else "".join(traceback.format_exception(error))
            raise TaskFailed(one_line(error), running, text) from error


def one_line(error: Exception) -> str:
    """What went wrong, for people."""
    if isinstance(error, DefrayError):
        return str(error)
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]
