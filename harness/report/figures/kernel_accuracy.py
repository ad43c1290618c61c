"""The ray/triangle tests alone: their rate over the errors that the stress suite provokes."""

from __future__ import annotations

import math

import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from harness.analysis.names import short_number
from harness.analysis.results import Results
from harness.records.stability_row import StressRow
from harness.report.entry import Figure
from harness.report.figures import style
from harness.report.figures.contenders import intersector_family, intersector_name
from harness.report.figures.metrics import METRICS, frontier

FAMILIES = ("A1", "A2", "A3")
PANELS = ("band_ulp", "residual_p99_ulp")
Y = "tests_per_second"
FLOOR = 0.1  # ulp; a test without error has no place on a logarithmic axis, so less is drawn here
CONTRACTION = {"off": style.BLUE, "on": style.ORANGE}


def select(runs: Results) -> pd.DataFrame:
    """One row an intersector and contraction mode that has a rate and all three families."""
    rates = {one.key: one.tests_per_second for one in runs.kernel_rates}
    errors: dict[tuple, dict[str, StressRow]] = {}
    for row in runs.stability:
        if row.family in FAMILIES:
            errors.setdefault((row.intersector, row.contraction), {})[row.family] = row
    rows = []
    for key, rate in rates.items():
        found = errors.get(key, {})
        if len(found) == len(FAMILIES):
            rows.append(
                {"intersector": key[0], "contraction": key[1]}
                | {name: _worst(found.values(), name) for name in PANELS}
                | {
                    f"million_tests_per_s{end}": getattr(rate, part) / 1e6
                    for end, part in (("", "median"), ("_low", "low"), ("_high", "high"))
                }
            )
    table = pd.DataFrame(rows)
    for name in PANELS if len(table) else ():
        table[f"on_{name}_frontier"] = frontier(table[name], table["million_tests_per_s"], name, Y)
    return table


def _worst(rows, name: str) -> float:
    values = [getattr(row, name) for row in rows]
    return max(float("inf") if value is None else float(value) for value in values)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is measured."""
    return (
        "Rate of the tests alone, every ray against every triangle, over the worst error in families A1 to A3 of "
        "the stress suite (slivers, distance from the origin of space, far and grazing rays). Left: the largest "
        "distance from an edge at which a ray is misjudged. Right: distance of the hit point from the triangle's "
        "plane, 99th percentile. Both in local ulp, 2⁻²⁴ of the distance to the farthest vertex; fewer is to the "
        "right, faster is up. The line joins what no other test beats in both; beaten points are pale."
    )


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """A panel for the band and one for the residual."""
    figure = style.canvas(6.2 if narrow else 3.9, narrow)
    axes = figure.subplots(2, 1) if narrow else figure.subplots(1, 2, sharey=True)
    for axis, name in zip(axes, PANELS, strict=True):
        _panel(axis, numbers, name)
    for axis in axes if narrow else axes[:1]:
        axis.set_ylabel(METRICS[Y].label)
    colours = [
        Line2D([], [], color=colour, linewidth=3, label=f"contraction {mode}") for mode, colour in CONTRACTION.items()
    ]
    families = dict.fromkeys(intersector_family(name) for name in numbers["intersector"])
    figure.legend(
        handles=colours
        + [
            Line2D([], [], color=style.MUTED, marker=marker, linestyle="none", label=title)
            for marker, title in families
        ],
        loc="outside lower center",
        ncols=2 if narrow else 4,
    )
    return figure


def _panel(axis, numbers: pd.DataFrame, name: str) -> None:
    finite = numbers[numbers[name] < float("inf")]
    drawn = finite[name].clip(lower=FLOOR)
    low, high = (drawn.min(), drawn.max()) if len(drawn) else (FLOOR, 10 * FLOOR)
    rates = numbers["million_tests_per_s"]
    axis.set(
        xscale="log",
        yscale="log",
        xlim=(high * 3, low / 60),
        xlabel=METRICS[name].label,
        ylim=(rates.min() / 1.2, rates.max() * 1.2),
    )
    ticks = [10.0**power for power in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)]
    axis.set_xticks(ticks, [f"≤ {FLOOR:g}" if tick <= FLOOR else short_number(tick) for tick in ticks])
    axis.xaxis.set_minor_locator(NullLocator())
    style.log_axis(axis.yaxis, rates.min() / 1.2, rates.max() * 1.2)
    axis.grid()
    best = finite[finite[f"on_{name}_frontier"]].sort_values(name)
    axis.plot(best[name].clip(lower=FLOOR), best["million_tests_per_s"], color=style.RULE, linewidth=3, zorder=1.5)
    for row in finite.itertuples():
        solid = getattr(row, f"on_{name}_frontier")
        colour = CONTRACTION[row.contraction]
        axis.plot(
            [max(getattr(row, name), FLOOR)],
            [row.million_tests_per_s],
            color=colour,
            linestyle="none",
            marker=intersector_family(row.intersector)[0],
            alpha=1.0 if solid else 0.3,
            zorder=3 if solid else 2,
        )
    to_axis = axis.transScale + axis.transLimits
    best = best.sort_values("million_tests_per_s")
    points = [
        tuple(map(float, to_axis.transform(point)))
        for point in zip(best[name].clip(lower=FLOOR), best["million_tests_per_s"], strict=True)
    ]
    heights = style.spread([y for _, y in points], 0.055, 0.02, 0.98)
    for row, (x, y), height in zip(best.itertuples(), points, heights, strict=True):
        axis.annotate(
            intersector_name(row.intersector),
            (x, y),
            (x + 0.04, height),
            xycoords="axes fraction",
            textcoords="axes fraction",
            fontsize=6,
            va="center",
            color=style.INK,
            arrowprops={"arrowstyle": "-", "color": style.MUTED, "linewidth": 0.4, "shrinkA": 0, "shrinkB": 3},
        )


FIGURE = Figure(
    name="kernel_accuracy",
    section="Speed against accuracy",
    title="Ray/triangle tests alone: rate against worst errors",
    needs="stability.json with the families A1 to A3 and the rates of the tests",
    files=("stability.json",),
    select=select,
    caption=caption,
    draw=draw,
)
