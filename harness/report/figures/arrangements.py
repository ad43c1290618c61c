"""What arranging pairs by cell costs: walk twice, walk once and bin what was recorded, or sort it."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import WORKLOAD, three_digits
from harness.analysis.results import Results
from harness.records.run_row import Record
from harness.report.entry import Figure
from harness.report.figures import style
from harness.stats import Interval, interval, ratio

ARRANGEMENTS = {"two-pass": "two passes", "record": "record, bin", "sort": "record, sort"}
PARTS = {
    "traverse_ns_per_pair": ("walking", style.SKY),
    "arrange_ns_per_pair": ("arranging", style.ORANGE),
    "rest_ns_per_pair": ("intersecting and the rest", style.RULE),
}


def select(runs: Results) -> pd.DataFrame:
    """One row a scene and arrangement, on the grid of figure 1, for the workload with most arrangements and rays."""
    rows = runs.every_diffuse
    rows = rows[(rows["tracer"] == "deferred") & (rows["intersector"] == "ray-space") & (rows["grid"] == runs.grid)]
    rows = rows.assign(arrange=[_arrangement(record) for record in rows["record"]])
    rows = rows[rows["arrange"].notna()].drop_duplicates([*WORKLOAD, "arrange"])
    found = []
    for _, scene in rows.groupby("scene", sort=False):
        works = [work for _, work in scene.groupby(WORKLOAD[1:], sort=False)]
        work = max(works, key=lambda work: (len(work), work["rays"].iloc[0]))
        if len(work) > 1:
            found += _numbers(work.set_index("arrange"))
    return pd.DataFrame(found)


def _arrangement(record: Record) -> str | None:
    """The arrangement of a run that differs from the default in nothing else, and whose pairs were counted."""
    options = dict(record.options)
    arrange = options.pop("arrange", "two-pass")
    is_measured = bool(record.samples.arrange) and record.counters.pairs > 0
    return arrange if arrange in ARRANGEMENTS and not options and is_measured else None


def _numbers(work: pd.DataFrame) -> list[dict]:
    base = work["record"].get("record")
    return [_row(work.loc[name], name, base) for name in ARRANGEMENTS if name in work.index]


def _row(run: pd.Series, name: str, base: Record | None) -> dict:
    """Times a pair, pairs a second, and share of the whole, each with its interval over the repetitions."""
    samples, pairs = run["record"].samples, run["record"].counters.pairs
    arrange, traverse, total = samples.arrange, samples.traverse, samples.total
    spent = interval([1e9 * time / pairs for time in arrange])
    walked, whole = (1e9 * interval(times).median / pairs for times in (traverse, total))
    row = {
        "scene": run["title"],
        "arrangement": ARRANGEMENTS[name],
        "pairs_per_ray": pairs / run["rays"],
        "traverse_ns_per_pair": walked,
        **_ends("arrange_ns_per_pair", spent),
        "rest_ns_per_pair": max(0.0, whole - walked - spent.median),
        "total_ns_per_pair": whole,
    }
    if min(arrange) > 0:
        row |= _ends("mpairs_per_s_arranged", interval([pairs / time / 1e6 for time in arrange]))
    row |= _ends("arrange_share", interval([a / t for a, t in zip(arrange, total, strict=True)]))
    if name == "sort" and base is not None and len(base.samples.arrange) == len(arrange):
        row |= _ends("sorting_over_binning", ratio(arrange, base.samples.arrange))
    return row | {"grid": run["grid"], "rays": run["rays"], "runs": run["run"]}


def _ends(name: str, found: Interval) -> dict[str, float]:
    return {name: found.median, f"{name}_low": found.low, f"{name}_high": found.high}


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What counts as arranging in each, and what sorting costs here."""
    text = (
        "Median time of a pair of a ray and a cell. Walking is the stage traverse, arranging the stage arrange. "
        "Two passes: the second walk, which stores the pairs at their places, counts as walking, so arranging is "
        "the prefix sum over cells and the layout of bins alone. Record, bin: one walk remembers its cells; "
        "arranging counts them, sums, and scatters. Record, sort: the same walk; arranging is a radix sort by "
        "cell, finding where cells begin, and copying to bins. Behind each bar: nanoseconds of arranging a pair, "
        "pairs arranged a second, and the share of the whole trace."
    )
    sorting = numbers[numbers["arrangement"] == ARRANGEMENTS["sort"]]
    if len(sorting):
        low, high = (
            three_digits(end) for end in (sorting["arrange_ns_per_pair"].min(), sorting["arrange_ns_per_pair"].max())
        )
        text += (
            f" {runs.published['claims']['sorting']['text'].capitalize()}, on the paper's GPU; here {low} to "
            f"{high} ms per million."
        )
    return f"{text} {runs.grid_note()}"


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """Stacked horizontal bars, three a scene."""
    scenes = [rows for _, rows in numbers.groupby("scene", sort=False)]
    figure = style.canvas(0.75 + sum(0.16 * len(rows) + 0.3 for rows in scenes), narrow)
    axes = figure.subplots(len(scenes), 1, squeeze=False, height_ratios=[len(rows) for rows in scenes])[:, 0]
    for axis, rows in zip(axes, scenes, strict=True):
        _panel(axis, rows.reset_index(drop=True), narrow)
    axes[-1].set_xlabel("nanoseconds per pair of a ray and a cell")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2 if narrow else 3)
    return figure


def _panel(axis, rows: pd.DataFrame, narrow: bool) -> None:
    left = pd.Series(0.0, index=rows.index)
    for column, (label, colour) in PARTS.items():
        axis.barh(rows.index, rows[column], left=left, height=0.72, color=colour, label=label)
        left = left + rows[column]
    for place, (end, row) in enumerate(zip(left, rows.itertuples(), strict=True)):
        axis.annotate(_note(row, narrow), (end, place), (3, 0), textcoords="offset points", va="center", fontsize=7)
    axis.set_title(f"{rows['scene'].iloc[0]}, {rows['pairs_per_ray'].iloc[0]:.1f} pairs a ray", loc="left", pad=2)
    axis.set(
        ylim=(len(rows) - 0.4, -0.6),
        xlim=(0, left.max() * (1.85 if narrow else 1.52)),
        yticks=rows.index,
        yticklabels=rows["arrangement"],
    )
    axis.tick_params(axis="y", length=0, labelsize=7)
    axis.grid(axis="x")


def _note(row, narrow: bool) -> str:
    """`arranging 26.6 ns, 38 M pairs/s, 14 %`."""
    parts = [f"{'' if narrow else 'arranging '}{three_digits(row.arrange_ns_per_pair)} ns"]
    rate = getattr(row, "mpairs_per_s_arranged", float("nan"))
    if not narrow and not pd.isna(rate):
        parts.append(f"{three_digits(rate)} M pairs/s")
    return ", ".join([*parts, f"{100 * row.arrange_share:.0f} %"])


FIGURE = Figure(
    name="arrangements",
    section="Time by stage",
    title="Arranging pairs by cell: two passes, binning, sorting",
    needs="diffuse runs of the deferred tracer with at least two arrangements of the same rays and grid",
    select=select,
    caption=caption,
    draw=draw,
)
