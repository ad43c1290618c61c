"""`defray coherence`: count lanes at work and cache lines of groups of rays, forward and deferred, exactly."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from harness.campaign.executors import Local
from harness.campaign.runner import run
from harness.campaign.tasks import coherence_tasks
from harness.commands.options import (
    DeviceOption,
    JsonOption,
    KindOption,
    RaysOption,
    ResumeOption,
    SeedOption,
    StructureOption,
    again,
    show_rows,
)
from harness.device.opened import open_device
from harness.records.coherence_row import CoherenceBody, predicted_ratios
from harness.studies.lanes_and_lines import WIDTHS

EPILOG = "Example:  [bold]defray coherence sponza --rays 64k --out results/mine[/bold]"


def coherence(
    scenes: Annotated[list[str], typer.Argument(metavar="SCENE ...", help="Scenes or mesh files.")],
    out: Annotated[Path, typer.Option(help="Folder for coherence.jsonl; made if it is not there.")] = Path(
        "results/out"
    ),
    intersector: Annotated[str, typer.Option(help="Ray/triangle test that decides where rays halt.")] = "ray-space",
    wave: Annotated[int, typer.Option(min=1, help="Non-empty cells a ray in a wave of the deferred tracer.")] = 4,
    rays: RaysOption = "64k",
    kind: KindOption = "diffuse",
    seed: SeedOption = 1,
    structure: StructureOption = "8/128",
    resume: ResumeOption = False,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Count lanes at work, cache lines and disagreement of groups of 8 and 32 rays, exactly.

    The counts come from the real cell sequences of the rays and are the same on every device.
    They are compared with those of the tracers before they are stored.
    """
    tasks = coherence_tasks(scenes, intersector, wave, rays, kind, seed, structure)
    found = run(tasks, Local(open_device(device)), out, resume, again())
    show_rows(found.rows, json, print_counts)
    raise typer.Exit(found.code)


def print_counts(row: CoherenceBody) -> None:
    """Counts of one row and what they predict, on standard output."""
    counts, rays = row.counts, row.rays.count
    table = Table(title=f"{row.scene.name}, {rays:,} rays, wave {row.wave}")
    for name in (
        "lanes",
        "tracer",
        "tests a ray",
        "trips a ray",
        "testing",
        "walking",
        "uneven",
        "64 B lines",
        "128 B lines",
    ):
        table.add_column(name, justify="left" if name == "tracer" else "right")
    for one in sorted(counts, key=lambda c: c.lanes):
        table.add_row(
            str(one.lanes),
            one.model,
            f"{one.tests / rays:.1f}",
            f"{one.test_trips / rays:.2f}",
            f"{one.test_efficiency:.0%}",
            f"{one.walk_efficiency:.0%}",
            f"{one.uneven_share:.0%}",
            f"{one.lines_a_trip(64):.2f}",
            f"{one.lines_a_trip(128):.2f}",
        )
    console = Console(width=118, highlight=False)
    console.print(table)
    for lanes in WIDTHS:
        for model, ratios in predicted_ratios(counts, lanes).items():
            console.print(
                f"{lanes} lanes, forward over {model}: {ratios['trips']:.2f} times the trips of the tests, "
                f"{ratios['lines']:.2f} times the 64-byte lines"
            )
