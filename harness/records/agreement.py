"""How hits agree with their reference: what a check finds, and what every row keeps of it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from harness.records.schema import Stored, every_key

DISAGREEMENTS = ("wrong", "missed", "phantom", "t_off", "nonfinite")


class RelativeError(Stored):
    """Relative error of t over the rays that hit in both, by percentile; None where no ray did."""

    p50: float | None
    p99: float | None
    max: float | None


class Agreement(Stored):
    """How a run agrees with its reference (`embree`, `exact` or `none`): rays by class, and the verdict.

    `reference_wrong`: disputes in which exact arithmetic found Embree wrong and the run right. `settled`:
    rays decided by exact arithmetic. `nonfinite`: rays with a NaN or infinite field. `worst_band_ulp`: how
    far, in local ulp, the worst wrong, missed or phantom ray is from being right. `t_relative_error`: over the rays
    that hit. `reason`: one line, empty for a valid run.
    """

    reference: Literal["embree", "exact", "none"]
    same: int = 0
    tie: int = 0
    t_off: int = 0
    wrong: int = 0
    missed: int = 0
    phantom: int = 0
    reference_wrong: int = 0
    settled: int = 0
    nonfinite: int = 0
    worst_band_ulp: float = 0.0
    rays: int
    valid: bool = False
    reason: str = "not checked"
    t_relative_error: RelativeError = Field(default_factory=lambda: RelativeError(p50=None, p99=None, max=None))

    @property
    def is_checked(self) -> bool:
        """Whether somebody compared the hits with anything."""
        return self.reference != "none"


StoredAgreement = Annotated[Agreement, every_key(Agreement)]


def why_failed(agreement: Agreement) -> str:
    """Why a check failed, with its reference: `3 of 64,000 rays missed (against embree)`."""
    if not agreement.is_checked:
        return "not checked against any reference"
    counts = [f"{count:,} {name.replace('_', '-')}" for name in DISAGREEMENTS if (count := getattr(agreement, name))]
    return f"{agreement.reason or ', '.join(counts) or 'hits differ'} (against {agreement.reference})"
