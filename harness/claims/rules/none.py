"""A statement that nothing measures."""

from __future__ import annotations

from typing import Literal

from harness.claims.outcome import Outcome, Strict, missing


class Rule(Strict):
    """`reason`: why nothing measures it."""

    type: Literal["none"]
    reason: str

    def judge(self, evidence) -> Outcome:
        """Not attempted, for this reason."""
        return missing(self.reason, "none")
