"""`defray accuracy`, which measures rate and errors of many variants, and `defray recommend`, which chooses one."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.options import DeviceOption, JsonOption, print_json

if TYPE_CHECKING:
    from harness.accuracy import Contender, Plan

TIERS = Path(__file__).parent / "paper" / "accuracy.toml"
VariantsOption = Annotated[
    str | None,
    typer.Option(
        metavar="A,B,...",
        help="tracer:intersector[:option=value...], also binning=padded, closed, open or box (the grid's overlap "
        "test). By default every intersector in the deferred tracer, contraction off and on, every binning, "
        "forward, and Embree; with --tier, the tier's.",
    ),
]


def accuracy(
    scenes: Annotated[
        list[str] | None, typer.Argument(metavar="SCENE ...", help="Scenes or mesh files; or see --tier.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for accuracy.jsonl; made if it is not there.")] = Path(
        "results/out"
    ),
    tier: Annotated[
        str | None, typer.Option(help="Scenes, counts, variants of harness/paper/accuracy.toml; smoke, paper, full.")
    ] = None,
    variants: VariantsOption = None,
    rays: Annotated[
        str | None, typer.Option(metavar="COUNT", help="Diffuse rays, timed; 100k, or the tier's.")
    ] = None,
    aimed: Annotated[
        str | None,
        typer.Option(
            metavar="COUNT",
            help="Rays aimed at edges and vertices; 1M, or the tier's. N rays without a leak show a rate below 3/N.",
        ),
    ] = None,
    repetitions: Annotated[int | None, typer.Option(min=1, help="Timed repetitions; 5, or the tier's.")] = None,
    precision: Annotated[
        bool,
        typer.Option("--precision", help="Also measure resolution, precision and rays a pixel: precision.jsonl."),
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the rows on file and measure what is missing.")
    ] = False,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Chart speed against accuracy: rate, leaks of aimed rays and errors of t for many variants of tracers.

    The variants of a scene are timed in turns; each is stored once all are timed and its own errors are known.
    What is interrupted before goes on with --resume from the start of that scene.
    """
    parts = _parts(scenes or [], tier, rays, aimed, repetitions)
    given = {} if variants is None else {"contenders": parse_contenders(variants)}
    given |= {"precision": True} if precision else {}
    parts = [replace(part, **given) for part in parts]
    rows = run_accuracy(AccuracyRequest(parts, out, resume, device))
    if json:
        print_json(rows)


