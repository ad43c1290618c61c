"""Where methods fail: every intersector in both contraction modes, against every family of the stress suite."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Patch

from harness.analysis.results import Results
from harness.records.stability_row import StressRow
from harness.report.entry import Figure
from harness.report.figures import style
from harness.report.figures.contenders import intersector_name

ALL_LOST = 0.999  # share of a family's rays lost from which on a cell is grey
OTHER_FAULTS = ("double_hits", "nonfinite", "self_hits", "tunnels")
LIMITS = {"rate": (-6.0, 0.0), "ulp": (0.0, 6.0)}  # decades over which a cell turns from pale to full colour
RAMP = LinearSegmentedColormap.from_list(
    "severity", [style.PAPER, "#fbe3c4", style.fixed_colour(style.ORANGE), style.fixed_colour(style.RED)]
)


def select(runs: Results) -> pd.DataFrame:
    """One row a cell: the value that the colour stands for, and whether the family's limits were met."""
    return pd.DataFrame([_cell(row) for row in runs.stability])


def _cell(row: StressRow) -> dict:
    lost = max(row.leaks or 0, row.gross or 0) / row.rays
    ulp = [error for error in (row.band_ulp, row.residual_p99_ulp) if error is not None]
    kind, value = ("ulp", max(ulp)) if ulp else ("rate", lost)
    if not row.passed and severity(kind, value) == 0:  # some other limit was broken
        kind, value = "rate", max([lost, *((getattr(row, name) or 0) / row.rays for name in OTHER_FAULTS)])
    return {
        "intersector": row.intersector,
        "contraction": row.contraction,
        "family": row.family,
        "rays": row.rays,
        "kind": kind,
        "value": value,
        "severity": severity(kind, value),
        "all_lost": lost >= ALL_LOST and not row.passed,
        "passed": row.passed,
    }


def severity(kind: str, value: float) -> float:
    """0 for nothing lost, 1 for the worst end of the colour scale."""
    low, high = LIMITS[kind]
    return 0.0 if value <= 0 else min(max((math.log10(value) - low) / (high - low), 0.0), 1.0)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What the numbers in the cells are."""
    failed = int((~numbers["passed"]).sum())
    return (
        "Rows: ray/triangle tests, each compiled without and with contraction of a·b + c; columns: families "
        "of the stress suite. A cross with a number: the family's limits are not met; a dot: they are. The "
        "number is log10: of the share of rays that fail (negative, 0 for all of them) or, in families that "
        "measure errors, of the worst error in local ulp (positive). Colour follows the number; grey: everything "
        "is lost. "
        f"{failed} of {len(numbers)} cells fail."
    )


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """A heat map; a narrow page has one for the families of either half."""
    families = list(dict.fromkeys(numbers["family"]))
    half = -(-len(families) // 2)
    parts = [families[:half], families[half:]] if narrow and len(families) > 8 else [families]
    methods = list(dict.fromkeys(zip(numbers["intersector"], numbers["contraction"], strict=True)))
    figure = style.canvas(0.75 + (0.45 + 0.145 * len(methods)) * len(parts), narrow)
    for axis, columns in zip(figure.subplots(len(parts), 1, squeeze=False).ravel(), parts, strict=True):
        _map(axis, numbers[numbers["family"].isin(columns)], methods, columns)
    handles = [
        Patch(facecolor=RAMP(0.05), edgecolor=style.RULE, label="· limits met"),
        Patch(facecolor=RAMP(0.75), edgecolor=style.RULE, label="× limits not met, log10"),
        Patch(facecolor=style.GREY, edgecolor=style.RULE, label="× all lost"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _map(axis, numbers: pd.DataFrame, methods: list[tuple], families: list[str]) -> None:
    places = {method: place for place, method in enumerate(methods)}
    for row in numbers.itertuples():
        place = (families.index(row.family), places[row.intersector, row.contraction])
        colour = style.fixed_colour(style.GREY) if row.all_lost else RAMP(row.severity)
        axis.fill_between(
            [place[0] - 0.5, place[0] + 0.5], place[1] - 0.5, place[1] + 0.5, color=colour, linewidth=0, zorder=1
        )
        axis.text(
            *place,
            _mark(row),
            ha="center",
            va="center",
            fontsize=5.5,
            zorder=3,
            color=style.FAINT if row.passed else style.PRINT,
        )
    axis.set(
        xlim=(-0.5, len(families) - 0.5),
        ylim=(len(methods) - 0.5, -0.5),
        xticks=range(len(families)),
        xticklabels=families,
        yticks=range(len(methods)),
        yticklabels=[_title(*one) for one in methods],
    )
    axis.tick_params(length=0, labelsize=6.5)
    axis.xaxis.tick_top()
    for spine in axis.spines.values():
        spine.set_visible(False)
    for line in np.arange(-0.5, len(families)):
        axis.axvline(line, color=style.PAGE, linewidth=1, zorder=2)
    for line, method in enumerate(methods):
        if line and method[0] != methods[line - 1][0]:
            axis.axhline(line - 0.5, color=style.RULE, linewidth=0.6, zorder=2)


def _mark(row) -> str:
    if row.passed:
        return "·"
    number = "" if row.all_lost or row.value <= 0 else f" {math.log10(row.value):.1f}".replace("-", "−")
    return f"×{number}"


def _title(intersector: str, contraction: str) -> str:
    return f"{intersector_name(intersector)}" if contraction == "off" else "contracted"


FIGURE = Figure(
    name="stability_map",
    section="Speed against accuracy",
    title="Stability: where methods fail",
    needs="stability.json, which 'defray stability' writes",
    files=("stability.json",),
    select=select,
    caption=caption,
    draw=draw,
)
