"""An order of scenes, fastest first, pair by pair."""

from __future__ import annotations

from itertools import combinations
from typing import Literal

from harness.claims.operands import LEAST_REPETITIONS, Evidence, Operand, lacking, pair_on, scene_rows
from harness.claims.outcome import Finding, Outcome, every, missing
from harness.data import Strict
from harness.stats import quotient


class Rule(Strict):
    """`shape_pairs`: of all pairs of `order`, so many must stand in order for the shape. Times count per ray."""

    type: Literal["order"]
    of: Operand
    order: list[str]
    shape_pairs: int
    least: int = 3

    def judge(self, evidence: Evidence) -> Outcome:
        """A pair is in order where the 95 % interval of its ratio of times lies below 1."""
        per_ray = self.of.model_copy(update={"per": "rays"})
        found = {scene: pair_on(scene_rows(evidence.runs, scene), per_ray, per_ray) for scene in self.order}
        known = {scene: pair for scene, pair in found.items() if pair is not None}
        words = "every pair in the order " + ", ".join(self.order)
        if len(known) < self.least:
            reason = lacking(evidence.runs, self.order, list(known), (self.of,), self.least)
            return missing(reason, words, "every pair")
        answers, findings = [], []
        for fast, slow in combinations(self.order, 2):
            answer, finding = self._compare(known.get(fast), known.get(slow), f"{fast} before {slow}")
            answers.append(answer)
            findings.append(finding)
        sure, possible = answers.count(True), len(answers) - answers.count(False)
        shape = True if sure >= self.shape_pairs else None if possible >= self.shape_pairs else False
        ranked = sorted(known, key=lambda scene: sorted(known[scene].samples[0])[len(known[scene].samples[0]) // 2])
        summary = f"{sure} of {len(answers)} pairs in order; here: {', '.join(ranked)}"
        return Outcome(
            every(answers),
            shape,
            words,
            findings,
            summary,
            needed="every pair",
            shape_threshold=f"{self.shape_pairs} of {len(answers)} pairs in that order",
        )

    def _compare(self, fast, slow, what: str):
        """Times of two scenes; they were not measured together, so each is resampled by itself."""
        if fast is None or slow is None:
            return None, Finding(what, None, note="no records")
        ids = (*fast.runs, *slow.runs)
        times = fast.samples[0], slow.samples[0]
        ratio, stand_in = quotient(*times), fast.stand_in or slow.stand_in
        if min(map(len, times)) < LEAST_REPETITIONS:
            note = f"fewer than {LEAST_REPETITIONS} repetitions: no interval"
            return None, Finding(what, ratio.median, runs=ids, stand_in=stand_in, note=note)
        answer = True if ratio.high < 1 else False if ratio.low > 1 else None
        return answer, Finding(what, ratio.median, ratio.low, ratio.high, ids, stand_in, answer)
