"""Exact work of every run, a ray."""

from __future__ import annotations

import pandas as pd

from harness.analysis.results import Results
from harness.report.entry import Table

COUNTERS = ("steps", "pairs", "tests", "lane_tests")


def select(runs: Results) -> pd.DataFrame:
    """Counts over rays, one row a valid run that counted anything."""
    rows = []
    for _, run in runs.valid.iterrows():
        counters = run["record"].counters
        if any(getattr(counters, name) for name in COUNTERS):
            per_ray = {f"{name}_per_ray": getattr(counters, name) / run["rays"] for name in COUNTERS}
            rows.append(
                {
                    "scene": run["title"],
                    "variant": run["label"],
                    "grid": run["grid"],
                    "kind": run["kind"],
                    "rays": run["rays"],
                    **per_ray,
                    "waves": counters.waves,
                    "padding": counters.padding,
                    "run": run["run"],
                }
            )
    return pd.DataFrame(rows)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is counted."""
    return (
        "Exact counts of an instrumented build. Steps: cells walked through, empty or not; pairs: "
        "ray-cell encounters stored or visited; tests: ray-triangle tests asked for; lane tests: those "
        "executed, idle lanes included; padding: unused slots that fill bins to whole lanes."
    )


TABLE = Table(
    name="counters",
    section="Correctness and work",
    title="Work of a ray",
    needs="runs with counters",
    select=select,
    caption=caption,
)
