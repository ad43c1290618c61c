"""Verdicts: every claim's rules on the records of a folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.analysis.results import Results
from harness.claims.history import rule_before_run
from harness.claims.model import FILE, Claim, read_claims
from harness.claims.operands import Evidence
from harness.claims.outcome import Outcome, every, some

VERDICTS = ("reproduced", "shape only", "contradicted", "inconclusive", "not attempted")


@dataclass(frozen=True)
class Judged:
    """A claim, the outcome of each of its rules, and the verdict.

    `rule_before_run`: whether the rule was committed before the runs it judges; None where that cannot be told.
    """

    claim: Claim
    outcomes: Sequence[Outcome]
    verdict: str
    rule_before_run: bool | None = None

    @property
    def measured(self) -> str:
        """The numbers of all rules in short."""
        return "; ".join(outcome.summary for outcome in self.outcomes if outcome.summary)

    @property
    def threshold(self) -> str:
        """The full conditions."""
        return "; ".join(outcome.threshold for outcome in self.outcomes)

    @property
    def reason(self) -> str:
        """Why there is no verdict; empty where there is one."""
        if self.verdict != "not attempted":
            return ""
        return "; ".join(dict.fromkeys(outcome.missing for outcome in self.outcomes if outcome.missing))

    @property
    def records(self) -> list[str]:
        """Ids of the records that were looked at, each once."""
        return list(dict.fromkeys(run for one in self.outcomes for finding in one.findings for run in finding.runs))

    @property
    def needed(self) -> str:
        """The full conditions in short, without what they are conditions on."""
        return "; ".join(dict.fromkeys(outcome.needed or outcome.threshold for outcome in self.outcomes))

    @property
    def stand_ins(self) -> bool:
        """Whether a generated scene stands in for one of the paper's."""
        return any(finding.stand_in for outcome in self.outcomes for finding in outcome.findings)

    def as_dict(self) -> dict:
        """For claims.json."""
        claim = self.claim
        return {
            "id": claim.id, "title": claim.title, "verdict": self.verdict, "reason": self.reason,
            "words": claim.words, "place": claim.place, "kind": claim.kind, "reading": claim.reading,
            "threshold": self.threshold, "measured": self.measured, "stand_ins": self.stand_ins,
            "rules": [{"type": rule.type, "threshold": outcome.threshold, "shape": outcome.shape_threshold,
                       "meets_full": outcome.full, "meets_shape": outcome.shape, "missing": outcome.missing,
                       **outcome.facts, "findings": [finding.as_dict() for finding in outcome.findings]}
                      for rule, outcome in zip(claim.rule, self.outcomes, strict=True)],
            "rule_before_run": self.rule_before_run, "command": claim.command, "minutes": claim.minutes,
            "records": self.records,
        }  # fmt: skip


def judge_all(runs: Results, path: Path = FILE) -> list[Judged]:
    """A verdict for every claim, in the order of claims.toml; raises DefrayError for a file it cannot read."""
    scenes, claims = read_claims(path)
    rows = [*runs.records, *runs.coherence]
    commits = {row.id: row.commit for row in rows}
    judged = [judge(claim, Evidence(runs, scenes)) for claim in claims]
    return [replace(one, rule_before_run=_rule_before_run(one, commits, path)) for one in judged]


def _rule_before_run(judged: Judged, commits: dict[str, str], path: Path) -> bool | None:
    """Of a claim that has a verdict by records; None for others."""
    used = {commits[run] for run in judged.records if run in commits}
    return rule_before_run(judged.claim.id, used, path) if used and judged.verdict != "not attempted" else None


def judge(claim: Claim, evidence: Evidence) -> Judged:
    """The verdict of one claim: all its rules must hold."""
    outcomes = [rule.judge(evidence) for rule in claim.rule]
    return Judged(claim, outcomes, verdict_of(outcomes))


def verdict_of(outcomes: Sequence[Outcome]) -> str:
    """What the answers of all rules make together. A shape that fails contradicts whatever is missing elsewhere."""
    full = every(outcome.full for outcome in outcomes)
    shape = every(some((outcome.full, outcome.shape)) for outcome in outcomes)
    if shape is False:
        return "contradicted"
    if any(outcome.missing for outcome in outcomes):
        return "not attempted"
    if full:
        return "reproduced"
    return "shape only" if full is False and shape else "inconclusive"


def as_document(judged: Sequence[Judged], runs: Results) -> dict:
    """What claims.json holds: the device, how many claims have which verdict, and every claim."""
    counts = {name: sum(one.verdict == name for one in judged) for name in VERDICTS}
    return {"schema": 1, "device": runs.device, "verdicts": counts, "claims": [one.as_dict() for one in judged]}


def write_claims(judged: Sequence[Judged], runs: Results, path: Path) -> None:
    """The verdicts as JSON, the same bytes for the same records."""
    text = json.dumps(as_document(judged, runs), indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
