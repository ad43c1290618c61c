"""Rates that others published: other hardware and rays, so a table of their own."""

from __future__ import annotations

import pandas as pd

from harness.analysis.results import Results
from harness.report.entry import Machines, Table


def select(runs: Results) -> pd.DataFrame:
    """One row a system, a column a scene of the paper."""
    scenes = runs.published["scene"]
    paper = {
        "system": "the paper, traversal only",
        "hardware": "its GPU, not named",
        "rays": "diffuse",
        **{scene["title"]: scene["traverse_mrays"] for scene in scenes},
        "elsewhere": "",
        "read_in": "figure 1, bottom",
    }
    rows = [paper]
    for other in runs.published.get("other", []):
        rates = {scene["title"]: other["rates"].get(scene["name"]) for scene in scenes}
        rows.append(
            {
                "system": other["system"],
                "hardware": other["hardware"],
                "rays": other["rays"],
                **rates,
                "elsewhere": other.get("text", ""),
                "read_in": other["place"],
            }
        )
    return pd.DataFrame(rows)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """Why there is no ratio here."""
    return (
        "Million rays a second as published, on other hardware, with other rays and sometimes other "
        "versions of the scenes: for orientation, not for division."
    )


TABLE = Table(
    name="published",
    section="End to end",
    title="Published elsewhere: other hardware and rays",
    needs="nothing: these are others' numbers",
    machines=Machines.SHARED,
    files=("harness/paper/published.toml",),
    select=select,
    caption=caption,
)
