"""Tasks of a study carried out: what is on file is skipped, each row stored at once, failures kept apart.

A folder holds the files of its studies, and `errors.jsonl` with the parts that could not be measured.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from harness.campaign.executors import Executor, TaskFailed
from harness.campaign.folder import ERRORS, drop_errors, locked, store_error
from harness.campaign.progress import Display
from harness.errors import DefrayError
from harness.inputs.memory import announcements
from harness.inputs.scenes_by_name import expected_triangles, load_scene
from harness.studies.study import Part, Rows, Study, Task

INTERRUPTED, TERMINATED = 130, 143


class Terminated(KeyboardInterrupt):
    """SIGTERM arrived; as after Ctrl-C, nothing on the way mistakes it for a failure."""


@contextmanager
def terminable() -> Iterator[None]:
    """Let SIGTERM stop what runs in order, as Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_) -> None:
        raise Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def code_of(stop: KeyboardInterrupt) -> int:
    """The exit code of a program that was stopped."""
    return TERMINATED if isinstance(stop, Terminated) else INTERRUPTED


@dataclass
class CampaignResult:
    """`rows`: of all parts that were asked for, those on file before included, in their order.

    `bad`: how many of them are failures. `failed`: parts that could not be measured. `stopped`: the exit code of a
    campaign that a signal ended, else None.
    """

    rows: list
    bad: int = 0
    failed: int = 0
    stopped: int | None = None

    @property
    def code(self) -> int:
        """Exit code: 0, 1 (a failure), 130 or 143 (stopped)."""
        return self.stopped or int(bool(self.bad or self.failed))


class Ledger:
    """Rows that stand for parts: of this device and of the scene as it is now, the latest of each part."""

    def __init__(self, study: Study, rows: Sequence[Any], device: str | None):
        self._study, self._device = study, device
        self._rows: dict[tuple, Any] = {}
        self._sources: dict[str, tuple] = {}
        for row in rows:
            self.note(row)

    def note(self, row: Any, scene: str | None = None) -> str:
        """Take in a row, of which `scene` is the one just measured; returns its part's id."""
        part, source = self._study.id_of(row), self._study.source_of(row)
        if self._study.device_of(row) in (None, self._device):
            self._rows[part, *source] = row
        if scene is not None:
            self._sources[scene] = source
        return part

    def row_of(self, task: Task, part: Part) -> Any | None:
        """The row that stands for a part, None where it is still to be measured."""
        return self._rows.get((part.id, *self._source(task)))

    def missing(self, task: Task) -> list[Part]:
        """The parts that are still to be measured."""
        return [part for part in task.parts if self.row_of(task, part) is None]

    def _source(self, task: Task) -> tuple:
        """What the rows of the scene as it is now have; it is loaded only where a row might be of it."""
        if not self._study.of_scene:
            return ()
        if task.scene not in self._sources:
            on_file = {key[0] for key in self._rows}
            if not any(part.id in on_file for part in task.parts):
                return ("not loaded",)
            try:
                scene = load_scene(task.scene)
            except DefrayError:
                return ("cannot be loaded",)  # which is found out again when it is measured
            self._sources[task.scene] = (scene.source, scene.sha256)
        return self._sources[task.scene]


class InMemory:
    """Rows of a measurement that is not stored."""

    path = None

    def __init__(self):
        self._rows: list = []

    def append(self, row: Any) -> None:
        """Keep a row."""
        self._rows.append(row)

    def read(self) -> list:
        """All rows."""
        return list(self._rows)

    repair = read


def run(
    tasks: Sequence[Task],
    executor: Executor,
    out: Path | None,
    resume: bool = False,
    command: str = "",
    console: Console | None = None,
) -> CampaignResult:
    """Carry out tasks of one study in the folder `out`, which is locked meanwhile; None stores nothing.

    `resume`: rows on file stand for their parts. `command` goes on with what a signal has stopped. Raises DefrayError
    where the folder cannot be used.
    """
    with locked(out) if out else nullcontext():
        return carry_out(tasks, executor, out, resume, command, console)


def carry_out(
    tasks: Sequence[Task],
    executor: Executor,
    out: Path | None,
    resume: bool = False,
    command: str = "",
    console: Console | None = None,
) -> CampaignResult:
    """`run` in a folder that is locked already."""
    console = console or Console(stderr=True)
    campaign = _Campaign(tasks, executor, out, console)
    campaign.open(resume)
    try:
        with terminable():
            campaign.measure()
    except KeyboardInterrupt as stop:
        # Counted on file: the signal may have come between storing a row and noting it.
        ids = {campaign.study.id_of(row) for row in campaign.file.read()}
        done = sum(part.id in ids for task in tasks for part in task.parts)
        line = f"stopped after {done} of {campaign.total} {campaign.study.unit}"
        console.print(escape(line + (f"; go on with: {command}" if command else "")), highlight=False, soft_wrap=True)
        return campaign.outcome(code_of(stop))
    campaign.summarise()
    return campaign.outcome()


