"""A value of the paper's hardware beside ours: context, never a verdict."""

from __future__ import annotations

from typing import Literal

from harness.claims.evidence import LEAST_REPETITIONS, Operand, missing_runs, pair_on, scene_rows
from harness.claims.outcome import Finding, Outcome, Strict
from harness.stats import interval

REASON = "an absolute rate of the paper's GPU, which it does not name: ours are context, neither pass nor fail"


class Rule(Strict):
    """`paper`: its value, or one a scene. Ours is multiplied by `scale`, after `inverse` has made a rate of a time."""

    type: Literal["context"]
    of: Operand
    unit: str
    scale: float = 1.0
    inverse: bool = False
    paper: float | dict[str, float]

    def judge(self, evidence) -> Outcome:
        """Findings without an answer."""
        findings, absent = [], []
        for scene in evidence.scenes:
            pair = pair_on(scene_rows(evidence.runs, scene), self.of, self.of)
            stated = self.paper.get(scene) if isinstance(self.paper, dict) else self.paper
            note = "" if stated is None else f"paper: {stated:g}"
            if pair is None:
                absent.append(scene)
                findings.append(Finding(scene, None, note="; ".join(filter(None, ("no records", note)))))
                continue
            values = [self.scale * (1 / value if self.inverse else value) for value in pair.samples[0]]
            found = interval(values)
            ends = (found.low, found.high) if len(values) >= LEAST_REPETITIONS else (None, None)
            findings.append(Finding(pair.title, found.median, *ends, pair.runs, pair.stand_in, None, note, self.unit))
        reason = REASON
        if len(absent) == len(evidence.scenes):
            reason += f"; and {missing_runs(evidence.runs, absent, (self.of,))}"
        stated = self.paper.values() if isinstance(self.paper, dict) else [self.paper]
        known = [finding.value for finding in findings if finding.value is not None]
        summary = f"{min(known):.3g} to {max(known):.3g} {self.unit}" if known else ""
        return Outcome(None, None, f"none; the paper's: {', '.join(f'{value:g}' for value in stated)} {self.unit}",
                       findings, summary, missing=reason)
