"""`defray accuracy`: chart speed against accuracy, rate, leaks and errors of many variants."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from harness.campaign.executors import Local
from harness.campaign.runner import run
from harness.campaign.tasks import accuracy_scenes, accuracy_tasks, precision_tasks
from harness.commands.options import DeviceOption, JsonOption, ResumeOption, again, print_json
from harness.device.opened import open_device
from harness.studies.errors_and_leaks import parse_contenders

VariantsOption = Annotated[
    str | None,
    typer.Option(
        metavar="A,B,...",
        help="tracer:intersector[:option=value...], also overlap=padded, closed, open or box (the test "
        "that fills the grid). By default every intersector in the deferred tracer, contraction off and on, every "
        "overlap test, forward, and Embree; with --tier, the tier's.",
    ),
]
EPILOG = (
    "Examples:  [bold]defray accuracy sponza --rays 20k --aimed 100k[/bold]   "
    "[bold]defray accuracy sponza crown --variants deferred:ray-space,embree --out results/mine[/bold]"
)


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
    resume: ResumeOption = False,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Chart speed against accuracy: rate, leaks of aimed rays and errors of t for many variants of tracers.

    The variants of a scene are timed in turns; each is stored once all are timed and its own errors are known.
    What is interrupted before goes on with --resume from the start of that scene.
    A variant that fails costs no other its row; it is told in errors.jsonl, and the exit code is 1.
    """
    chosen = accuracy_scenes(scenes or [], tier, rays, aimed, repetitions)
    given = {} if variants is None else {"contenders": parse_contenders(variants)}
    given |= {"precision": True} if precision else {}
    chosen = [replace(one, **given) for one in chosen]
    executor = Local(open_device(device))
    found = run(accuracy_tasks(chosen, executor.device), executor, out, resume, again())
    code = found.code
    more = precision_tasks(chosen)
    if more and not found.stopped:
        # Its rows do not stand in the way of those that are missing: a stopped one goes on.
        code = run(more, executor, out, True, again()).code or code
    if json:
        print_json([row.as_json() for row in found.rows])
    raise typer.Exit(code)
