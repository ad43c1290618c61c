"""Verdicts in words, as the terminal, the page and the printed report say them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from harness.claims.judge import VERDICTS, Judged
from harness.claims.outcome import Finding

MARKS = {"reproduced": "✓", "shape only": "◐", "contradicted": "✗", "inconclusive": "?", "not attempted": "–"}


def claims_rows(judged: Sequence[Judged]) -> list[dict[str, str]]:
    """One row a claim: verdict, claim, measured, needed, kind, place; without a verdict, `measured` says why."""
    return [
        {
            "verdict": one.verdict,
            "claim": one.claim.title,
            "measured": measured_text(one),
            "needed": one.needed,
            "kind": one.claim.kind,
            "place": one.claim.place,
        }
        for one in judged
    ]


def measured_text(one: Judged) -> str:
    """The numbers in short, whether stand-ins are among them, why there is no verdict, whether its rule is new."""
    text = one.measured + (" (with stand-ins)" if one.measured and one.stand_ins else "")
    late = "the rule was not committed when these were measured" if one.rule_before_run is False else ""
    return "; ".join(part for part in (text, one.reason, late) if part)


def counts_text(judged: Sequence[Judged]) -> str:
    """`3 reproduced, 1 shape only, ...`: every verdict that occurs."""
    found = Counter(one.verdict for one in judged)
    return ", ".join(f"{found[name]} {name}" for name in VERDICTS if found[name])


def minutes_text(minutes: float) -> str:
    """How long measuring what a claim needs takes."""
    return f"about {minutes:g} minutes" if minutes > 1 else "a minute at most"


def finding_text(finding: Finding) -> str:
    """`Sponza: 3.07 [2.9, 3.2] (meets it)`."""
    if finding.value is None:
        return f"{finding.what}: {finding.note}"
    exact = finding.low == finding.high == finding.value
    number = (
        f"{finding.value:,.4g}"
        if exact or finding.low is None
        else f"{finding.value:.3g} [{finding.low:.3g}, {finding.high:.3g}]"
    )
    answer = {True: ", meets it", False: ", does not", None: ""}[finding.answer]
    unit, note = (f" {finding.unit}" if finding.unit else ""), (f" ({finding.note})" if finding.note else "")
    return f"{finding.what}: {number}{unit}{note}{answer}"
