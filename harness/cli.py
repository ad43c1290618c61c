"""The `defray` command. Every command imports what it needs when it runs, so that `--help` is instant."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from harness import accuracy_command, claims_command, coherence_command, roofline_command
from harness.errors import DefrayError
from harness.options import (
    DensityOption,
    DeviceOption,
    JsonOption,
    KindOption,
    LeafOption,
    RaysOption,
    ReadingOption,
    SeedOption,
    TopOption,
    print_json,
)
from harness.scenes_command import scenes_app
from harness.stability.command import stability

UsageError = typer.BadParameter.__base__  # Typer names no other way to it
app = typer.Typer(
    name="defray",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Benchmark deferred ray tracing: rays are binned by the grid cells they visit, then bins are "
    "intersected one after the other. Every result is checked against an independent ray tracer; a run "
    "that fails its check has no rate.\n\n"
    "Start with [bold]defray doctor[/bold] (does OpenCL work here?), then "
    "[bold]defray trace sponza --rays 64k[/bold].",
)

SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE_OR_FILE", help="A name that 'defray scenes' lists, or a mesh file.")
]
ViewOption = Annotated[str | None, typer.Option(help="Camera of the scene; its first by default.")]
GridOption = Annotated[
    str | None,
    typer.Option(
        metavar="GRID",
        help="'auto': density, wave, growth and batch by a cost model, for the scene, the rays, the device and the "
        "deferred variant, if there is one; or a grid in one text: '8/128 total', 'adaptive density=0.3'.",
    ),
]
RepetitionsOption = Annotated[int, typer.Option(min=1, help="Timed repetitions.")]
CheckOption = Annotated[
    str, typer.Option(help="Compare hits with 'embree' or with 'exact' arithmetic, or 'none' (no check).")
]
TracerOption = Annotated[str, typer.Option(help="deferred, streamed, forward, work-optimal, brute or embree.")]
IntersectorOption = Annotated[
    str | None,
    typer.Option(
        help="Ray/triangle test: ray-space (default), moller-trumbore or another of harness/intersectors.py; embree "
        "has its own."
    ),
]
SettingsOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=VALUE",
        help="Option of the tracer, may be repeated: wave, growth (deferred, streamed), arrange, compaction, pairs, "
        "form (deferred), streams (streamed), exit (forward), lanes, batch, contraction (all on a device), robust, "
        "threads (embree).",
    ),
]
RayFileOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Your own rays instead of --kind: .npz with 'origins' and 'directions' float\\[n,3] and maybe "
        "'t_max' float\\[n], or raw little-endian 6 x float32 a ray; the first --rays of them.",
    ),
]


@app.command()
def doctor(json: JsonOption = False) -> None:
    """Probe every OpenCL device by compiling and running a kernel; says what to do when none works."""
    from harness.doctor import run_doctor

    raise typer.Exit(run_doctor(json=json))


app.add_typer(scenes_app, name="scenes")


@app.command(
    epilog="Examples:  [bold]defray trace sponza --rays 64k[/bold]   "
    "[bold]defray trace dragon.ply --tracer forward --check exact[/bold]   "
    "[bold]defray trace crown --grid auto --json[/bold]"
)
def trace(
    scene: SceneArgument,
    tracer: TracerOption = "deferred",
    intersector: IntersectorOption = None,
    option: SettingsOption = None,
    rays: RaysOption = "1M",
    kind: KindOption = "diffuse",
    seed: SeedOption = 1,
    view: ViewOption = None,
    ray_file: RayFileOption = None,
    top: TopOption = None,
    leaf: LeafOption = None,
    reading: ReadingOption = "total",
    density: DensityOption = None,
    grid: GridOption = None,
    repetitions: RepetitionsOption = 3,
    check: CheckOption = "embree",
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Trace rays through one scene, check the hits and report the rate."""
    from harness.plan import interleaved, make_grid
    from harness.spec import Variant

    for part in option or []:
        if "=" not in part:
            raise DefrayError(f"--option '{part}' is not of the form key=value, as in: --option wave=8")
    text = ":".join(part for part in (tracer, intersector, *(option or [])) if part)
    common = _common(rays, kind, seed, view, repetitions, check)
    if ray_file is not None:
        common |= {"kind": "file", "ray_file": ray_file}
    chosen = make_grid(top, leaf, reading, density, grid)
    specs = list(interleaved(scene, [Variant.parse(text)], [chosen], **common))
    record = _measure(specs, device)[0]
    if json:
        print_json(record)
    else:
        from harness.show import print_table, record_table

        print_table(record_table(record))
    _exit_by_checks([record])


