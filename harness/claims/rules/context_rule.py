"""A value of the paper's hardware beside ours: context, never a verdict."""

from __future__ import annotations

from typing import Literal

from harness.analysis.names import three_digits
from harness.claims.operands import LEAST_REPETITIONS, Evidence, Operand, lacking, pair_on, scene_rows
from harness.claims.outcome import Finding, Outcome
from harness.data import Strict
from harness.stats import interval

REASON = "an absolute rate of the paper's GPU, which it does not name: ours are context, neither pass nor fail"


class Rule(Strict):
    """`paper`: its value, or one a scene. Ours is multiplied by `scale`; `inverse` makes a rate of a time."""

    type: Literal["context"]
    of: Operand
    unit: str
    scale: float = 1.0
    inverse: bool = False
    paper: float | dict[str, float]

    def judge(self, evidence: Evidence) -> Outcome:
        """Findings without an answer."""
        findings = []
        for scene in evidence.scenes:
            pair = pair_on(scene_rows(evidence.runs, scene), self.of, self.of)
            stated = self.paper.get(scene) if isinstance(self.paper, dict) else self.paper
            note = "" if stated is None else f"paper: {stated:g}"
            if pair is None:
                findings.append(Finding(scene, None, note="; ".join(filter(None, ("no records", note)))))
                continue
            values = [self.scale * (1 / value if self.inverse else value) for value in pair.samples[0]]
            found = interval(values)
            ends = (found.low, found.high) if len(values) >= LEAST_REPETITIONS else (None, None)
            findings.append(Finding(pair.title, found.median, *ends, pair.runs, pair.stand_in, None, note, self.unit))
        reason = REASON
        stated = self.paper.values() if isinstance(self.paper, dict) else [self.paper]
        known = [finding.value for finding in findings if finding.value is not None]
        if not known:
            reason += f"; and {lacking(evidence.runs, evidence.scenes, [], (self.of,), 1)}"
        summary = f"{three_digits(min(known))} to {three_digits(max(known))} {self.unit}" if known else ""
        return Outcome(
            None,
            None,
            f"none; the paper's: {', '.join(f'{value:g}' for value in stated)} {self.unit}",
            findings,
            summary,
            missing=reason,
        )
