"""How every run's hits compare with the reference's."""

from __future__ import annotations

import pandas as pd

from harness.analysis.results import Results
from harness.data import CLASSES
from harness.report.entry import Table

COUNTS = (*CLASSES, "reference_wrong", "settled", "nonfinite")


def select(runs: Results) -> pd.DataFrame:
    """One row a run, failed ones too."""
    return pd.DataFrame([_numbers(run) for _, run in runs.all.iterrows()])


def _numbers(run: pd.Series) -> dict:
    agreement = run["record"].agreement
    counts = {name: getattr(agreement, name) for name in COUNTS}
    counts["settled_exactly"] = counts.pop("settled")
    return {
        "scene": run["title"],
        "variant": run["label"],
        "grid": run["grid"],
        "kind": run["kind"],
        "reference": agreement.reference,
        "rays": agreement.rays,
        **counts,
        "worst_band_ulp": agreement.worst_band_ulp,
        "largest_t_error": agreement.t_relative_error.max,
        "valid": run["valid"],
        "run": run["run"],
    }


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What each class is."""
    return (
        "Each ray falls in one class. Same: the reference's primitive; tie: another primitive at the "
        "same t; t off: the right primitive with an inaccurate t; wrong: another primitive at another t; "
        "missed: no hit where there is one; phantom: a hit where there is none. Settled exactly: disputed rays "
        "decided by exact arithmetic; reference wrong: those where Embree was wrong and the run right. "
        "Worst band: how far, in units in the last place, the worst wrong, missed or phantom ray is from "
        "being right. A run that is not valid has no rate and is in no figure."
    )


TABLE = Table(
    name="agreement",
    section="Correctness and work",
    title="Agreement of hits with the reference",
    needs="any run",
    select=select,
    caption=caption,
)
