"""What the figures of kernels share: their names for people, and rows of roofline.jsonl as a table."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import label_of
from harness.analysis.results import Results
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


def grid_name(grid: dict | None) -> str:
    """`8/128 total` or `adaptive, density 0.3` of a row's grid."""
    if not grid:
        return "no grid"
    if grid["reading"] == "adaptive":
        return f"adaptive, density {grid['density']:g}"
    return f"{grid['top']}/{grid['leaf']} {grid['reading']}"


def kernel_title(name: str) -> str:
    """A kernel for people; another's name as words."""
    return TITLES.get(name, name.replace("_", " "))


def place_of(runs: Results, row: dict) -> tuple:
    """Order of a row: scene as in the paper, uniform grids before adaptive ones, deferred before the others."""
    tracers = list(style.TRACER_COLOURS)
    tracer = tracers.index(row["tracer"]) if row.get("tracer") in tracers else len(tracers)
    grid = row["grid"] or {}
    return (
        runs.scene_place(row["scene"]["name"]),
        row["scene"]["name"],
        grid.get("reading") == "adaptive",
        grid_name(row["grid"]),
        tracer,
        row.get("intersector") != "ray-space",
        row.get("variant", ""),
    )


def kernel_table(runs: Results) -> pd.DataFrame:
    """One row a kernel, variant, scene and grid: nanoseconds a ray, Gflop/s, GB/s and the ceilings in those units."""
    rows = []
    # Of a variant measured with several numbers of rays, the most.
    by_rays = sorted(runs.roofline, key=lambda one: one["rays"]["count"])
    kept = {(row["scene"]["sha256"], grid_name(row["grid"]), row["variant"]): row for row in by_rays}
    for row in sorted(kept.values(), key=lambda one: place_of(runs, one)):
        count = row["rays"]["count"]
        shared = {
            "scene": runs.title_of(row["scene"]),
            "grid": grid_name(row["grid"]),
            "variant": label_of(row),
            "tracer": row["tracer"],
            "intersector": intersector_name(row["intersector"]),
        }
        ceilings = {
            f"{name}_ceiling": row["ceilings"][name]["rate"]["median"] / 1e9 for name in ("memory", "cache", "fma")
        }
        for kernel in row["kernels"]:
            rows.append({**shared, **_kernel(kernel, count), **ceilings, "rays": count, "runs": row["id"]})
    return pd.DataFrame(rows)


def _kernel(kernel: dict, rays: int) -> dict:
    time, found = kernel["nanoseconds"], {}
    stated = kernel["bytes"] is not None
    for name in ("flops", "executed_flops", "bytes", "uncached_bytes"):
        found[f"{name}_per_ray"] = kernel[name] / rays if stated else None
    rates = {
        "gflop_per_s": "flops",
        "executed_gflop_per_s": "executed_flops",
        "gb_per_s": "bytes",
        "uncached_gb_per_s": "uncached_bytes",
    }
    for name, what in rates.items():
        found[name] = kernel[what] / rays / time["median"] if stated and time["median"] else None
    return {
        "kernel": kernel_title(kernel["name"]),
        "stage": kernel["stage"],
        "ns": time["median"],
        "ns_low": time["low"],
        "ns_high": time["high"],
        **found,
    }