@app.command(
    epilog="Examples:  [bold]defray compare deferred:ray-space forward:moller-trumbore --rays 64k[/bold]   "
    "[bold]defray compare deferred deferred:ray-space:wave=4 embree --scenes sponza,crown[/bold]"
)
def compare(
    variants: Annotated[
        list[str],
        typer.Argument(
            metavar="A B ...", help="Two or more of tracer:intersector[:option=value...]; A is the base."
        ),
    ],
    scenes: Annotated[str, typer.Option(metavar="A,B", help="Scenes or mesh files, with commas.")] = "sponza",
    rays: RaysOption = "1M",
    kind: KindOption = "diffuse",
    seed: SeedOption = 1,
    view: ViewOption = None,
    top: TopOption = None,
    leaf: LeafOption = None,
    reading: ReadingOption = "total",
    density: DensityOption = None,
    grid: GridOption = None,
    repetitions: RepetitionsOption = 5,
    check: CheckOption = "embree",
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Compare variants on the same rays, repetitions interleaved, as ratios with confidence intervals."""
    from harness.compare import comparison, scene_names
    from harness.plan import interleaved, make_grid
    from harness.spec import Variant

    if len(variants) < 2:
        raise DefrayError("compare needs two variants or more, as in: defray compare deferred forward")
    chosen = make_grid(top, leaf, reading, density, grid)
    common = _common(rays, kind, seed, view, repetitions, check)
    parsed = [Variant.parse(text) for text in variants]
    groups = [list(interleaved(name, parsed, [chosen], **common)) for name in scene_names(scenes)]
    if any(len({spec.id for spec in group}) < len(group) for group in groups):
        raise DefrayError("the same variant is named twice")
    results = [comparison(group, _measure(group, device)) for group in groups]
    records = [record for result in results for record in result["records"]]
    if json:
        print_json(results)
    else:
        from harness.show import comparison_table, print_table

        for result in results:
            print_table(comparison_table(result))
    _exit_by_checks(records)


@app.command(
    epilog="Example:  [bold]defray sweep harness/paper/sweeps.toml --tier smoke --out results/out[/bold]"
)
def sweep(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.toml", help="Sweep file; see harness/paper/sweeps.toml.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the records; made if it is not there.")],
    tier: Annotated[
        str, typer.Option(help="Tier of the file to run; the project's own file has smoke, paper and full.")
    ] = "paper",
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a sweep that was stopped; finished runs are kept.")
    ] = False,
    device: DeviceOption = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the order of the runs; drawn and recorded by default.")
    ] = None,
) -> None:
    """Run all measurements of a tier, storing each at once; a stopped sweep goes on with --resume."""
    from harness.sweep import SweepRequest, run_sweep

    raise typer.Exit(run_sweep(SweepRequest(file, tier, out, resume, device, seed)))


@app.command()
def views(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sweep, with its records.jsonl.")],
    device: DeviceOption = None,
) -> None:
    """Render the view of each scene of a sweep by ambient occlusion, for the report."""
    from harness.device import open_device
    from harness.record import RecordFile
    from harness.render import write_views

    records = RecordFile(_records_of(folder)).read()
    # A mesh file is called by its stem in records, and found by its path.
    scenes = {r["scene"]["name"]: r["spec"].get("scene", r["scene"]["name"]) for r in records if r["view"]}
    for file in write_views(folder / "views", scenes, open_device(device)):
        typer.echo(file)


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sweep, with its records.jsonl.")],
    only: Annotated[
        str | None, typer.Option(metavar="FIGURE", help="Redraw one figure or table alone: fig05, or its name.")
    ] = None,
) -> None:
    """Draw figures and tables of a sweep's records, judge the claims, write report.html and report.pdf."""
    from harness.report import redraw, write_report

    _records_of(folder)
    for file in redraw(folder, only) if only else [write_report(folder)]:
        typer.echo(file)


@app.command(epilog="Example:  [bold]defray merge results/mine results/yours --out results/ours[/bold]")
def merge(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR ...", help="Folders with records.jsonl.")],
    out: Annotated[Path, typer.Option(help="New folder for all of their records.")],
) -> None:
    """Put the records of several machines into one folder, whose report shows each of them."""
    from harness.machines import merge as run

    for name, count in run(folders, out).items():
        typer.echo(f"{out / name}: {count} rows")


@app.command()
def migrate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder whose records an older version wrote.")],
) -> None:
    """Bring records of an older schema to this version's; each says that it was."""
    from harness.migrate import migrate as run

    for name, count in run(folder).items():
        typer.echo(f"{folder / name}: {count} migrated")


