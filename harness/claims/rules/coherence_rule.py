"""How well the lanes of a device keep together, counted exactly from the cells of rays, the same on every device."""

from __future__ import annotations

from typing import Literal

from harness.analysis.names import grid_text, plain
from harness.claims.operands import PAPER_GRID, Evidence
from harness.claims.outcome import Bound, Finding, Outcome, missing
from harness.data import Strict
from harness.records.coherence_row import CoherenceRow

MODELS = Literal["forward", "deferred", "deferred-packed"]
VALUES = {
    "walk_efficiency": ("share of lanes at work in a step of the walk", lambda one: one.walk_efficiency),
    "test_efficiency": ("share of lanes at work in a test", lambda one: one.test_efficiency),
    "lines_per_test": (
        "distinct cache lines of 128 bytes over tests",
        lambda one: one.lines_128 / one.line_tests if one.line_tests else 0.0,
    ),
}


class Rule(Strict):
    """The ratio of a value of two models of `defray coherence`, on vectors of `lanes` lanes and the paper's grid."""

    type: Literal["coherence"]
    value: Literal[tuple(VALUES)]
    of: MODELS
    to: MODELS
    lanes: int
    full: Bound
    shape: Bound
    least: int = 3

    def judge(self, evidence: Evidence) -> Outcome:
        """Exact counts, scene by scene."""
        title, value = VALUES[self.value]
        words = f"{title}, {self.lanes} lanes, {self.of} / {self.to} {self.full.words()}"
        rows = {
            plain(row.scene.name): row
            for row in evidence.runs.coherence
            if grid_text(row.grid) == PAPER_GRID and row.rays.kind == "diffuse"
        }
        findings, answers = [], []
        for scene in evidence.scenes:
            found = self._ratio(rows.get(plain(scene)), value)
            if found is None:
                findings.append(Finding(scene, None, note="no rows of 'defray coherence'"))
                continue
            row = rows[plain(scene)]
            findings.append(
                Finding(
                    evidence.runs.title_of(row.scene),
                    found,
                    found,
                    found,
                    (row.id,),
                    row.scene.is_stand_in,
                    self.full.holds(found, found),
                )
            )
            answers.append(found)
        if len(answers) < self.least:
            counted = f"{len(answers)} of {len(evidence.scenes)} scenes, {self.least} needed: " if answers else ""
            return missing(f"{counted}no rows of 'defray coherence'", words, self.full.words())
        ends = [(found.low, found.high) for found in findings]
        full, shape = (bound.over(bound.holds(*pair) for pair in ends) for bound in (self.full, self.shape))
        return Outcome(
            full,
            shape,
            words,
            findings,
            f"{min(answers):.3g} to {max(answers):.3g}",
            shape_threshold=self.shape.words(),
            needed=self.full.words(),
        )

    def _ratio(self, row: CoherenceRow | None, value) -> float | None:
        """The ratio on one scene; None without both models at this width."""
        if row is None:
            return None
        counts = {one.model: one for one in row.counts if one.lanes == self.lanes}
        if not {self.of, self.to} <= set(counts) or value(counts[self.to]) <= 0:
            return None
        return value(counts[self.of]) / value(counts[self.to])
