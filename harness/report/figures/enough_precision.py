"""When less is enough: error of the hit distance over rate, and noise of an image beside half precision's error."""

from __future__ import annotations

import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from harness.analysis.results import Results
from harness.report.entry import Figure
from harness.report.figures import style
from harness.report.figures.metrics import METRICS
from harness.stats import megarays

COLOURS = (style.BLUE, style.RED, style.GREEN, style.PINK, style.ORANGE)
MARKERS = {"grid": "o", "precision": "D"}
FLOOR = 1e-9  # an error of nothing has no place on a logarithmic axis, so less is drawn here


def select(runs: Results) -> pd.DataFrame:
    """One row a value of a knob."""
    rows = [
        {
            "scene": runs.title_of(row.scene),
            "knob": row.knob,
            "value": row.value,
            "variant": row.variant,
            "rays": row.rays,
            "mrays_per_s": megarays(row.rate.median),
            "mrays_per_s_low": megarays(row.rate.low),
            "mrays_per_s_high": megarays(row.rate.high),
            "error": row.error,
            "image_error": row.image_error,
            "differing": row.differing,
            "place": runs.scene_place(row.scene.name),
            "runs": row.id,
        }
        for row in runs.precision
    ]
    table = pd.DataFrame(rows)
    if table.empty:
        return table
    table = table.drop_duplicates(["scene", "knob", "value"], keep="last")
    table["number"] = table["value"].str.extract(r"(\d+)$")[0].astype(float).fillna(0)
    by = ["place", "scene", "knob", "number", "value"]
    return table.sort_values(by, kind="stable").drop(columns=["place", "number"]).reset_index(drop=True)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is less, and when it is enough."""
    text = (
        "Left: primary rays a second over the error of their hit distance, a miss counted at the scene's "
        "diagonal; circles: resolution of the grid; diamonds: vertices rounded to half precision in the scene's "
        "box (stored as float, so that nothing is gained in memory), float, and the double intersector where "
        "the device has one. Right: error of an ambient occlusion image with few rays a pixel against one with "
        "256 others; dashed: the error that half precision makes at equal directions. Where noise lies above "
        "the dashed line, half precision is enough."
    )
    for scene, rows in numbers.groupby("scene", sort=False):
        half = half_precision_error(rows)
        noise = rows[rows["knob"] == "samples"]
        if half is not None and len(noise):
            above = noise[noise["error"] > half]["value"].astype(int)
            measured = noise["value"].astype(int).max()
            if above.empty:
                text += f" {scene}: at no number measured."
            elif above.max() == measured:
                text += f" {scene}: at all of them, up to {measured} rays a pixel."
            else:
                text += f" {scene}: up to {above.max()} rays a pixel."
    return text


def half_precision_error(rows: pd.DataFrame) -> float | None:
    """Error of the image that half precision makes on one scene; None where it was not measured."""
    found = rows.loc[rows["value"] == "half", "image_error"].dropna()
    return None if found.empty else float(found.iloc[0])


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """Rate over error beside noise over rays a pixel."""
    figure = style.canvas(5.8 if narrow else 3.4, narrow)
    left, right = figure.subplots(2, 1) if narrow else figure.subplots(1, 2)
    scenes = list(dict.fromkeys(numbers["scene"]))
    _rates(left, numbers[numbers["knob"] != "samples"], scenes)
    _noise(right, numbers, scenes)
    handles = [
        Line2D([], [], color=COLOURS[place % len(COLOURS)], linewidth=3, label=scene)
        for place, scene in enumerate(scenes)
    ]
    handles += [
        Line2D([], [], color=style.MUTED, marker=MARKERS[knob], linestyle="none", label=label)
        for knob, label in (("grid", "resolution of the grid"), ("precision", "precision"))
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2 if narrow else 4)
    return figure


def _rates(axis, numbers: pd.DataFrame, scenes: list[str]) -> None:
    errors = numbers["error"].clip(lower=FLOOR)
    low, high = errors.min() / 300, errors.max() * 4
    bottom, top = numbers["mrays_per_s_low"].min() / 1.15, numbers["mrays_per_s_high"].max() * 1.15
    axis.set(
        xscale="log",
        yscale="log",
        xlim=(high, low),
        ylim=(bottom, top),
        xlabel=METRICS["distance_rmse"].label,
        ylabel="million rays per second",
    )
    axis.xaxis.set_major_locator(LogLocator(numticks=6))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:.0e}".replace("e-0", "e−").replace("e-", "e−"))
    style.log_axis(axis.yaxis, bottom, top)
    axis.grid()
    to_axis = axis.transScale + axis.transLimits
    for name, rows in numbers.groupby("scene", sort=False):
        colour = COLOURS[scenes.index(name) % len(COLOURS)]
        rows = rows.sort_values("mrays_per_s")
        points = [
            tuple(map(float, to_axis.transform(point)))
            for point in zip(rows["error"].clip(lower=FLOOR), rows["mrays_per_s"], strict=True)
        ]
        heights = style.spread([y for _, y in points], 0.06, 0.03, 0.97)
        for row, (x, y), height in zip(rows.itertuples(), points, heights, strict=True):
            axis.errorbar(
                [max(row.error, FLOOR)],
                [row.mrays_per_s],
                color=colour,
                marker=MARKERS[row.knob],
                yerr=[[row.mrays_per_s - row.mrays_per_s_low], [row.mrays_per_s_high - row.mrays_per_s]],
                elinewidth=0.8,
            )
            axis.annotate(
                row.value,
                (x, y),
                (x + 0.06, height),
                xycoords="axes fraction",
                fontsize=6.5,
                textcoords="axes fraction",
                va="center",
                color=colour,
                arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.4, "shrinkA": 0, "shrinkB": 3},
            )


def _noise(axis, numbers: pd.DataFrame, scenes: list[str]) -> None:
    samples = numbers[numbers["knob"] == "samples"]
    counts = sorted(samples["value"].astype(int).unique())
    axis.set(xscale="log", yscale="log", xlabel="occlusion rays a pixel", ylabel=METRICS["image_rmse"].label)
    axis.set_xticks(counts, [str(count) for count in counts], minor=False)
    axis.minorticks_off()
    axis.grid()
    for name, rows in numbers.groupby("scene", sort=False):
        colour = COLOURS[scenes.index(name) % len(COLOURS)]
        noise = rows[rows["knob"] == "samples"].sort_values("error", ascending=False)
        axis.plot(noise["value"].astype(int), noise["error"], color=colour, marker="o")
        half = half_precision_error(rows)
        if half:
            axis.axhline(half, color=colour, linestyle=(0, (5, 2)), linewidth=1)
            axis.annotate(
                "half precision",
                (0.03, half),
                (0, 3),
                xycoords=axis.get_yaxis_transform(),
                textcoords="offset points",
                fontsize=6.5,
                color=colour,
            )
    style.log_axis(axis.yaxis, *axis.get_ylim())


FIGURE = Figure(
    name="precision",
    section="Speed against accuracy",
    title="When less is enough",
    needs="precision.jsonl, which 'defray accuracy --precision' writes",
    select=select,
    caption=caption,
    draw=draw,
)
