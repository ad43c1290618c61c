"""Tables for the terminal: scenes, one record, a comparison."""

from __future__ import annotations

from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

CLASSES = ("same", "tie", "t_off", "wrong", "missed", "phantom")


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
    yield "rays", f"{rays['count']:,} {rays['kind']}, seed {rays['seed']}"
    if grid:
        yield (
            "grid",
            (
                f"{grid['top']}/{grid['leaf']} {grid['reading']}: {grid['nonempty']:,} of {grid['cells']:,} "
                f"cells in use, {grid['references']:,} references, {grid['bytes'] / 2**20:.1f} MiB, "
                f"built in {grid['build_seconds']:.2f} s"
            ),
        )
    options = " ".join(f"{key}={value}" for key, value in record["options"].items())
    tracer = ":".join(part for part in (record["tracer"], record["intersector"]) if part)
    yield "tracer", escape(f"{tracer} {options}".strip())
    yield "device", escape(f"{record['machine']['device']}, {record['machine']['platform']}")
    yield "agreement", agreement_text(record["agreement"])
    per_ray = {key: record["counters"][key] / rays["count"] for key in ("steps", "pairs", "tests")}
    yield "a ray", ", ".join(f"{value:.1f} {key}" for key, value in per_ray.items())
    for stage in ("traverse", "intersect", "total"):
        if record["rate"][stage]:
            yield stage, rate_text(record["rate"][stage])
    if not record["valid"]:
        yield "total", "[red]check failed: no rate[/red]"


def agreement_text(agreement: dict) -> str:
    """Counts of all classes against the reference."""
    if agreement["reference"] == "none":
        return "[yellow]not checked[/yellow]"
    counts = [f"{agreement[key]:,} {key.replace('_', '-')}" for key in CLASSES if agreement[key]]
    return f"{', '.join(counts)} (against {escape(agreement['reference'])})"


def comparison_table(result: dict) -> Table:
    """Table of `compare.comparison`."""
    title = f"{result['scene']['name']}, {result['rays']['count']:,} {result['rays']['kind']} rays"
    title += f", grid {result['grid']}" if result["grid"] else ""
    table = Table(
        "variant",
        "rate (95 % interval)",
        "ratio (95 % interval)",
        "p",
        "tests a ray",
        "agreement",
        title=escape(title),
        box=None,
        title_justify="left",
    )
    for row, record in zip(result["rows"], result["records"], strict=True):
        ratio, p_value = row["ratio"], row["p_value"]
        if row["variant"] == result["base"]:
            ratio_text = "1 (base)" if row["valid"] else "–"
        else:
            ratio_text = (
                f"{ratio['median']:.3g} ({ratio['low']:.3g} to {ratio['high']:.3g})" if ratio else "–"
            )
        table.add_row(
            escape(row["variant"]),
            rate_text(row["rate"]) if row["valid"] else "[red]check failed[/red]",
            ratio_text,
            f"{p_value:.3f}" if p_value is not None else "",
            f"{row['tests_per_ray']:.1f}",
            agreement_text(record["agreement"]),
        )
    return table
