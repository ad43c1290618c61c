"""The ray-space test against Möller and Trumbore's, both inside the deferred driver."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import SAME_WORK
from harness.analysis.ratios import speedup
from harness.analysis.results import Results
from harness.report.entry import Table


def select(runs: Results) -> pd.DataFrame:
    """Ratios of the intersection rate and of the whole, with 95 % intervals."""
    rows = runs.every_diffuse[runs.every_diffuse["tracer"] == "deferred"]
    found = []
    for _, pair in rows.groupby([*SAME_WORK, "options"], sort=False):
        sides = {name: pair[pair["intersector"] == name] for name in ("ray-space", "moller-trumbore")}
        if not any(side.empty for side in sides.values()):
            found.append(_numbers(sides["ray-space"].iloc[0], sides["moller-trumbore"].iloc[0]))
    return pd.DataFrame(found)


def _numbers(ours: pd.Series, base: pd.Series) -> dict:
    row = {
        "scene": ours["title"],
        "options": ours["options"] or "default",
        "grid": ours["grid"],
        "rays": ours["rays"],
        "repetitions": ours["repetitions"],
    }
    for stage in ("intersect", "total"):
        ratio = speedup(ours["record"], base["record"], stage) or {}
        name = "intersection" if stage == "intersect" else "whole_trace"
        row |= {f"{name}_ratio{end}": ratio.get(f"ratio{end}") for end in ("", "_low", "_high")}
    return {**row, "runs": f"{ours['run']} {base['run']}"}


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """The claim beside the ratio."""
    claim = runs.published["claims"]["intersector_speedup"]
    return (
        "Rate with the ray-space test over rate with Möller–Trumbore, everything else equal, and its "
        f"95 % interval. The paper observes at least {claim['value']}× ({claim['place'].split(':')[0]})."
    )


TABLE = Table(
    name="intersectors",
    section="End to end",
    title="Ray-space test over Möller–Trumbore, inside the deferred tracer",
    needs="diffuse runs of the deferred tracer with both intersectors on the same rays and grid",
    select=select,
    caption=caption,
)
