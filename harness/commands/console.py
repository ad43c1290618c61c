"""Tables for the terminal: scenes, one record, a comparison."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rich.console import Console, Group
from rich.markup import escape
from rich.table import Table

from harness.data import CLASSES


def print_table(table: Table) -> None:
    """On standard output; a pipe has no width of its own, and folded columns would make the table useless there."""
    Console(width=None if sys.stdout.isatty() else 140).print(table)


def rate_text(rate: dict | None) -> str:
    """`2.31 Mrays/s (2.28 to 2.35)`, or a dash."""
    if rate is None:
        return "–"
    low, high = rate["low"] / 1e6, rate["high"] / 1e6
    return f"{rate['median'] / 1e6:.3g} Mrays/s ({low:.3g} to {high:.3g})"


def scene_table(statuses: Sequence) -> Table:
    """Table of `scene.list_scenes()`."""
    table = Table("scene", "in the paper", "triangles", "source", "from", "licence", box=None)
    for status in statuses:
        triangles = f"{status.triangles:,}" if status.triangles else "–"
        paper = "yes" if status.paper else ""
        cells = (status.name, paper, triangles, status.source, status.origin, status.licence)
        table.add_row(*(escape(str(cell or "")) for cell in cells))
    return table


def record_table(record: dict) -> Table:
    """Short table of one run."""
    table = Table.grid(padding=(0, 2))
    for name, value in _record_rows(record):
        table.add_row(f"[bold]{name}[/bold]", value)
    return table


def _record_rows(record: dict):
    scene, rays, grid = record["scene"], record["rays"], record["grid"]
    stand_in = " [yellow](stand-in)[/yellow]" if scene["source"] == "stand-in" else ""
    yield "scene", f"{escape(scene['name'])}{stand_in}, {scene['triangles']:,} triangles"
    if record.get("view") and scene.get("views"):
        yield "view", escape(f"{record['view']} ({scene['views']})")
    share = "" if record["hits"] is None else f", {record['hits'] / rays['count']:.1%} hit"
    yield "rays", f"{rays['count']:,} {rays['kind']}, seed {rays['seed']}{share}"
    if grid:
        yield (
            "grid",
            (
                f"{grid['top']}/{grid['leaf']} {grid['reading']}: {grid['nonempty']:,} of {grid['cells']:,} "
                f"cells in use, {grid['references']:,} references, {grid['bytes'] / 2**20:.1f} MiB, "
                f"built in {grid['build_seconds']:.2f} s"
            ),
        )
        if grid.get("chosen"):
            yield "chosen", f"{escape(grid['chosen'])}; chosen in {1e3 * grid['choosing_seconds']:.0f} ms"
    options = " ".join(f"{key}={value}" for key, value in record["options"].items())
    tracer = ":".join(part for part in (record["tracer"], record["intersector"]) if part)
    yield "tracer", escape(f"{tracer} {options}".strip())
    machine = record["machine"]
    yield "device", escape(f"{machine['device']}, {machine['platform']}" if machine["device"] else machine["cpu"])
    yield "agreement", agreement_text(record["agreement"])
    per_ray = {key: record["counters"][key] / rays["count"] for key in ("steps", "pairs", "tests")}
    if any(per_ray.values()):
        yield "a ray", ", ".join(f"{value:.1f} {key}" for key, value in per_ray.items())
    for stage in ("traverse", "intersect", "total"):
        if record["rate"][stage]:
            yield stage, rate_text(record["rate"][stage])
    if not record["hits"]:
        yield "", "[yellow]no ray hits anything[/yellow]"
    if not record["valid"]:
        yield "total", no_rate(record)


def no_rate(record: dict) -> str:
    """Why a record has no rate."""
    unchecked = record["agreement"]["reference"] == "none"
    return "[yellow]not checked, hence no rate[/yellow]" if unchecked else "[red]check failed: no rate[/red]"


def agreement_text(agreement: dict) -> str:
    """Counts of all classes against the reference."""
    if agreement["reference"] == "none":
        return "[yellow]not checked[/yellow]"
    return f"{class_counts(agreement)} (against {escape(agreement['reference'])})"


def class_counts(agreement: dict) -> str:
    """`63,994 same, 6 tie`: the classes that have any ray."""
    return ", ".join(f"{agreement[key]:,} {key.replace('_', '-')}" for key in CLASSES if agreement[key]) or "–"


def interval_text(values: dict, unit: float = 1.0) -> str:
    """`2.31 (2.28–2.35)` of `{median, low, high}`, each over `unit`."""
    return f"{values['median'] / unit:.3g} ({values['low'] / unit:.3g}–{values['high'] / unit:.3g})"


def comparison_table(result: dict) -> Table:
    """Table of `compare.comparison`."""
    reference = result["records"][0]["agreement"]["reference"]
    title = f"{result['scene']['name']}, {result['rays']['count']:,} {result['rays']['kind']} rays"
    title += f", grid {result['grid']}" if result["grid"] else ""
    title += f"; median and 95 % interval; checked against {reference}"
    table = Table(title=escape(title), box=None, title_justify="left")
    for name in ("variant", "Mrays/s", "ratio", "p", "tests a ray", "agreement"):
        table.add_column(name, overflow="fold")
    chosen = next((r["grid"]["chosen"] for r in result["records"] if r["grid"] and r["grid"].get("chosen")), None)
    table.caption, table.caption_justify = chosen and escape(f"grid chosen: {chosen}"), "left"
    for row, record in zip(result["rows"], result["records"], strict=True):
        ratio = "1 (base)" if row["valid"] and row["variant"] == result["base"] else "–"
        table.add_row(
            escape(row["variant"]),
            interval_text(row["rate"], 1e6) if row["rate"] else no_rate(record),
            interval_text(row["ratio"]) if row["ratio"] else ratio,
            f"{row['p_value']:.3f}" if row["p_value"] is not None else "",
            f"{row['tests_per_ray']:.1f}" if row["tests_per_ray"] else "–",
            class_counts(record["agreement"]),
        )
    return table


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
        table.add_row(figure.name, _number(figure.real), _number(figure.stand_in), f"{figure.ratio:.2f}", mark)
    return Group(f"[bold]{calibration.scene}[/bold]: {origin}", table, "")


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


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
