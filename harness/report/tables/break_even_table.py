"""From how many rays on deferred tracing is ahead, builds included."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import grid_text
from harness.analysis.ratios import beside, best, robust_embree
from harness.analysis.results import Results
from harness.records.run_row import Record
from harness.report.entry import Table
from harness.stats import BuildAndRate, rays_to_break_even


def select(runs: Results) -> pd.DataFrame:
    """One row a scene: the fastest deferred, forward and Embree run, their builds, and the two break-evens."""
    rows = runs.diffuse
    return pd.DataFrame([row for _, scene in rows.groupby("scene", sort=False) if (row := _scene(scene))])


def _scene(scene: pd.DataFrame) -> dict | None:
    embree = robust_embree(scene)
    kinds = {"deferred": ("deferred", "streamed"), "forward": ("forward",)}
    picked = {name: best(scene[scene["tracer"].isin(tracers)]) for name, tracers in kinds.items()}
    picked["embree"] = best(embree)
    ours = picked.pop("deferred")
    if ours is None or all(other is None for other in picked.values()):
        return None
    if picked["embree"] is not None:
        picked["embree"] = best(beside(embree, ours))
    found = {
        "scene": ours["title"],
        "rays": ours["rays"],
        "deferred_variant": ours["label"],
        "deferred_grid": ours["grid"],
        **_numbers("deferred", ours, scene),
    }
    for tracer, other in picked.items():
        found |= _numbers(tracer, other, scene)
        costs = _cost(ours, scene), _cost(other, scene)
        found[f"rays_until_ahead_of_{tracer}"] = rays_to_break_even(*costs) if all(costs) else None
    picked["deferred"] = ours
    return {**found, "runs": " ".join(row["run"] for row in picked.values() if row is not None)}


def _numbers(tracer: str, row: pd.Series | None, scene: pd.DataFrame) -> dict:
    return {
        f"{tracer}_build_seconds": None if row is None else build_seconds(row, scene),
        f"{tracer}_mrays_per_s": None if row is None else row["total"],
    }


def _cost(row: pd.Series | None, scene: pd.DataFrame) -> BuildAndRate | None:
    seconds = None if row is None else build_seconds(row, scene)
    return None if seconds is None else BuildAndRate(seconds, 1e6 * row["total"])


def build_seconds(row: pd.Series, scene: pd.DataFrame) -> float | None:
    """Seconds of building what the run used: the shortest of the scene's builds of it; None where none is known."""
    if row["grid"] == "":
        same = scene["record"][(scene["tracer"] == row["tracer"]) & (scene["options"] == row["options"])]
        known = [record.hierarchy_build_seconds for record in same]
    else:
        same = [record for record in scene["record"] if _size(record) == _size(row["record"])]
        known = [record.grid.build_seconds for record in same]
    known = [seconds for seconds in known if seconds is not None]
    return min(known) if known else None


def _size(record: Record) -> tuple:
    """What tells one grid of a scene from another; of a run without a grid, what none has."""
    grid = record.grid
    return (grid_text(grid), grid.density, grid.cells) if grid else ()


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is compared."""
    return (
        "The fastest deferred run, of either tracer, and the fastest of the others on each scene's main "
        "workload, with the time to build its grid or Embree's hierarchy, the shortest on record (a process's "
        "first build also compiles the builder's kernels); of Embree's runs the one measured beside the fastest "
        "deferred one. Rays until ahead: from that number of rays on, building and tracing take deferred tracing "
        "less time than the other; 0: from the first ray, inf: never. Choosing a grid and building one on trial "
        "are not included."
    )


TABLE = Table(
    name="break_even",
    section="End to end",
    title="Build time and rays to break even",
    needs="diffuse runs of a deferred tracer and of forward or Embree",
    select=select,
    caption=caption,
)
