"""Every kernel under the ceilings of its device: flop/s over flops a byte, and bytes/s of those that only move."""

from __future__ import annotations

import numpy as np
import pandas as pd

from harness.analysis.names import three_digits
from harness.analysis.ratios import rays_note
from harness.analysis.results import Results
from harness.report.entry import Figure
from harness.report.figures import style
from harness.report.figures.kernel_rows import kernel_table, testing_kernels

STAYS = ("between kernels", "outside stages")
MARKS = (
    (style.SKY, "o"),
    (style.BLUE, "s"),
    (style.ORANGE, "D"),
    (style.RED, "^"),
    (style.PINK, "v"),
    (style.GREY, "X"),
    (style.GREEN, "P"),
    (style.INK, "<"),
)
LINES = {"memory": (style.GREEN, "--"), "cache": (style.GREEN, ":"), "fma": (style.RED, "-")}


def select(runs: Results) -> pd.DataFrame:
    """Kernels whose work is stated, the same kernel of two variants once."""
    table = kernel_table(runs)
    if table.empty:
        return table
    table = table[table["bytes_per_ray"].notna() & ~table["kernel"].isin(STAYS)].copy()
    tests = table["kernel"].isin(testing_kernels()) & (table["intersector"] != "")
    table["point"] = np.where(tests, table["kernel"] + ", " + table["intersector"], table["kernel"])
    table["flops_per_byte"] = table["flops_per_ray"] / table["bytes_per_ray"]
    table["uncached_flops_per_byte"] = table["flops_per_ray"] / table["uncached_bytes_per_ray"]
    table["share_of_ceiling"] = [share_of_ceiling(row) for row in table.itertuples()]
    return table.drop_duplicates(["scene", "grid", "point"]).reset_index(drop=True)


def share_of_ceiling(row) -> float:
    """Achieved over attainable: the roof of the cache's slope over the least bytes; bytes/s without flops.

    A kernel whose bytes come from memory is nearer to its true roof than this says.
    """
    if row.flops_per_ray == 0:
        return row.gb_per_s / row.cache_ceiling
    return row.gflop_per_s / min(row.fma_ceiling, row.flops_per_ray / row.bytes_per_ray * row.cache_ceiling)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """How to read the points."""
    return (
        "Ceilings are measured between the repetitions on the same device: copying from memory and from the last "
        "cache (bytes read and written), and fused multiply-adds in the device's native vectors on all cores. "
        "Flops are exact counts of tests and steps times the flops of each; integer work, comparisons and "
        "selections count nothing. Full marks: the least bytes that any cache could leave, each table once a "
        "launch; hollow marks: every load and store of the kernel. The truth lies between. On the right, the "
        "same bytes over time; kernels there without a mark on the left compute no flops. "
        f"{rays_note(numbers)}"
    )


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """A roofline and a strip of bandwidths for each scene and grid."""
    panels = [rows for _, rows in numbers.groupby(["scene", "grid"], sort=False)]
    computing = list(dict.fromkeys(numbers[numbers["flops_per_ray"] > 0]["point"]))
    marks = {name: MARKS[number % len(MARKS)] for number, name in enumerate(computing)}
    figure = style.canvas((5.0 if narrow else 2.75) * len(panels) + 0.7, narrow)
    shape = (2 * len(panels), 1) if narrow else (len(panels), 2)
    axes = figure.subplots(*shape, squeeze=False, width_ratios=[1] if narrow else [1.25, 1]).reshape(-1, 2)
    for (roof, strip), rows in zip(axes, panels, strict=True):
        _roof(roof, rows, numbers, marks)
        _strip(strip, rows, marks)
        roof.set_title(f"{rows['scene'].iloc[0]}, grid {rows['grid'].iloc[0]}", loc="left", pad=3)
    handles = [axes[0][0].plot([], [], ls="", marker=mark, color=colour)[0] for colour, mark in marks.values()]
    figure.legend(handles, list(marks), loc="outside lower center", ncols=2 if narrow else 4)
    return figure


