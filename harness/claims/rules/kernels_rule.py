"""Rates of two ray/triangle tests by themselves, from the suite of stress."""

from __future__ import annotations

from typing import Literal

from harness.claims.operands import Evidence
from harness.claims.outcome import Bound, Finding, Outcome, missing
from harness.data import Strict
from harness.stats import Interval


class Rule(Strict):
    """`contraction`: may the compiler fuse a product and a sum."""

    type: Literal["kernels"]
    of: str
    to: str
    contraction: Literal["on", "off"]
    full: Bound
    shape: Bound

    def judge(self, evidence: Evidence) -> Outcome:
        """The quotient of the medians; its interval is that of the ends of both, which is the wider one."""
        words = f"tests a second, {self.of} / {self.to} {self.full.words(scenes=False)}"
        rates = {
            row.intersector: row.tests_per_second
            for row in evidence.runs.kernel_rates
            if row.contraction == self.contraction and row.tests_per_second
        }
        absent = [name for name in (self.of, self.to) if name not in rates]
        if absent:
            return missing(
                f"no rate of {' and '.join(absent)} by itself: needs `defray stability --intersector all --out DIR`",
                words,
                self.full.words(scenes=False),
            )
        one, two = rates[self.of], rates[self.to]
        value, low, high = one.median / two.median, one.low / two.high, one.high / two.low
        answer = self.full.holds(low, high)
        finding = Finding(f"{self.of} over {self.to}", value, low, high, ("stability.json",), False, answer)
        return Outcome(
            answer,
            self.shape.holds(low, high),
            words,
            [finding],
            f"{Interval(value, low, high)}",
            shape_threshold=self.shape.words(scenes=False),
            needed=self.full.words(scenes=False),
        )
