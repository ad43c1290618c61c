"""The scenes measured, with what names their exact triangles."""

from __future__ import annotations

import pandas as pd

from harness.analysis.results import Results
from harness.report.entry import Machines, Table


def select(runs: Results) -> pd.DataFrame:
    """One row a scene."""
    found = []
    for _, rows in runs.all.groupby("scene", sort=False):
        one = rows.iloc[0]
        found.append(
            {
                "scene": one["title"],
                "source": one["source"],
                "triangles": one["triangles"],
                "sha256": one["record"].scene.sha256,
                "runs": " ".join(rows["run"]),
            }
        )
    return pd.DataFrame(found)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What the digest is of."""
    return "SHA-256 of the triangles as little-endian float32."


TABLE = Table(
    name="scenes",
    section="Scenes",
    title="Scenes",
    needs="any run",
    machines=Machines.SHARED,
    select=select,
    caption=caption,
)
