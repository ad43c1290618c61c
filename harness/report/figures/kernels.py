"""What the figures of kernels share: their names for people, and rows of roofline.jsonl as a table."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import variant_text
from harness.analysis.results import Results
from harness.records.coherence_row import CoherenceRow
from harness.records.roofline_row import KernelRow, RooflineRow
from harness.records.schema import GridFacts
from harness.report.figures import style
from harness.report.figures.contenders import intersector_name

TITLES = {
    "start_rays": "start",
    "start_rays_without_grid": "start",
    "count_pairs": "walk and count",
    "pack_pairs": "walk and pack",
    "record_pairs": "walk",
    "rank_pairs": "rank",
    "lay_out_bins": "lay out bins",
    "count_chunks": "count chunks",
    "lay_out_blocks": "lay out bins",
    "keep_in_blocks": "compact",
    "join_blocks": "compact, join",
    "scatter_pairs": "scatter",
    "intersect_bins": "intersect",
    "trace_forward": "forward",
    "trace_stream": "streamed",
    "intersect_visited": "work-optimal",
    "write_hits": "write hits",
}


def grid_name(grid: GridFacts | None) -> str:
    """`8/128 total` or `adaptive, density 0.3` of a row's grid."""
    if not grid:
        return "no grid"
    if grid.reading == "adaptive":
        return f"adaptive, density {grid.density:g}"
    return f"{grid.top}/{grid.leaf} {grid.reading}"


def kernel_title(name: str) -> str:
    """A kernel for people; another's name as words."""
    return TITLES.get(name, name.replace("_", " "))


def place_of(runs: Results, row: CoherenceRow | RooflineRow) -> tuple:
    """Order of a row: scene as in the paper, uniform grids before adaptive ones, deferred before the others."""
    tracers = list(style.TRACER_COLOURS)
    tracer = row.tracer if isinstance(row, RooflineRow) else ""
    return (
        runs.scene_place(row.scene.name),
        row.scene.name,
        row.grid is not None and row.grid.reading == "adaptive",
        grid_name(row.grid),
        tracers.index(tracer) if tracer in tracers else len(tracers),
        row.intersector != "ray-space",
        row.variant if isinstance(row, RooflineRow) else "",
    )


def kernel_table(runs: Results) -> pd.DataFrame:
    """One row a kernel, variant, scene and grid: nanoseconds a ray, Gflop/s, GB/s and the ceilings in those units."""
    rows = []
    # Of a variant measured with several numbers of rays, the most.
    by_rays = sorted(runs.roofline, key=lambda one: one.rays.count)
    kept = {(row.scene.sha256, grid_name(row.grid), row.variant): row for row in by_rays}
    for row in sorted(kept.values(), key=lambda one: place_of(runs, one)):
        count = row.rays.count
        shared = {
            "scene": runs.title_of(row.scene),
            "grid": grid_name(row.grid),
            "variant": variant_text(row),
            "tracer": row.tracer,
            "intersector": intersector_name(row.intersector),
        }
        ceilings = {
            f"{name}_ceiling": getattr(row.ceilings, name).rate.median / 1e9 for name in ("memory", "cache", "fma")
        }
        for kernel in row.kernels:
            rows.append({**shared, **_kernel(kernel, count), **ceilings, "rays": count, "runs": row.id})
    return pd.DataFrame(rows)


def _kernel(kernel: KernelRow, rays: int) -> dict:
    time, found = kernel.nanoseconds, {}
    for name in ("flops", "executed_flops", "bytes", "uncached_bytes"):
        found[f"{name}_per_ray"] = getattr(kernel, name) / rays if kernel.is_stated else None
    rates = {
        "gflop_per_s": "flops",
        "executed_gflop_per_s": "executed_flops",
        "gb_per_s": "bytes",
        "uncached_gb_per_s": "uncached_bytes",
    }
    for name, what in rates.items():
        is_known = kernel.is_stated and time.median
        found[name] = getattr(kernel, what) / rays / time.median if is_known else None
    return {
        "kernel": kernel_title(kernel.name),
        "stage": kernel.stage,
        "ns": time.median,
        "ns_low": time.low,
        "ns_high": time.high,
        **found,
    }
