"""`defray accuracy`: measure rate and errors of many variants on some scenes, row by row into accuracy.jsonl."""

from __future__ import annotations

import json as json_module
import tomllib
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from harness.accuracy import Contender, Plan

TIERS = Path(__file__).parent / "paper" / "accuracy.toml"


def accuracy(
    scenes: Annotated[
        list[str] | None, typer.Argument(metavar="SCENE ...", help="Scenes or mesh files; or see --tier.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for accuracy.jsonl; made if it is not there.")] = Path(
        "results/out"
    ),
    tier: Annotated[
        str | None, typer.Option(help="Scenes and counts of harness/paper/accuracy.toml: smoke, paper or full.")
    ] = None,
    variants: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            help="tracer:intersector[:option=value...], also binning=padded, closed, open or box. By default every "
            "intersector in the deferred tracer, contraction off and on, every binning, forward, and Embree.",
        ),
    ] = None,
    rays: Annotated[str | None, typer.Option(metavar="COUNT", help="Diffuse rays, timed; 100k by default.")] = None,
    aimed: Annotated[
        str | None,
        typer.Option(
            metavar="COUNT",
            help="Rays aimed at edges and vertices; 1M by default. N rays without a leak show a rate below 3/N.",
        ),
    ] = None,
    repetitions: Annotated[int | None, typer.Option(min=1, help="Timed repetitions; 5 by default.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the rows on file and measure what is missing.")
    ] = False,
    device: Annotated[
        str | None, typer.Option(metavar="PART", help="Part of a device's name in 'defray doctor'.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the rows as JSON, nothing else there.")] = False,
) -> None:
    """Chart speed against accuracy: rate, leaks of aimed rays and errors of t for many variants of tracers."""
    from harness.accuracy import Contender

    names, plan = _request(scenes or [], tier, rays, aimed, repetitions)
    contenders = [Contender.parse(text.strip()) for text in variants.split(",") if text.strip()] if variants else None
    rows = run_accuracy(AccuracyRequest(names, contenders, plan, out, resume, device))
    if json:
        typer.echo(json_module.dumps(rows, allow_nan=False, ensure_ascii=False))


def register(app: typer.Typer) -> None:
    """Add the command to `defray`."""
    app.command(
        epilog="Examples:  [bold]defray accuracy sponza --rays 20k --aimed 100k[/bold]   "
        "[bold]defray accuracy sponza crown --variants deferred:ray-space,embree --out results/mine[/bold]"
    )(accuracy)


def _request(scenes: Sequence[str], tier: str | None, rays, aimed, repetitions) -> tuple[list[str], Plan]:
    """Scenes and counts from the command line, else from the tier; raises DefrayError for what is not known."""
    from harness.accuracy import Plan
    from harness.errors import DefrayError, known
    from harness.plan import parse_count
    from harness.scene import check_name

    given = {"rays": rays and parse_count(rays), "aimed": aimed and parse_count(aimed), "repetitions": repetitions}
    counts = {}
    if tier is not None:
        tiers = tomllib.loads(TIERS.read_text(encoding="utf-8"))["tiers"]
        if tier not in tiers:
            raise known("tier", tier, tiers)
        scenes = scenes or tiers[tier]["scenes"]
        counts = {name: parse_count(tiers[tier][name]) for name in given}
    if not scenes:
        raise DefrayError("name a scene or a tier, as in: defray accuracy sponza")
    for name in scenes:
        check_name(name)
    counts |= {name: value for name, value in given.items() if value}
    return list(dict.fromkeys(scenes)), Plan(**counts)


@dataclass
class AccuracyRequest:
    """What `defray accuracy` was asked; `contenders` None stands for the default list of the device."""

    scenes: list[str]
    contenders: list[Contender] | None
    plan: Plan
    out: Path
    resume: bool = False
    device: str | None = None