def recommend(
    scene: Annotated[str, typer.Argument(metavar="SCENE_OR_FILE", help="A scene, or a mesh file.")],
    max_leaks: Annotated[
        float, typer.Option(help="Largest share of rays aimed at edges and vertices that may leak.")
    ] = 1e-6,
    max_t_error: Annotated[
        float | None, typer.Option(help="Largest relative error of t, 99th percentile; none by default.")
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="DIR",
            help="Folder with accuracy.jsonl; by default results/out, then results/reference/*.",
        ),
    ] = None,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Name the fastest variant that is shown to be accurate enough; measures what the rows on file do not show."""
    from rich.console import Console
    from rich.markup import escape

    from harness import recommend as module
    from harness.scene import check_name

    check_name(scene)
    console = Console(stderr=True)
    with console.status(escape(scene)) as status:

        def say(text: str) -> None:
            status.update(escape(text))
            if not console.is_terminal and ":" in text:
                console.print(text, highlight=False, soft_wrap=True, markup=False)

        advice = module.recommend(scene, module.Limits(max_leaks, max_t_error), folder, device, say)
    if json:
        print_json(module.as_json(advice))
    else:
        for note in advice.notes:
            typer.echo(f"measured here: {note}")
        for line in module.lines_of(advice):
            typer.echo(line, err=advice.choice is None)
    raise typer.Exit(0 if advice.choice else 1)


def register(app: typer.Typer) -> None:
    """Add the commands to `defray`."""
    app.command(
        epilog="Examples:  [bold]defray accuracy sponza --rays 20k --aimed 100k[/bold]   "
        "[bold]defray accuracy sponza crown --variants deferred:ray-space,embree --out results/mine[/bold]"
    )(accuracy)
    app.command(epilog="Example:  [bold]defray recommend sponza --max-leaks 1e-6[/bold]")(recommend)


@dataclass(frozen=True)
class Part:
    """One scene and what is measured on it; `contenders` None stands for the default list of the device."""

    scene: str
    plan: Plan
    contenders: list[Contender] | None = None
    precision: bool = False


@dataclass
class AccuracyRequest:
    """What `defray accuracy` was asked."""

    parts: list[Part]
    out: Path
    resume: bool = False
    device: str | None = None


def parse_contenders(text: str) -> list[Contender]:
    """The variants of `A,B,...`, each once; raises DefrayError where there is none, or one that is not known."""
    from harness.accuracy import Contender
    from harness.errors import DefrayError

    found = {str(one): one for one in (Contender.parse(part.strip()) for part in text.split(",") if part.strip())}
    if not found:
        raise DefrayError(f"'{text}' names no variant; write one, as in deferred:ray-space, or leave --variants out")
    return list(found.values())


def _parts(scenes: Sequence[str], tier: str | None, rays, aimed, repetitions) -> list[Part]:
    """Scenes and counts of the tier, replaced by those of the command line.

    Raises DefrayError for what is not known.
    """
    from harness.accuracy import Plan
    from harness.errors import DefrayError, known
    from harness.plan import parse_count
    from harness.scene import check_name

    given = {"rays": rays, "aimed": aimed, "repetitions": repetitions}
    given = {name: parse_count(value) for name, value in given.items() if value is not None}
    entries = [{"scenes": list(scenes)}]
    if tier is not None:
        tiers = tomllib.loads(TIERS.read_text(encoding="utf-8"))["tiers"]
        if tier not in tiers:
            raise known("tier", tier, tiers)
        entries = [entry | ({"scenes": list(scenes)} if scenes else {}) for entry in tiers[tier]]
    found: dict[str, Part] = {}
    for entry in entries:
        counts = {name: parse_count(entry[name]) for name in ("rays", "aimed", "repetitions") if name in entry}
        contenders = parse_contenders(",".join(entry["variants"])) if "variants" in entry else None
        for scene in entry["scenes"]:
            check_name(scene)
            precision = scene in entry.get("precision", ())
            found.setdefault(scene, Part(scene, Plan(**(counts | given)), contenders, precision))
    if not found:
        raise DefrayError("name a scene or a tier, as in: defray accuracy sponza")
    return list(found.values())


def run_accuracy(request: AccuracyRequest) -> list[dict]:
    """Measure, store every row as soon as it is whole, and return the rows of the request, those on file included.

    Raises DefrayError where a scene, a variant or the folder cannot be used.
    """
    from rich.console import Console

    from harness.accuracy import default_contenders
    from harness.accuracy_rows import accuracy_file, source_of
    from harness.device import open_device
    from harness.errors import DefrayError
    from harness.sweep import locked

    console = Console(stderr=True)
    device = open_device(request.device)
    parts = [replace(part, contenders=part.contenders or default_contenders(device)) for part in request.parts]
    with locked(request.out):
        file = accuracy_file(request.out)
        rows = file.repair()
        stored = stored_rows(rows, device)
        if rows and not request.resume:
            raise DefrayError(f"{file.path} already has rows; pass --resume to go on, or choose another --out")
        facts = {part.scene: _facts_on_file(part, stored) for part in parts}
        missing = [_missing(part, stored, facts[part.scene]) for part in parts]
        with scene_progress(console, sum(bool(part.contenders) for part in missing)) as progress:
            for part in missing:
                for row in _measured(part, device, progress):
                    file.append(row)
                    stored |= stored_rows([row], device)
                    facts[part.scene] = source_of(row["scene"])
                    progress.line(describe(row))
        with scene_progress(console, sum(part.precision for part in parts)) as progress:
            _run_precision(request, parts, device, progress)
    console.print(f"{len(stored)} rows in {file.path}", highlight=False, soft_wrap=True, markup=False)
    return [stored[part.plan.id_of(part.scene, one), *facts[part.scene]] for part in parts for one in part.contenders]


def stored_rows(rows: Sequence[dict], device) -> dict[tuple, dict]:
    """Rows of a device by id and by what they were measured on: a mesh that has changed since is another one."""
    from harness.accuracy_rows import source_of

    return {(row["id"], *source_of(row["scene"])): row for row in rows if row["machine"]["device"] == device.name}


def _facts_on_file(part: Part, stored: dict[tuple, dict]) -> tuple[str, str] | None:
    """`source_of` the scene as it is now; None where no row is on file that might be of it, and it is not loaded."""
    from harness.scene import load_scene

    ids = {part.plan.id_of(part.scene, one) for one in part.contenders}
    if not any(key[0] in ids for key in stored):
        return None
    scene = load_scene(part.scene)
    return scene.source, scene.sha256


def _missing(part: Part, stored: dict[tuple, dict], facts: tuple[str, str] | None) -> Part:
    """The part without the contenders that are on file, measured on the scene as it is now."""
    return replace(part, contenders=[
        one for one in part.contenders if facts is None or (part.plan.id_of(part.scene, one), *facts) not in stored
    ])


def _measured(part: Part, device, progress: SceneProgress) -> Iterator[dict]:
    """Whole rows of one scene."""
    from harness.accuracy import measure_accuracy
    from harness.measure import shared_scene

    if not part.contenders:
        return
    progress.start(part.scene)
    shared = shared_scene(part.scene, device)
    for row in measure_accuracy(shared, part.contenders, part.plan, device, progress.tell):
        yield row | row_facts(device) | {"id": part.plan.id_of(part.scene, row["variant"])}
    progress.end()


def _run_precision(request: AccuracyRequest, parts: list[Part], device, progress: SceneProgress) -> None:
    """Measure what precision.jsonl lacks, scene by scene."""
    from harness.accuracy_rows import identity, precision_file
    from harness.measure import shared_scene
    from harness.precision import SAMPLES, measure_precision

    file = precision_file(request.out)
    stored = stored_rows(file.repair(), device)
    for part in parts:
        rays, repetitions = part.plan.rays, part.plan.repetitions
        facts = {"scene": part.scene, "rays": rays, "repetitions": repetitions}
        if not part.precision:
            continue
        progress.start(part.scene)
        shared = shared_scene(part.scene, device)
        last = identity(**facts, knob="samples", value=str(SAMPLES[-1]))  # the others are stored before it
        if (last, shared.scene.source, shared.scene.sha256) in stored:
            progress.end()
            continue
        for row in measure_precision(shared, rays, repetitions, device, progress.tell):
            file.append(row | row_facts(device) | {"id": identity(**facts, knob=row["knob"], value=row["value"])})
        progress.end()
        progress.line(f"{part.scene} … precision and resolution: rows in {file.path}")


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

    def __init__(self, bar, console, scenes: int):
        self._bar, self._console, self._done, self._scene = bar, console, 0, ""
        self._task = bar.add_task("starting", total=max(scenes, 1))

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
def scene_progress(console, scenes: int):
    """A SceneProgress over so many scenes, on `console`."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TaskProgressColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield SceneProgress(bar, console, scenes)
