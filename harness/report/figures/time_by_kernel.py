"""Where the time of a ray goes, kernel by kernel."""

from __future__ import annotations

import pandas as pd
from matplotlib.ticker import MaxNLocator, StrMethodFormatter

from harness.analysis.names import three_digits
from harness.analysis.ratios import rays_note
from harness.analysis.results import Results
from harness.report.entry import Figure
from harness.report.figures import style
from harness.report.figures.kernel_rows import kernel_table

INSIDE = 4.6  # points a character of a label takes in a bar


def select(runs: Results) -> pd.DataFrame:
    """Median nanoseconds a ray of every kernel, and of what a stage takes beyond its kernels."""
    table = kernel_table(runs)
    columns = ["scene", "grid", "variant", "tracer", "kernel", "stage", "ns", "ns_low", "ns_high", "rays", "runs"]
    if table.empty:
        return table
    order = {stage: place for place, stage in enumerate(style.STAGE_COLOURS)}
    table["place"] = [order.get(stage, len(order)) for stage in table["stage"]]
    blocks = [rows.sort_values("place", kind="stable") for _, rows in table.groupby(["runs"], sort=False)]
    return pd.concat(blocks)[columns].reset_index(drop=True)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is timed."""
    return (
        "Device time of each kernel, summed over its launches, over the number of rays; median of the "
        "repetitions. Prefix sum, compaction and clearing of bins stand for what their stage takes beyond its "
        "kernels, waiting for a count on the host included. Parts too narrow for a name are in the table. Each "
        f"panel has its own axis. {rays_note(numbers)}"
    )


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """Stacked horizontal bars, a panel a scene and grid, coloured by stage."""
    panels = [rows for _, rows in numbers.groupby(["scene", "grid"], sort=False)]
    counts = [rows["variant"].nunique() for rows in panels]
    figure = style.canvas(0.5 + sum(0.42 * count + 0.42 for count in counts), narrow)
    axes = figure.subplots(len(panels), 1, squeeze=False, height_ratios=[c + 0.6 for c in counts])[:, 0]
    for axis, rows in zip(axes, panels, strict=True):
        _panel(axis, rows, narrow)
    axes[-1].set_xlabel("nanoseconds per ray")
    stages = [stage for stage in style.STAGE_COLOURS if stage in set(numbers["stage"])]
    handles = [axes[0].barh([0], [0], color=style.STAGE_COLOURS[stage]) for stage in stages]
    figure.legend(handles, stages, loc="outside lower center", ncols=5)
    return figure


def _panel(axis, rows: pd.DataFrame, narrow: bool) -> None:
    variants = list(dict.fromkeys(rows["variant"]))
    longest = rows.groupby("variant")["ns"].sum().max()
    room = (style.NARROW if narrow else style.WIDE) * 72 * (0.86 if narrow else 0.9)
    for place, variant in enumerate(variants):
        left = 0.0
        for row in rows[rows["variant"] == variant].itertuples():
            axis.barh(
                place,
                row.ns,
                left=left,
                height=0.5,
                color=style.STAGE_COLOURS.get(row.stage, style.GREY),
                edgecolor=style.PAGE,
                linewidth=0.6,
            )
            if row.ns / longest * room > INSIDE * len(row.kernel):
                axis.text(
                    left + row.ns / 2,
                    place,
                    f"{row.kernel}\n{row.ns:,.0f}",
                    ha="center",
                    va="center",
                    fontsize=6,
                    color=style.PRINT if row.stage != "intersect" else style.PAGE,
                    linespacing=0.95,
                )
            left += row.ns
        axis.annotate(three_digits(left), (left, place), (3, 0), textcoords="offset points", va="center", fontsize=7)
        axis.annotate(variant, (0, place - 0.29), (1, 0), textcoords="offset points", va="bottom", fontsize=6.5)
    axis.set_title(f"{rows['scene'].iloc[0]}, grid {rows['grid'].iloc[0]}", loc="left", pad=3)
    axis.set(ylim=(len(variants) - 0.6, -0.72), xlim=(0, longest * (1.15 if narrow else 1.08)), yticks=[])
    axis.spines["left"].set_visible(False)
    axis.grid(axis="x")
    axis.xaxis.set_major_locator(MaxNLocator(4 if narrow else 8))
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))


FIGURE = Figure(
    name="kernel_times",
    section="Time by stage",
    title="Time of a ray, kernel by kernel",
    needs="rows of 'defray roofline'",
    select=select,
    caption=caption,
    draw=draw,
)