def run_accuracy(request: AccuracyRequest) -> list[dict]:
    """Measure, store every scene's rows at once, and return the rows of the request, those on file included.

    Raises DefrayError where a scene, a variant or the folder cannot be used.
    """
    from rich.console import Console

    from harness.accuracy import default_contenders
    from harness.accuracy_rows import accuracy_file
    from harness.device import open_device
    from harness.errors import DefrayError
    from harness.sweep import locked

    console = Console(stderr=True)
    device = open_device(request.device)
    contenders = request.contenders or default_contenders(device)
    with locked(request.out):
        file = accuracy_file(request.out)
        stored = {row["id"]: row for row in file.repair()}
        if stored and not request.resume:
            raise DefrayError(f"{file.path} already has rows; pass --resume to go on, or choose another --out")
        missing = {
            scene: [one for one in contenders if request.plan.id_of(scene, one) not in stored]
            for scene in request.scenes
        }
        with scene_progress(console, [scene for scene, some in missing.items() if some]) as progress:
            for scene, some in missing.items():
                for row in _measured(scene, some, request.plan, device, progress):
                    file.append(row)
                    stored[row["id"]] = row
                    progress.line(describe(row))
    console.print(f"{len(stored)} rows in {file.path}", highlight=False, soft_wrap=True, markup=False)
    wanted = [request.plan.id_of(scene, one) for scene in request.scenes for one in contenders]
    return [stored[identity] for identity in wanted]


def _measured(scene: str, contenders, plan: Plan, device, progress):
    """Whole rows of one scene."""
    from harness.accuracy import measure_accuracy
    from harness.measure import shared_scene

    if not contenders:
        return
    progress.start(scene)
    shared = shared_scene(scene, device)
    for row in measure_accuracy(shared, contenders, plan, device, progress.tell):
        yield row | row_facts(device) | {"id": plan.id_of(scene, row["variant"])}
    progress.end()


def row_facts(device) -> dict:
    """When, where and by which command a row is measured."""
    from harness.device import machine_description
    from harness.record import command_line, commit_and_dirty, now_utc

    commit, dirty = commit_and_dirty()
    return {
        "time_utc": now_utc(),
        "command": command_line(),
        "commit": commit,
        "dirty": dirty,
        "machine": machine_description(device),
    }


def describe(row: dict) -> str:
    """One row as one line."""
    aimed, error = row["aimed"], row["t_error"]["p99"]
    rate = f"{row['rate']['median'] / 1e6:.3g} Mrays/s"
    leaks = f"{aimed['leaks']:,} of {aimed['rays']:,} aimed rays leak"
    t_error = "" if error is None else f", t error p99 {error:.1e}"
    return f"{row['scene']['name']} {row['variant']} … {rate}, {leaks}{t_error}"


class SceneProgress:
    """Shows which scene is measured, what is being done, and how far it is: a bar on a terminal, else lines only."""

    def __init__(self, bar, console, scenes: Sequence[str]):
        self._bar, self._console, self._scenes, self._done, self._scene = bar, console, len(scenes), 0, ""
        self._task = bar.add_task("starting", total=max(self._scenes, 1))

    def start(self, scene: str) -> None:
        """A scene begins."""
        self._scene = scene
        self.tell("loading", 0.0)

    def tell(self, stage: str, done: float) -> None:
        """`done`: share of the scene's work, 0 to 1."""
        from rich.markup import escape

        text = escape(f"{self._scene}: {stage}")
        self._bar.update(self._task, description=text, completed=self._done + done, refresh=True)

    def end(self) -> None:
        """The scene is done."""
        self._done += 1

    def line(self, text: str) -> None:
        """Print one line above the bar."""
        self._console.print(text, highlight=False, soft_wrap=True, markup=False)


@contextmanager
def scene_progress(console, scenes: Sequence[str]):
    """A SceneProgress over `scenes`, on `console`."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TaskProgressColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield SceneProgress(bar, console, scenes)
