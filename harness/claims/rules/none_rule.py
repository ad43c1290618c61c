"""A statement that nothing measures."""

from __future__ import annotations

from typing import Literal

from harness.claims.operands import Evidence
from harness.claims.outcome import Outcome, missing
from harness.data import Strict


class Rule(Strict):
    """`reason`: why nothing measures it."""

    type: Literal["none"]
    reason: str

    def judge(self, evidence: Evidence) -> Outcome:
        """Not attempted, for this reason."""
        return missing(self.reason, "none")