app.command(
    epilog="Examples:  [bold]defray stability[/bold]   [bold]defray stability --intersector all --family W2[/bold]"
)(stability)
accuracy_command.register(app)
roofline_command.register(app)
coherence_command.register(app)
claims_command.register(app)


def _records_of(folder: Path) -> Path:
    """The records of a sweep's folder; raises DefrayError where there are none."""
    file = folder / "records.jsonl"
    if not file.is_file():
        raise DefrayError(f"{folder} has no records.jsonl; run a sweep first: defray sweep FILE --out {folder}")
    return file


def _common(rays: str, kind: str, seed: int, view: str | None, repetitions: int, check: str) -> dict:
    """Checked fields that all runs of one command share."""
    from harness.errors import known
    from harness.plan import parse_count

    checks = ("embree", "exact", "none")
    if check not in checks:
        raise known("check", check, checks)
    count = parse_count(rays)
    return {
        "rays": count,
        "kind": kind,
        "seed": seed,
        "view": view,
        "repetitions": repetitions,
        "check": check,
    }


def _measure(specs: list, device_part: str | None) -> list[dict]:
    """Finished records of one group, in the order of `specs`; progress goes to standard error."""
    from rich.console import Console
    from rich.markup import escape

    from harness import tracers
    from harness.device import open_device
    from harness.ladder import announcements
    from harness.pipeline import run_group
    from harness.progress import run_name
    from harness.record import finish
    from harness.scene import expected_triangles

    console = Console(stderr=True)
    done = {}
    needed = any(tracers.find(spec.variant.tracer).needs_device for spec in specs)
    device = open_device(device_part) if needed else None
    for line in announcements([(specs[0].scene, expected_triangles(specs[0].scene))]):
        console.print(line, highlight=False, soft_wrap=True, markup=False)
    with console.status("starting") as status:

        def progress(step) -> None:
            what = run_name(step.spec) if step.spec else specs[0].scene
            status.update(f"{escape(what)}: {escape(step.stage)} ({step.done:.0%})")

        for spec, body in run_group(specs, device, progress):
            done[spec.id] = finish(body, spec, device)
    return [done[spec.id] for spec in specs]


def _exit_by_checks(records: list[dict]) -> None:
    """Exit 1, with a line on standard error, when a check failed."""
    failed = [r for r in records if not r["valid"] and r["agreement"]["reference"] != "none"]
    if failed:
        from harness.progress import disagreement

        for record in failed:
            name = f"{record['scene']['name']} {record['tracer']}:{record['intersector'] or ''}".rstrip(":")
            _print_error(f"check failed: {name}: {disagreement(record['agreement'])}; no rate is reported")
        raise typer.Exit(1)


def _print_error(message: str) -> None:
    red, plain = (
        ("\033[31m", "\033[0m") if sys.stderr.isatty() and not os.environ.get("NO_COLOR") else ("", "")
    )
    print(f"{red}error:{plain} {message}", file=sys.stderr)


def main() -> None:
    """Entry point of `defray`: errors become one line on standard error and a non-zero exit code."""
    try:
        sys.exit(app(prog_name="defray", standalone_mode=False))
    except DefrayError as error:
        _print_error(str(error))
        sys.exit(error.exit_code)
    except UsageError as error:
        where = error.ctx.command_path if error.ctx else "defray"
        _print_error(f"{error.format_message()} ('{where} --help' explains)")
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(130)
    except MemoryError:
        _print_error("not enough memory; take fewer rays, a smaller scene or a coarser grid")
        sys.exit(2)
    except Exception as error:
        if os.environ.get("DEFRAY_TRACEBACK"):
            raise
        text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        if isinstance(error, OSError) and error.filename:
            _print_error(f"cannot use {error.filename}: {error.strerror}")
        else:
            _print_error(f"{text} (a fault in defray; DEFRAY_TRACEBACK=1 shows where)")
        sys.exit(2)


if __name__ == "__main__":
    main()
