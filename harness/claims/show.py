"""Verdicts for people: a table for the terminal and one for the report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from markupsafe import Markup
from rich.markup import escape as plain
from rich.table import Table

from harness.claims.judge import VERDICTS, Judged
from harness.claims.outcome import Finding

COLOURS = {
    "reproduced": "green",
    "shape only": "yellow",
    "contradicted": "red",
    "inconclusive": "cyan",
    "not attempted": "dim",
}
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


def claims_table(judged: Sequence[Judged], device: str = ""):
    """A Rich table for the terminal."""
    where = f" on {plain(device)}" if device else ""
    title = f"The paper's claims{where}: {counts_text(judged)}"
    table = Table(title=title, box=None, title_justify="left", padding=(0, 1))
    for name, ratio in (("verdict", None), ("claim", 4), ("measured", 6), ("needed", 2)):
        table.add_column(name, ratio=ratio, no_wrap=name == "verdict")
    for row in claims_rows(judged):
        colour = COLOURS[row["verdict"]]
        table.add_row(
            f"[{colour}]{MARKS[row['verdict']]} {row['verdict']}[/{colour}]",
            *(plain(row[name]) for name in ("claim", "measured", "needed")),
        )
    return table


def claims_html(found: Sequence[tuple[str, Sequence[Judged]]]) -> Markup:
    """The table as a fragment of the report's page, details folded into each row; it carries its own few styles.

    `found`: the verdicts of each machine with its name; several machines stand side by side, a column each.
    """
    several = len(found) > 1
    name = Markup("<strong>{}</strong>: {}" if several else "{1}")
    counts = Markup("; ").join(name.format(machine, counts_text(judged)) for machine, judged in found)
    heads = [f"verdict on {machine}" for machine, _ in found] if several else ["verdict", "claim", "measured"]
    heads = ["claim", *heads] if several else heads
    rows = Markup("\n").join(
        _row(ones, [machine for machine, _ in found]) for ones in zip(*(judged for _, judged in found), strict=True)
    )
    return Markup(_STYLE) + Markup(
        '<section class="claims">\n<h2>The paper’s claims</h2>\n<p>{}. Each rule stands in '
        "<code>harness/paper/claims.toml</code>; a verdict says so where its rule was not yet committed as it is "
        "when the runs were made. Orderings, ratios and trends are judged; the paper’s absolute rates are context. A "
        "95 % interval across a threshold is inconclusive.</p>\n"
        '<div class="scroll"><table>\n<thead><tr>{}</tr></thead>\n<tbody>\n{}\n</tbody></table></div>\n</section>\n'
    ).format(counts, Markup("").join(Markup('<th scope="col">{}</th>').format(head) for head in heads), rows)


def _row(ones: Sequence[Judged], machines: Sequence[str]) -> Markup:
    """One claim: verdict, claim, numbers; or the claim and then the verdict and numbers of each machine."""
    claim = Markup('<td class="long">{}</td>').format(_claim(ones[0]))
    if len(ones) == 1:
        cells = Markup('<td class="verdict-{}">{}</td>{}<td class="long">{}</td>').format(
            _kind(ones[0]), _verdict(ones[0]), claim, _numbers(ones[0])
        )
    else:
        cell = Markup('<td class="long verdict-{}"><span class="on">{}</span>{}<br>{}</td>')
        cells = claim + Markup("").join(
            cell.format(_kind(one), machine, _verdict(one), _numbers(one))
            for machine, one in zip(machines, ones, strict=True)
        )
    return Markup("<tr>{}</tr>").format(cells)


def _kind(one: Judged) -> str:
    return one.verdict.replace(" ", "-")


def _verdict(one: Judged) -> Markup:
    return Markup('<span class="verdict">{}&nbsp;{}</span>').format(MARKS[one.verdict], one.verdict)


def _claim(one: Judged) -> Markup:
    """The claim, with the paper's words and the rule folded away."""
    claim = one.claim
    needed = [
        f"Needed: {outcome.threshold}." + (f" Shape: {outcome.shape_threshold}." if outcome.shape_threshold else "")
        for outcome in one.outcomes
    ]
    return Markup(
        "{title}<details><summary>the paper’s words, and the rule</summary>"
        "<blockquote>{words}<br><cite>{place}</cite></blockquote><p>{reading}</p><p>{needed}</p></details>"
    ).format(title=claim.title, words=claim.words, place=claim.place, reading=claim.reading, needed=" ".join(needed))


def _numbers(one: Judged) -> Markup:
    """What was measured and what was needed, with every number and its records folded away."""
    findings = Markup("").join(
        Markup("<li>{}</li>").format(finding_text(finding))
        for outcome in one.outcomes
        for finding in outcome.findings
    )
    return Markup(
        '{measured}<br><span class="needed">needed: {short}</span>'
        "<details><summary>numbers</summary><ul>{findings}</ul>"
        "<p>Records: <code>{records}</code></p><p><code>{command}</code>; what it needs takes {minutes}</p></details>"
    ).format(
        measured=measured_text(one),
        short=one.needed,
        findings=findings,
        records=" ".join(one.records) or "none",
        command=one.claim.command,
        minutes=_minutes(one.claim.minutes),
    )


def _minutes(minutes: float) -> str:
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


_STYLE = """<style>
.claims .verdict { white-space: nowrap; font-weight: 600; }
.claims .verdict-reproduced .verdict { color: var(--green); }
.claims .verdict-shape-only .verdict { color: var(--orange); }
.claims .verdict-contradicted .verdict { color: var(--red); }
.claims .verdict-inconclusive .verdict { color: var(--blue); }
.claims .verdict-not-attempted .verdict { color: var(--muted); }
.claims td { vertical-align: top; }
.claims .scroll { max-height: none; }
.claims blockquote { margin: .3rem 0 .3rem .2rem; padding-left: .7rem; border-left: 3px solid var(--rule); }
.claims details p, .claims details ul { margin: .3rem 0; overflow-wrap: anywhere; white-space: normal; }
.claims details ul { padding-left: 1.1rem; }
.claims details { font-size: inherit; }
.claims .needed, .claims .on { color: var(--muted); }
.claims .on { display: none; }
.claims th { white-space: normal; }
@media (max-width: 40rem) {
  .claims thead { display: none; }
  .claims .on { display: block; }
  .claims tr, .claims td, .claims td.long { display: block; min-width: 0; border: 0; white-space: normal; }
  .claims tr { border-bottom: 1px solid var(--rule); padding: .3rem 0; }
}
</style>
"""
