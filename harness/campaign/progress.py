"""What a sweep shows while it runs: one line a run, and on a terminal a bar with the time left."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from harness.records.agreement import why_failed
from harness.records.run_row import Record
from harness.spec.run_spec import RunSpec
from harness.stats import megarays


class SceneProgress:
    """Shows which scene is measured, what is being done, and how far it is: a bar on a terminal, else lines only."""

    def __init__(self, bar, console, scenes: int):
        self._bar, self._console, self._done, self._scene = bar, console, 0, ""
        self._task = bar.add_task("starting", total=max(scenes, 1))

    def start(self, scene: str) -> None:
        """A scene begins."""
        self._scene = scene
        self.tell("loading", 0.0)

    def tell(self, stage: str, done: float) -> None:
        """`done`: share of the scene's work, 0 to 1."""
        text = escape(f"{self._scene}: {stage}")
        self._bar.update(self._task, description=text, completed=self._done + done, refresh=True)

    def end(self) -> None:
        """The scene is done."""
        self._done += 1

    def line(self, text: str) -> None:
        """Print one line above the bar."""
        self._console.print(text, highlight=False, soft_wrap=True, markup=False)


@contextmanager
def scene_progress(console, scenes: int):
    """A SceneProgress over so many scenes, on `console`."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TaskProgressColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield SceneProgress(bar, console, scenes)


UNKNOWN_SCENE = 1_000_000  # triangles assumed of a scene that is not listed
# First guess, seconds a ray in a scene of 300,000 triangles on two CPU cores; measured groups correct it.
RAY_SECONDS = {"deferred": 3.0e-6, "forward": 5.0e-6, "work-optimal": 5.0e-6, "embree": 0.5e-6}
BRUTE_TEST_SECONDS = 1.0e-9  # one ray against one triangle
TRIANGLE_SECONDS = 4.0e-6  # loading a scene, building its grid and the reference's tree, per triangle
CHECK_SECONDS = 1.5e-6  # making a ray and checking its hit


def group_name(spec: RunSpec) -> str:
    """Scene and grid of a run, for people."""
    if spec.grid and spec.grid.reading in ("adaptive", "auto"):
        return f"{spec.scene} {spec.grid}"
    return f"{spec.scene} {spec.grid.top}/{spec.grid.leaf}" if spec.grid else spec.scene


def run_name(spec: RunSpec) -> str:
    """Scene, grid and variant of a run, for people."""
    reading = f" {spec.grid.reading}" if spec.grid and spec.grid.reading == "per-cell" else ""
    return f"{group_name(spec)}{reading} {spec.variant}"


def guessed_seconds(spec: RunSpec, triangles: int) -> float:
    """A first guess at the seconds of one run's repetitions, its warm-up and its check."""
    tracer = spec.variant.tracer
    if tracer == "brute":
        per_ray = triangles * BRUTE_TEST_SECONDS
    else:
        # A fixed grid gets more triangles a cell as scenes grow; a tree's depth hardly does.
        growth = 0.15 if tracer == "embree" else 0.5
        per_ray = RAY_SECONDS.get(tracer, 2.0e-6) * (triangles / 300_000) ** growth
        if spec.grid and spec.grid.reading not in ("adaptive", "auto") and tracer != "embree":
            per_ray *= max(128 / spec.grid.resolution, 0.5)
    return 0.5 + spec.rays * ((spec.repetitions + 2) * per_ray + CHECK_SECONDS)