def refuse_rows(path: Path) -> None:
    """Raise DefrayError where a file has rows already."""
    if path.exists() and path.stat().st_size:
        raise DefrayError(f"{path} already has records; pass --resume to go on, or choose another --out")


class _Campaign:
    """Tasks on their way."""

    def __init__(self, tasks: Sequence[Task], executor: Executor, out: Path | None, console: Console):
        self.study, self.tasks, self.executor, self.out, self.console = tasks[0].study, tasks, executor, out, console
        self.total = sum(len(task.parts) for task in tasks)
        self.failed = 0
        self.stored: set[str] = set()  # ids of parts measured now

    def open(self, resume: bool) -> None:
        """Open the file; its rows count when resuming."""
        machine = self.executor.machine
        self.file: Rows = self.study.file(self.out, machine) if self.out else InMemory()
        self.file.warn = self._warn
        if self.out and not resume and not self.study.adds:
            refuse_rows(self.file.path)
        rows = self.file.repair()
        self.ledger = Ledger(self.study, rows if resume else [], machine.device)

    def _warn(self, message: str) -> None:
        self.console.print(f"[yellow]warning:[/yellow] {escape(message)}", highlight=False, soft_wrap=True)

    def measure(self) -> None:
        """Carry out what is not on file."""
        waiting = [task.only(parts) for task in self.tasks if (parts := self.ledger.missing(task))]
        scenes = dict.fromkeys(task.scene for task in waiting if task.scene)
        for line in announcements((name, expected_triangles(name)) for name in scenes):
            self.console.print(line, highlight=False, soft_wrap=True, markup=False)
        done = self.total - sum(len(task.parts) for task in waiting)
        if not waiting:
            return
        with Display(self.console, self.total, done, sum(task.cost for task in waiting)) as display:
            try:
                for task in waiting:
                    self._run(task, display)
            finally:
                if self.out:
                    drop_errors(self.out, self.stored)

    def _run(self, task: Task, display: Display) -> None:
        """Carry out one task; after a failed part, those that are not done run again without it."""
        display.start(task)
        failed_before, remaining = self.failed, {part.id: part for part in task.parts}
        while remaining:
            try:
                self._attempt(task.only(remaining.values()), remaining, display)
            except TaskFailed as failure:
                # Without a culprit it was the scene, the rays or the grid, which all parts of the task share.
                for part in [failure.part] if failure.part in remaining else list(remaining):
                    self._fail(task, remaining.pop(part), failure, display)
        display.end(whole=self.failed == failed_before)

    def _attempt(self, task: Task, remaining: dict[str, Part], display: Display) -> None:
        """Measure what remains of a task; every part whose row is stored is taken out of `remaining`."""
        for row in self.executor.submit(task, display.tell):
            self.file.append(row)
            part = remaining.pop(self.ledger.note(row, task.scene), None)
            if part:
                self.stored.add(part.id)
                display.stored(part, self.study.outcome(row), self.study.passed(row))
        if remaining:
            raise TaskFailed("the study returned no row")

    def _fail(self, task: Task, part: Part, failure: TaskFailed, display: Display) -> None:
        self.failed += 1
        if self.out:
            store_error(self.out, task, part, failure)
        display.failed(part, failure.message)

    def outcome(self, stopped: int | None = None) -> CampaignResult:
        """The rows of all parts, and how it went."""
        found = [self.ledger.row_of(task, part) for task in self.tasks for part in task.parts]
        rows = [row for row in found if row is not None]
        return CampaignResult(rows, sum(not self.study.passed(row) for row in rows), self.failed, stopped)

    def summarise(self) -> None:
        """Print the last line."""
        study, outcome = self.study, self.outcome()
        parts = [f"{self.total} {study.unit}: {len(outcome.rows) - outcome.bad} {study.good}"]
        if outcome.bad:
            parts.append(f"[red]{outcome.bad} {study.bad}[/red]")
        if self.failed:
            where = f" (see {escape(str(self.out / ERRORS))})" if self.out else ""
            parts.append(f"[red]{self.failed} could not run{where}[/red]")
        line = ", ".join(parts) + (f"; records in {escape(str(self.file.path))}" if self.out else "")
        self.console.print(line, highlight=False, soft_wrap=True)
