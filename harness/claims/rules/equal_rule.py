"""Counters of two variants that must be equal, exactly, on every scene."""

from __future__ import annotations

from typing import Literal

from pydantic import field_validator

from harness.claims.operands import COUNTS, Evidence, Operand, lacking, pair_on, scene_rows
from harness.claims.outcome import Finding, Outcome, every, missing
from harness.data import Strict


class Rule(Strict):
    """`of` and `to` are variants on the paper's grid."""

    type: Literal["equal"]
    of: str
    to: str
    counters: list[str]
    least: int = 3

    @field_validator("counters")
    @classmethod
    def _known(cls, names: list[str]) -> list[str]:
        if not names or not set(names) <= set(COUNTS):
            raise ValueError(f"counters are {', '.join(COUNTS)}")
        return names

    def judge(self, evidence: Evidence) -> Outcome:
        """One finding a scene and counter: the ratio, which must be 1 exactly."""
        words = f"{', '.join(self.counters)} of {self.of} and {self.to} equal on every scene"
        findings, known = [], []
        operands = {
            name: [Operand(variant=variant, count=name) for variant in (self.of, self.to)] for name in self.counters
        }
        for scene in evidence.scenes:
            rows = scene_rows(evidence.runs, scene)
            pairs = {name: pair_on(rows, *both) for name, both in operands.items()}
            if any(pair is None or pair.samples[1][0] <= 0 for pair in pairs.values()):
                findings.append(Finding(scene, None, note="no records with these counters"))
                continue
            known.append(scene)
            for name, pair in pairs.items():
                one, two = (int(side[0]) for side in pair.samples)
                note = f"{one:,} and {two:,}"
                findings.append(
                    Finding(
                        f"{pair.title}, {name}",
                        pair.value,
                        pair.value,
                        pair.value,
                        pair.runs,
                        pair.stand_in,
                        one == two,
                        note,
                    )
                )
        if len(known) < self.least:
            both = next(iter(operands.values()))
            reason = lacking(evidence.runs, evidence.scenes, known, both, self.least)
            return missing(reason, words, "equal on every scene")
        answer = every(finding.answer for finding in findings)
        differ = sum(finding.answer is False for finding in findings)
        summary = f"equal on {len(known)} scenes" if not differ else f"{differ} of {len(findings)} counts differ"
        return Outcome(answer, answer, words, findings, summary, needed="equal on every scene")
