"""What the figures of kernels share: their names for people, and rows of roofline.jsonl as a table."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import grid_text, variant_text
from harness.analysis.results import Results
from harness.records.coherence_row import CoherenceRow
from harness.records.roofline_row import KernelRow, RooflineRow
from harness.records.schema import GridFacts
from harness.report.figures.contenders import intersector_name
from harness.spec.tracer_facts import listed_tracers, tracer_place

# Kernels that all tracers of a device launch; each tracer's own are among its facts.
SHARED_KERNELS = {"start_rays": "start", "start_rays_without_grid": "start", "write_hits": "write hits"}


def grid_name(grid: GridFacts | None) -> str:
    """`8/128 total` or `adaptive, density 0.3` of a row's grid; of another structure, its name and options."""
    if not grid:
        return "no grid"
    if grid.density is not None:
        return f"{grid.reading}, density {grid.density:g}"
    return grid_text(grid)


def kernel_title(name: str) -> str:
    """A kernel for people; one that no tracer states, its name as words."""
    titles = [one.facts.kernels[name] for one in listed_tracers().values() if name in one.facts.kernels]
    return next(iter(titles), SHARED_KERNELS.get(name, name.replace("_", " ")))


def testing_kernels() -> set[str]:
    """The kernels that test triangles, for people."""
    listed = listed_tracers().values()
    return {kernel_title(name) for one in listed for name in one.facts.test_kernels}


def row_place(runs: Results, row: CoherenceRow | RooflineRow) -> tuple:
    """Order of a row: scene as in the paper, uniform grids before adaptive ones, deferred before the others."""
    return (
        runs.scene_place(row.scene.name),
        row.scene.name,
        row.grid is not None and row.grid.reading == "adaptive",
        grid_name(row.grid),
        tracer_place(row.tracer if isinstance(row, RooflineRow) else ""),
        row.intersector != "ray-space",
        row.variant if isinstance(row, RooflineRow) else "",
    )


def kernel_table(runs: Results) -> pd.DataFrame:
    """One row a kernel, variant, scene and grid: nanoseconds a ray, Gflop/s, GB/s and the ceilings in those units."""
    rows = []
    # Of a variant measured with several numbers of rays, the most.
    by_rays = sorted(runs.roofline, key=lambda one: one.rays.count)
    kept = {(row.scene.sha256, grid_name(row.grid), row.variant): row for row in by_rays}
    for row in sorted(kept.values(), key=lambda one: row_place(runs, one)):
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
