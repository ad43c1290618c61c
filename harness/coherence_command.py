"""`defray coherence`: how well rays share vectors, forward and deferred, whatever the device."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

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
)

WIDTHS = (8, 32)


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
    top: TopOption = None,
    leaf: LeafOption = None,
    reading: ReadingOption = "total",
    density: DensityOption = None,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Count lanes at work, cache lines and disagreement of groups of 8 and 32 rays, exactly.

    The counts come from the real cell sequences of the rays and are the same on every device.
    They are compared with those of the tracers before they are stored.
    """
    from harness.coherence_rows import coherence_file
    from harness.plan import make_grid, parse_count
    from harness.row_commands import measured_rows, scene_specs, show_rows
    from harness.spec import Variant

    variants = [Variant.parse(f"forward:{intersector}"), Variant.parse(f"deferred:{intersector}:wave={wave}")]
    common = {"rays": parse_count(rays), "kind": kind, "seed": seed}
    groups = scene_specs(scenes, variants, make_grid(top, leaf, reading, density), **common)
    rows = measured_rows(groups, device, out, coherence_file,
                         lambda specs, opened, _: [measure_coherence(specs, wave, opened)])
    show_rows(rows, json, print_counts)


def measure_coherence(specs: list, wave: int, device) -> dict:
    """The row of one scene, still without command, time and machine; `specs`: the forward run and the deferred one.

    Raises DefrayError where the sequences do not make the tracers' own counts.
    """
    from harness.accuracy_rows import identity
    from harness.coherence import deferred_coherence, forward_coherence, lists_of, record_sequences
    from harness.coherence_rows import SCHEMA
    from harness.measure import Group, scene_facts

    group = Group(specs, device, lambda _: None)
    forward, deferred = map(group.open_run, specs)
    intersector, setting = forward.tracer.intersector, group.setting
    lists = lists_of(setting.grid, intersector.bytes)
    counts = []
    for run, length in ((forward, 1), (deferred, wave)):
        sequences = record_sequences(setting, intersector, group.rays, length)
        compare_counts(sequences, lists, run.tracer.count(group.rays), str(run.spec.variant))
        for lanes in WIDTHS:
            if run is forward:
                counts.append(forward_coherence(sequences, lists, lanes))
            else:
                counts += deferred_coherence(sequences, lists, lanes)
    spec = dataclasses.asdict(specs[0].grid)
    facts = {"scene": specs[0].scene, "rays": len(group.rays), "kind": group.rays.kind, "seed": group.rays.seed}
    return {
        "schema": SCHEMA,
        "id": identity(**facts, grid=spec, wave=wave, intersector=intersector.name, what="coherence"),
        "scene": scene_facts(group.shared.scene),
        "intersector": intersector.name,
        "wave": wave,
        "grid": setting.grid.describe(),
        "rays": {"kind": group.rays.kind, "count": len(group.rays), "seed": group.rays.seed},
        "counts": [one.as_dict() for one in counts],
    }


def compare_counts(sequences, lists, counters, variant: str) -> None:
    """Raise DefrayError unless the sequences make exactly the steps, pairs and tests that the tracer counted."""
    from harness.errors import DefrayError

    met = sequences.cell[sequences.cell >= 0]
    ours = {"steps": len(sequences.cell), "pairs": len(met), "tests": int(lists.sizes[met].sum())}
    for name, value in ours.items():
        counted = getattr(counters, name)
        if value != counted:
            raise DefrayError(f"the sequences of {variant} make {value:,} {name}, but the tracer counts {counted:,}")


def print_counts(row: dict) -> None:
    """Counts of one row and what they predict, on standard output."""
    from rich.console import Console
    from rich.table import Table

    from harness.coherence import Coherence, predicted_ratios

    counts = [Coherence(**one) for one in row["counts"]]
    table = Table(title=f"{row['scene']['name']}, {row['rays']['count']:,} rays, wave {row['wave']}")
    for name in ("lanes", "tracer", "tests a ray", "trips a ray", "testing", "walking", "uneven",
                 "64 B lines", "128 B lines"):
        table.add_column(name, justify="left" if name == "tracer" else "right")
    rays = row["rays"]["count"]
    for one in sorted(counts, key=lambda c: c.lanes):
        table.add_row(str(one.lanes), one.model, f"{one.tests / rays:.1f}", f"{one.test_trips / rays:.2f}",
                      f"{one.test_efficiency:.0%}", f"{one.walk_efficiency:.0%}", f"{one.uneven_share:.0%}",
                      f"{one.lines_a_trip(64):.2f}", f"{one.lines_a_trip(128):.2f}")
    console = Console(width=118, highlight=False)
    console.print(table)
    for lanes in WIDTHS:
        for model, ratios in predicted_ratios(counts, lanes).items():
            console.print(f"{lanes} lanes, forward over {model}: {ratios['trips']:.2f} times the trips of the tests, "
                          f"{ratios['lines']:.2f} times the 64-byte lines")


def register(app: typer.Typer) -> None:
    """Add the command to `defray`."""
    app.command(
        epilog="Example:  [bold]defray coherence sponza --rays 64k --out results/mine[/bold]"
    )(coherence)
