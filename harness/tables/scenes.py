"""The scenes measured, with what names their exact triangles."""

from __future__ import annotations

import pandas as pd

from harness.figures.runs import Runs

ORDER = 100
SECTION = "Machine, software, provenance"
TITLE = "Scenes"
NEEDS = "any run"


def select(runs: Runs) -> pd.DataFrame:
    """One row a scene."""
    scenes = runs.scenes
    digests = {record["scene"]["name"]: record["scene"].get("sha256", "") for record in runs.records}
    return pd.DataFrame({"scene": scenes["title"], "source": scenes["source"],
                         "triangles": scenes["triangles"], "sha256": scenes["scene"].map(digests)})


def caption(runs: Runs, numbers: pd.DataFrame) -> str:
    """What the digest is of."""
    return "SHA-256 of the triangles as little-endian float32."
