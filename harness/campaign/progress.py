"""What a campaign shows while it runs: a line for each part, and on a terminal a bar with the time left."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn
from rich.text import Text

from harness.studies.study import Part, Step, Task


class TimeLeft:
    """Seconds left, from the tasks' costs times what those measured so far took over their costs."""

    def __init__(self, cost: float):
        self._waiting = cost
        self._guessed = self._took = 0.0

    def start(self, cost: float) -> None:
        """A task begins, which no longer waits."""
        self._waiting -= cost

    def measured(self, cost: float, seconds: float) -> None:
        """A task of this cost took so many seconds."""
        self._guessed, self._took = self._guessed + cost, self._took + seconds

    def left(self, cost: float, elapsed: float, done: float) -> float:
        """Seconds left of the running task, `elapsed` seconds old and `done` in [0, 1], and of those that wait."""
        factor = self._took / self._guessed if self._guessed else 1.0
        whole = cost * factor
        if done > 0.1:
            whole = (1.0 - done) * whole + done * (elapsed / done)
        return max(self._waiting, 0.0) * factor + max(whole - elapsed, whole * (1.0 - done) * 0.25)


def about(seconds: float) -> str:
    """`about 40 s left`, `about 12 min left`: no more digits than the estimate deserves."""
    if seconds < 90:
        return f"about {max(10, round(seconds / 10) * 10)} s left"
    if seconds < 5400:
        return f"about {round(seconds / 60)} min left"
    return f"about {seconds / 3600:.1f} h left"


class Display:
    """Shows progress on `console`: a line for each part everywhere, the bar on a terminal only."""

    def __init__(
        self, console: Console, total: int, done: int, cost: float, clock: Callable[[], float] = time.monotonic
    ):
        self.console, self.total, self.done = console, total, done
        self.time_left, self._clock = TimeLeft(cost), clock
        self._task: Task | None = None
        self._started, self._fraction = clock(), 0.0
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            _TimeLeftColumn(self._left),
            console=console,
            transient=True,
            disable=not console.is_terminal,
            expand=False,
        )
        self._line = self._bar.add_task("starting", total=total, completed=done)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_) -> None:
        self._bar.stop()

    def start(self, task: Task) -> None:
        """A task begins."""
        self._task, self._started = task, self._clock()
        self.time_left.start(task.cost)
        self._show(task.name, 0.0)

    def tell(self, step: Step) -> None:
        """What the task is doing now."""
        names = {part.id: part.name for part in self._task.parts}
        self._show(f"{names.get(step.part, self._task.name)}, {step.stage}", step.done)

    def end(self, whole: bool) -> None:
        """The task is over; its time corrects the estimate if all of it was measured."""
        if whole:
            self.time_left.measured(self._task.cost, self._clock() - self._started)
        self._task = None

    def stored(self, part: Part, outcome: str | None, passed: bool) -> None:
        """A part's row is on file: print its line, if it gets one."""
        self.done += 1
        if outcome is not None:
            self._print(part, escape(outcome) if passed else f"[red]{escape(outcome)}[/red]")
        self._bar.update(self._line, completed=self.done)

    def failed(self, part: Part, message: str) -> None:
        """Print the line of a part that could not be measured."""
        self.done += 1
        self._print(part, f"[red]error: {escape(message)}[/red]")
        self._bar.update(self._line, completed=self.done)

    def _print(self, part: Part, outcome: str) -> None:
        width = len(str(self.total))
        head = escape(f"[{self.done:{width}}/{self.total}] {part.name} … ")
        self.console.print(head + outcome, highlight=False, soft_wrap=True)

    def _show(self, what: str, done: float) -> None:
        self._fraction = done
        self._bar.update(self._line, description=escape(what), refresh=True)

    def _left(self) -> str:
        if self._task is None:
            return ""
        return about(self.time_left.left(self._task.cost, self._clock() - self._started, self._fraction))


class _TimeLeftColumn(ProgressColumn):
    """The time left, asked anew at every refresh, so that it also falls during a long step."""

    def __init__(self, text: Callable[[], str]):
        self._text = text
        super().__init__()

    def render(self, task) -> Text:
        return Text(self._text())