class TimeLeft:
    """Seconds left of a sweep, from a cost model that the groups measured so far correct.

    Each measured group gives a factor (measured over guessed). A group still to come is scaled by the
    mean factor, in which groups of the same scene and of the same tracers weigh more.
    """

    def __init__(self, triangles: Mapping[str, int]):
        self.triangles = dict(triangles)
        self._measured: list[tuple[RunSpec, set[str], float]] = []

    def guess(self, specs: Sequence[RunSpec]) -> float:
        """Uncorrected seconds of a group."""
        triangles = self.triangles.get(specs[0].scene, UNKNOWN_SCENE)
        preparation = 1.0 + triangles * TRIANGLE_SECONDS
        return preparation + sum(guessed_seconds(spec, triangles) for spec in specs)

    def predict(self, specs: Sequence[RunSpec]) -> float:
        """Corrected seconds of a group."""
        tracers = {spec.variant.tracer for spec in specs}
        weights, total = 0.0, 0.0
        for other, other_tracers, factor in self._measured:
            alike = len(tracers & other_tracers) / len(tracers | other_tracers)
            weight = 1.0 + 4.0 * (other.scene == specs[0].scene) + 4.0 * alike
            weights, total = weights + weight, total + weight * math.log(factor)
        return self.guess(specs) * (math.exp(total / weights) if weights else 1.0)

    def measured(self, specs: Sequence[RunSpec], seconds: float) -> None:
        """Learn that the group of `specs` took `seconds`."""
        factor = max(seconds, 1e-3) / self.guess(specs)
        self._measured.append((specs[0], {spec.variant.tracer for spec in specs}, factor))

    def left(
        self, running: Sequence[RunSpec], elapsed: float, done: float, waiting: Sequence[Sequence[RunSpec]]
    ) -> float:
        """Seconds left: of the running group, `elapsed` seconds old and `done` in [0, 1], and of the rest."""
        rest = sum(self.predict(specs) for specs in waiting)
        if not running:
            return rest
        whole = self.predict(running)
        if done > 0.1:
            whole = (1.0 - done) * whole + done * (elapsed / done)
        return rest + max(whole - elapsed, whole * (1.0 - done) * 0.25)


def about(seconds: float) -> str:
    """`about 40 s left`, `about 12 min left`: no more digits than the estimate deserves."""
    if seconds < 90:
        return f"about {max(10, round(seconds / 10) * 10)} s left"
    if seconds < 5400:
        return f"about {round(seconds / 60)} min left"
    return f"about {seconds / 3600:.1f} h left"


class Display:
    """Shows a sweep's progress on `console`: run lines everywhere, the bar on a terminal only."""

    def __init__(
        self,
        console: Console,
        total: int,
        done: int,
        time_left: TimeLeft,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.console, self.total, self.done = console, total, done
        self.time_left, self._clock = time_left, clock
        self._running: Sequence[RunSpec] = []
        self._waiting: Sequence[Sequence[RunSpec]] = []
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
        self._task = self._bar.add_task("starting", total=total, completed=done)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_) -> None:
        self._bar.stop()

    def start_group(self, specs: Sequence[RunSpec], waiting: Sequence[Sequence[RunSpec]]) -> None:
        """A group begins; `waiting` are those after it."""
        self._running, self._waiting, self._started = specs, waiting, self._clock()
        self._show(group_name(specs[0]), 0.0)

    def progress(self, progress) -> None:
        """Callback for `pipeline.run_group`: what it is doing now."""
        what = run_name(progress.spec) if progress.spec else group_name(self._running[0])
        self._show(f"{what}, {progress.stage}", progress.done)

    def end_group(self, whole: bool) -> None:
        """The group is over; its time corrects the estimate if all of it ran."""
        if whole:
            self.time_left.measured(self._running, self._clock() - self._started)
        self._running = []

    def finished(self, spec: RunSpec, record: Record) -> None:
        """Print the line of one stored run."""
        self.time_left.triangles[spec.scene] = record.scene.triangles
        if not record.agreement.is_checked:
            self._line(spec, "not checked, hence no rate")
        elif record.failed:
            self._line(spec, f"[red]check failed: {escape(why_failed(record.agreement))}, no rate[/red]")
        else:
            rate = record.rate.total
            self._line(spec, f"{megarays(rate.median):.3g} Mrays/s valid" if rate else "valid, no rate")

    def failed(self, spec: RunSpec, message: str) -> None:
        """Print the line of one run that could not be carried out."""
        self._line(spec, f"[red]error: {escape(message)}[/red]")

    def _line(self, spec: RunSpec, outcome: str) -> None:
        self.done += 1
        width = len(str(self.total))
        head = escape(f"[{self.done:{width}}/{self.total}] {run_name(spec)} … ")
        self.console.print(head + outcome, highlight=False, soft_wrap=True)
        self._bar.update(self._task, completed=self.done)

    def _show(self, what: str, done: float) -> None:
        self._fraction = done
        self._bar.update(self._task, description=escape(what), refresh=True)

    def _left(self) -> str:
        if not self._running:
            return ""
        elapsed = self._clock() - self._started
        return about(self.time_left.left(self._running, elapsed, self._fraction, self._waiting))


class _TimeLeftColumn(ProgressColumn):
    """The time left, asked anew at every refresh, so that it also falls during a long step."""

    def __init__(self, text: Callable[[], str]):
        self._text = text
        super().__init__()

    def render(self, task) -> Text:
        return Text(self._text())