def _roof(axis, rows: pd.DataFrame, every: pd.DataFrame, marks: dict) -> None:
    """Ceilings as lines with their numbers, and a pair of marks a kernel."""
    shown = every[every["flops_per_ray"] > 0]
    low = 10 ** np.floor(np.log10(shown["uncached_flops_per_byte"].min() * 0.8))
    high = 10 ** np.ceil(np.log10(shown["flops_per_byte"].max() * 1.2))
    top, bottom = every["fma_ceiling"].max() * 3, shown["gflop_per_s"].min() / 2.5
    axis.set(
        xscale="log", yscale="log", xlim=(low, high), ylim=(bottom, top), xlabel="flops per byte", ylabel="Gflop/s"
    )
    style.log_axis(axis.xaxis, low, high, sparse=True)
    style.log_axis(axis.yaxis, bottom, top, sparse=True)
    _ceilings(axis, {name: rows[f"{name}_ceiling"].iloc[0] for name in LINES}, low, high, bottom)
    for row in rows[rows["flops_per_ray"] > 0].itertuples():
        colour, mark = marks[row.point]
        places = [row.uncached_flops_per_byte, row.flops_per_byte]
        axis.plot(places, [row.gflop_per_s] * 2, color=colour, lw=0.8)
        axis.plot(places[:1], [row.gflop_per_s], marker=mark, color=colour, mfc=style.PAGE)
        axis.plot(places[1:], [row.gflop_per_s], marker=mark, color=colour)


def _ceilings(axis, ceilings: dict[str, float], low: float, high: float, bottom: float) -> None:
    fma = ceilings["fma"]
    colour, line = LINES["fma"]
    axis.plot([fma / ceilings["cache"], high], [fma, fma], line, color=colour, lw=1.2)
    axis.annotate(
        f"fma {three_digits(fma)} Gflop/s",
        (high, fma),
        (-2, 3),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=6.5,
    )
    for name, words, side in (("cache", "last cache", "right"), ("memory", "memory", "left")):
        slope, (colour, line) = ceilings[name], LINES[name]
        start = max(low, bottom / slope)
        axis.plot([start, fma / slope], [start * slope, fma], line, color=colour, lw=1.2)
        # High on the line, where no kernel is: beside the steeper one on its left, the other on its right.
        at = start * (fma / slope / start) ** (0.65 if side == "right" else 0.78)
        offset, vertical = ((-6, 0), "bottom") if side == "right" else ((4, 2), "top")
        axis.annotate(
            f"{words}\n{three_digits(slope)} GB/s",
            (at, at * slope),
            offset,
            fontsize=6.5,
            ha=side,
            va=vertical,
            textcoords="offset points",
            linespacing=0.95,
        )


def _strip(axis, rows: pd.DataFrame, marks: dict) -> None:
    """Bytes a second of each kernel, the ceilings as vertical lines."""
    kernels = rows.reset_index(drop=True)
    for place, row in enumerate(kernels.itertuples()):
        colour, mark = marks.get(row.point, (style.INK, "."))
        ends = [row.gb_per_s, row.uncached_gb_per_s]
        axis.plot(ends, [place] * 2, color=colour, lw=0.8)
        axis.plot(ends[1:], [place], marker=mark, color=colour, mfc=style.PAGE)
        axis.plot(ends[:1], [place], marker=mark, color=colour)
    for name in ("memory", "cache"):
        colour, line = LINES[name]
        value = kernels[f"{name}_ceiling"].iloc[0]
        axis.axvline(value, color=colour, ls=line, lw=1.2)
        side = ("right", 2) if name == "memory" else ("left", -2)
        axis.annotate(
            f"{name}\n{three_digits(value)}",
            (value, 1),
            (side[1], 1),
            textcoords="offset points",
            xycoords=axis.get_xaxis_transform(),
            ha=side[0],
            va="bottom",
            fontsize=6,
            linespacing=0.95,
        )
    values = pd.concat([kernels["gb_per_s"], kernels["uncached_gb_per_s"]])
    low, high = 10 ** np.floor(np.log10(values.min())), kernels["cache_ceiling"].max() * 2.5
    axis.set(
        xscale="log",
        xlim=(low, high),
        ylim=(len(kernels) - 0.4, -0.6),
        xlabel="GB/s",
        yticks=range(len(kernels)),
        yticklabels=kernels["point"],
    )
    style.log_axis(axis.xaxis, low, high, sparse=True)
    axis.tick_params(axis="y", length=0, labelsize=6)
    axis.grid(axis="y")


FIGURE = Figure(
    name="roofline",
    section="Time by stage",
    title="Kernels under the device's ceilings",
    needs="rows of 'defray roofline'",
    select=select,
    caption=caption,
    draw=draw,
)
