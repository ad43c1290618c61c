"""Tables for the terminal: scenes, one record, what stand-ins are like."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rich.console import Console, Group
from rich.markup import escape
from rich.table import Table

from harness.analysis.names import grid_text, three_digits
from harness.data import CLASSES
from harness.records.agreement import Agreement
from harness.records.run_row import Record
from harness.stats import Interval, megarays


def print_table(table: Table) -> None:
    """On standard output; a pipe has no width of its own, and folded columns would make the table useless there."""
    Console(width=None if sys.stdout.isatty() else 140).print(table)


def rate_text(rate: Interval) -> str:
    """`2.31 Mrays/s (2.28 to 2.35)`."""
    low, high = megarays(rate.low), megarays(rate.high)
    return f"{megarays(rate.median):.3g} Mrays/s ({low:.3g} to {high:.3g})"


def scene_table(statuses: Sequence) -> Table:
    """Table of `scene.list_scenes()`."""
    table = Table("scene", "in the paper", "triangles", "source", "from", "licence", box=None)
    for status in statuses:
        triangles = f"{status.triangles:,}" if status.triangles else "–"
        paper = "yes" if status.paper else ""
        cells = (status.name, paper, triangles, status.source, status.origin, status.licence)
        table.add_row(*(escape(str(cell or "")) for cell in cells))
    return table


def record_table(record: Record) -> Table:
    """Short table of one run."""
    table = Table.grid(padding=(0, 2))
    for name, value in (*_given_rows(record), *_found_rows(record)):
        table.add_row(f"[bold]{name}[/bold]", value)
    return table


def _given_rows(record: Record):
    """Scene, rays, structure, tracer and device."""
    scene, rays, grid = record.scene, record.rays, record.grid
    stand_in = " [yellow](stand-in)[/yellow]" if scene.is_stand_in else ""
    yield "scene", f"{escape(scene.name)}{stand_in}, {scene.triangles:,} triangles"
    if record.view and scene.views:
        yield "view", escape(f"{record.view} ({scene.views})")
    share = "" if record.hits is None else f", {record.hits / rays.count:.1%} hit"
    yield "rays", f"{rays.count:,} {rays.kind}, seed {rays.seed}{share}"
    if grid:
        yield (
            "grid",
            (
                f"{escape(grid_text(grid))}: {grid.nonempty:,} of {grid.cells:,} "
                f"cells in use, {grid.references:,} references, {grid.bytes / 2**20:.1f} MiB, "
                f"built in {grid.build_seconds:.2f} s"
            ),
        )
        if grid.chosen:
            yield "chosen", f"{escape(grid.chosen)}; chosen in {1e3 * grid.choosing_seconds:.0f} ms"
    options = " ".join(f"{key}={value}" for key, value in record.options.items())
    tracer = ":".join(part for part in (record.tracer, record.intersector) if part)
    yield "tracer", escape(f"{tracer} {options}".strip())
    machine = record.machine
    yield "device", escape(f"{machine.device}, {machine.platform}" if machine.device else machine.cpu)


def _found_rows(record: Record):
    """Agreement, work and rates."""
    yield "agreement", agreement_text(record.agreement)
    per_ray = {key: getattr(record.counters, key) / record.rays.count for key in ("steps", "pairs", "tests")}
    if any(per_ray.values()):
        yield "a ray", ", ".join(f"{value:.1f} {key}" for key, value in per_ray.items())
    for stage in ("traverse", "intersect", "total"):
        rate = getattr(record.rate, stage)
        if rate:
            yield stage, rate_text(rate)
    if not record.hits:
        yield "", "[yellow]no ray hits anything[/yellow]"
    if not record.valid:
        yield "total", no_rate(record)


def no_rate(record: Record) -> str:
    """Why a record has no rate."""
    return "[red]check failed: no rate[/red]" if record.failed else "[yellow]not checked, hence no rate[/yellow]"


def agreement_text(agreement: Agreement) -> str:
    """Counts of all classes against the reference."""
    if not agreement.is_checked:
        return "[yellow]not checked[/yellow]"
    return f"{class_counts(agreement)} (against {escape(agreement.reference)})"


def class_counts(agreement: Agreement) -> str:
    """`63,994 same, 6 tie`: the classes that have any ray."""
    counts = {name: getattr(agreement, name) for name in CLASSES}
    return ", ".join(f"{count:,} {name.replace('_', '-')}" for name, count in counts.items() if count) or "–"


def measured_tables(results: Sequence) -> list:
    """One table for each calibration, or one for all costs."""
    if all(hasattr(result, "figures") for result in results):
        return [calibration_table(result) for result in results]
    return [footprint_table(results)]


def calibration_table(calibration) -> Group:
    """Table of a `calibration.Calibration`: every figure of real scene and stand-in, and their ratio."""
    origin = {
        "measured": "the real scene measured now",
        "stored": "the real scene's figures as stored; its files are not here",
        "described": "no real file: design targets from its description",
    }[calibration.source]
    table = Table("figure", box=None)
    for name in ("real", "stand-in", "ratio", ""):
        table.add_column(name, justify="right" if name else "left")
    for figure in calibration.figures:
        mark = "" if figure.inside else "[red]outside[/red]"
        table.add_row(
            figure.name, three_digits(figure.real), three_digits(figure.stand_in), f"{figure.ratio:.2f}", mark
        )
    return Group(f"[bold]{calibration.scene}[/bold]: {origin}", table, "")


def footprint_table(footprints: Sequence) -> Table:
    """Table of `cost.footprints`."""
    table = Table("scene", "step", box=None)
    for name in ("triangles", "seconds", "CPU seconds", "peak GiB", ""):
        table.add_column(name, justify="right" if name else "left")
    for cost in footprints:
        mark = "" if cost.inside else "[red]too much[/red]"
        peak = f"{cost.peak_bytes / 2**30:.2f}"
        seconds = f"{cost.seconds:.2f}", f"{cost.cpu_seconds:.2f}"
        table.add_row(cost.scene, cost.step, f"{cost.triangles:,}", *seconds, peak, mark)
    return table
