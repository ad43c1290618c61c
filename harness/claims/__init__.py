"""The paper's claims, each with the rule that was written before the run, and the verdict of the records."""

from __future__ import annotations

from harness.claims.judge import Judged, judge_all, write_claims
from harness.claims.model import Claim, read_claims

__all__ = ["Claim", "Judged", "judge_all", "read_claims", "write_claims"]
