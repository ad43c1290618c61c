"""How well rays share vectors, forward and deferred, and the ratio of costs which that predicts."""

from __future__ import annotations

import pandas as pd

from harness.analysis.results import Results
from harness.records.coherence_row import CoherenceRow, predicted_ratios
from harness.records.roofline_row import RooflineRow
from harness.report.entry import Machines, Table
from harness.report.figures.kernel_rows import grid_name, row_place
from harness.stats import ratio


def select(runs: Results) -> pd.DataFrame:
    """One row a scene, grid, width and tracer, counts a ray and a trip; predictions over forward tracing."""
    rows = []
    for row in sorted(runs.coherence, key=lambda one: row_place(runs, one)):
        for one in sorted(row.counts, key=lambda counts: counts.lanes):
            predicted = predicted_ratios(row.counts, one.lanes).get(one.model, {})
            rows.append(
                {
                    "scene": runs.title_of(row.scene),
                    "grid": grid_name(row.grid),
                    "lanes": one.lanes,
                    "tracer": one.model,
                    "rays": row.rays.count,
                    "tests_per_ray": one.tests / row.rays.count,
                    "trips_per_ray": one.test_trips / row.rays.count,
                    "lanes_testing": one.test_efficiency,
                    "lanes_walking": one.walk_efficiency,
                    "uneven_trips": one.uneven_share,
                    "lines_of_64_bytes_a_trip": one.lines_a_trip(64),
                    "lines_of_128_bytes_a_trip": one.lines_a_trip(128),
                    "forward_trips_over_these": predicted.get("trips"),
                    "forward_lines_over_these": predicted.get("lines"),
                    "runs": row.id,
                }
            )
    return pd.DataFrame(rows)


def measured_ratios(runs: Results) -> list[str]:
    """`Sponza, grid: predicted, measured` for grids whose intersection was also timed: scalar work-optimal over the
    deferred one on this device's lanes."""
    found = []
    for row in sorted(runs.coherence, key=lambda one: row_place(runs, one)):
        timed = {
            kernel.name: (other, kernel)
            for other in runs.roofline
            for kernel in other.kernels
            if _same_work(other) == _same_work(row)
        }
        if not {"intersect_bins", "intersect_visited"} <= set(timed):
            continue
        (deferred, bins), (_, visited) = timed["intersect_bins"], timed["intersect_visited"]
        counts = {(one.model, one.lanes): one for one in row.counts}
        ours = counts.get(("deferred", deferred.lanes))
        if ours is None or len(bins.seconds) != len(visited.seconds):
            continue
        scalar = counts["forward", deferred.lanes].tests
        measured = ratio(visited.seconds, bins.seconds)
        found.append(
            f"{runs.title_of(row.scene)}, {grid_name(row.grid)}: {scalar / ours.test_trips:.1f} "
            f"predicted, {measured} measured"
        )
    return found


def _same_work(row: CoherenceRow | RooflineRow) -> tuple:
    """What two rows must share to be compared."""
    rays = (row.rays.kind, row.rays.count, row.rays.seed)
    return row.scene.sha256, grid_name(row.grid), *rays, row.intersector


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is counted, and how the prediction fares where it can be measured."""
    text = (
        "Exact counts from the cell sequences of the rays, the same on every device; "
        "harness/studies/lanes_and_lines.py states the three models. A trip is one turn of a loop that all lanes of "
        "a group take together; lanes testing and lanes walking: the share of lanes at work in a trip; uneven trips: "
        "those in which some lane has nothing to do. Lines: distinct cache lines of triangles that a trip loads. "
        "Forward trips over these: the ratio of intersection times that a device of so many lanes would show if "
        "instructions bound it; lines: if loads of triangles did."
    )
    measured = measured_ratios(runs)
    if measured:
        text += (
            f" On {runs.machine or 'this device'}, forward tests take one lane and deferred ones all: tests of "
            "the one over trips of the other against the work-optimal intersection's time over the deferred "
            f"one's: {'; '.join(measured)}."
        )
    return text


TABLE = Table(
    name="coherence",
    section="Correctness and work",
    title="Coherence of rays in vectors",
    needs="rows of 'defray coherence'",
    machines=Machines.SHARED,
    select=select,
    caption=caption,
)
