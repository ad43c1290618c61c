"""Figure 1, middle: deferred over work-optimal intersection against the size of the scene."""

from __future__ import annotations

import textwrap

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from harness.analysis.names import SAME_WORK
from harness.analysis.ratios import best, rays_note, speedup
from harness.analysis.results import Results
from harness.report.entry import Figure, Machines
from harness.report.figures import style
from harness.stats import Fit, exponent, fits

DEFAULT, STRONGEST = "same intersector", "fastest work-optimal"
FITTED = "ray-space"
CURVES = {"constant": "a constant", "linear": "a line", "power": "a power law"}


def select(runs: Results) -> pd.DataFrame:
    """Ratio of intersection rates for every scene and intersector, against either baseline."""
    rows = []
    for _, work in runs.paper.groupby(SAME_WORK, sort=False):
        plain = work[work["options"] == ""]
        bases = work[work["tracer"] == "work-optimal"]
        for _, run in plain[plain["tracer"] == "deferred"].iterrows():
            same = bases[(bases["options"] == "") & (bases["intersector"] == run["intersector"])]
            rows += _compared(run, best(same, "intersect"), DEFAULT)
            if (bases["options"] != "").any():
                rows += _compared(run, best(bases, "intersect"), STRONGEST)
    return pd.DataFrame(rows)


def _compared(run: pd.Series, base: pd.Series | None, baseline: str) -> list[dict]:
    found = None if base is None else speedup(run["record"], base["record"], "intersect")
    if found is None:
        return []
    return [
        {
            "scene": run["title"],
            "triangles": run["triangles"],
            "intersector": run["intersector"],
            "baseline": baseline,
            "baseline_run": base["label"],
            "deferred_mrays_per_s": run["intersect"],
            "baseline_mrays_per_s": base["intersect"],
            **{key.replace("ratio", "speedup"): value for key, value in found.items()},
            "grid": run["grid"],
            "rays": run["rays"],
            "runs": f"{run['run']} {base['run']}",
        }
    ]


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is divided by what."""
    text = (
        "Figure 1, middle. Rate of the deferred tracer's intersection stage over that of work-optimal "
        "forward intersection, which is given the cells up to each hit and pays for no traversal. Same "
        "scene, rays, grid and intersector; bars are 95 % intervals; both "
        "axes are logarithmic."
    )
    if (numbers["baseline"] == STRONGEST).any():
        text += (
            " Hollow marks divide by the fastest work-optimal variant measured on the scene, any "
            "intersector and options: the ratio least kind to deferral."
        )
    for machine, own in by_machine(numbers):
        text += f" {machine}:" if machine else ""
        text += _fit_text(own)
    return f"{text} {runs.grid_note()} {rays_note(numbers)} The paper measured on its own GPU."


def by_machine(numbers: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """The numbers of each machine with its name; one nameless machine where the report has no other."""
    return list(numbers.groupby("machine", sort=False)) if "machine" in numbers else [("", numbers)]


def fitted_curve(numbers: pd.DataFrame) -> tuple[Fit, list[Fit], pd.DataFrame] | None:
    """The curve that AICc prefers through the ray-space points, all three, and the points; None for under four."""
    points = numbers[(numbers["intersector"] == FITTED) & (numbers["baseline"] == DEFAULT)]
    if points["triangles"].nunique() < 4:
        return None
    ranked = fits(points["triangles"], points["speedup"])
    return ranked[0], ranked, points


def _fit_text(numbers: pd.DataFrame) -> str:
    """What the points carry, in two sentences."""
    found = fitted_curve(numbers)
    if found is None:
        return " Too few scenes for a curve."
    fit, ranked, points = found
    power = exponent(points["triangles"], points["speedup"], [""] * len(points))
    scores = ", ".join(f"{CURVES[one.model]} {one.aicc:.1f}" for one in ranked if one.aicc < float("inf"))
    middle, low, high = (float(values[0]) for values in fit.at([points["triangles"].median()]))
    text = (
        f" Of three curves through the {len(points)} ray-space points AICc prefers {CURVES[fit.model]} "
        f"({scores}; less is better), drawn with its 95 % interval: {middle:.2g}× ({low:.2g} to {high:.2g}) "
        f"at the middle scene. As a power of the triangles the speed-up goes as {power.median:.2f} "
        f"({power.low:.2f} to {power.high:.2f}); near-linear would be about 1."
    ).replace("-0.", "−0.")
    return text + (" So few scenes show no trend beyond their scatter." if fit.model == "constant" else "")


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """A point with its interval for each scene and series; machines side by side, each with its mark and curve."""
    machines = by_machine(numbers)
    figure = style.canvas((3.7 if narrow else 3.5) + 0.3 * (len(machines) - 1), narrow)
    axis = figure.subplots()
    claim = runs.published["claims"]["intersection_speedup"]
    axis.axhline(1, color=style.INK, linewidth=0.9)
    axis.axhline(claim["value"], color=style.PINK, linewidth=1.1, linestyle=(0, (5, 2)))
    curves = [_curve(axis, own, style.MACHINE_LOOKS[place % 4][2]) for place, (_, own) in enumerate(machines)]
    width = float(np.log(2.56 * numbers["triangles"].max() / numbers["triangles"].min()))
    for place, (machine, own) in enumerate(machines):
        for number, (keys, series) in enumerate(own.groupby(["intersector", "baseline"], sort=False)):
            _series(axis, series, *keys, number, (place, len(machines)) if machine else None, width)
    _limits(axis, numbers, claim["value"])
    _notes(axis, claim["text"])
    _scene_names(axis, numbers, narrow)
    handles, labels = axis.get_legend_handles_labels()
    if machines[0][0]:
        handles, labels = _machine_legend(numbers, any(curves), 34 if narrow else 50)
    figure.legend(handles, labels, loc="outside lower center", ncols=1 if narrow else 2)
    return figure


def _curve(axis, numbers: pd.DataFrame, line: str) -> bool:
    """The preferred curve with its band, and how a speed-up in proportion to size would go; whether there is one."""
    found = fitted_curve(numbers)
    if found is None:
        return False
    fit, _, points = found
    sizes = np.geomspace(points["triangles"].min() / 1.2, points["triangles"].max() * 1.2, 60)
    middle, low, high = fit.at(sizes)
    axis.fill_between(sizes, low, high, color=style.BLUE, alpha=0.1, linewidth=0, zorder=1)
    axis.plot(
        sizes,
        middle,
        color=style.BLUE,
        linewidth=1.1,
        zorder=2,
        linestyle=line,
        label=f"{CURVES[fit.model]} through the ray-space points, 95 % interval",
    )
    centre = np.exp(np.log(points[["triangles", "speedup"]]).mean())
    axis.plot(
        sizes,
        centre["speedup"] * sizes / centre["triangles"],
        color=style.MUTED,
        linewidth=1,
        linestyle=":",
        label="in proportion to size",
        zorder=1.5,
    )
    return True


def _series(
    axis,
    series: pd.DataFrame,
    intersector: str,
    baseline: str,
    number: int,
    place: tuple[int, int] | None,
    width: float,
) -> None:
    """One intersector over one baseline; `place`: which machine of how many, where there are several.

    `width`: of the axis of sizes, as a natural logarithm, so that marks beside one another keep their distance.
    """
    colour, marker = style.intersector_look(intersector, number)
    hollow = baseline == STRONGEST
    shift = {"ray-space": 0.985, "moller-trumbore": 1.015}.get(intersector, 1.0)
    if place:
        marker = style.machine_look(place[0])[1]
        shift = (shift * 1.07 ** (place[0] - (place[1] - 1) / 2)) ** (width / 4.4)
    axis.errorbar(
        series["triangles"] * shift,
        series["speedup"],
        yerr=style.errors(series, "speedup"),
        fmt=marker,
        color=colour,
        markerfacecolor=style.PAGE if hollow else colour,
        label=_series_title(intersector, hollow),
        markersize=5.5,
        elinewidth=1,
        zorder=3 if hollow else 4,
    )


def _series_title(intersector: str, hollow: bool) -> str:
    name = style.intersector_title(intersector)
    return f"{name}, over the fastest work-optimal variant" if hollow else f"{name}, both sides"


def _machine_legend(numbers: pd.DataFrame, curves: bool, width: int) -> tuple[list[Line2D], list[str]]:
    """Colours by intersector, filled or hollow by baseline; the marks and lines of the machines in grey."""
    found = {}
    for place, machine in enumerate(dict.fromkeys(numbers["machine"])):
        _, mark, line = style.MACHINE_LOOKS[place % len(style.MACHINE_LOOKS)]
        found[textwrap.fill(machine, width)] = Line2D(
            [], [], color=style.MUTED, marker=mark, linestyle=line if curves else "none"
        )
    for intersector, baseline in dict.fromkeys(zip(numbers["intersector"], numbers["baseline"], strict=True)):
        colour, _ = style.intersector_look(intersector)
        hollow = baseline == STRONGEST
        found[_series_title(intersector, hollow)] = Line2D(
            [], [], color=colour, linestyle="none", marker="o", markerfacecolor=style.PAGE if hollow else colour
        )
    if curves:
        found["curve through a machine's ray-space points, 95 % interval"] = Line2D([], [], color=style.BLUE)
        found["in proportion to size"] = Line2D([], [], color=style.MUTED, linestyle=":", linewidth=1)
    return list(found.values()), list(found)


def _limits(axis, numbers: pd.DataFrame, claim: float) -> None:
    small, large = numbers["triangles"].min(), numbers["triangles"].max()
    low = min(0.8, numbers["speedup"].min() / 1.3, numbers["speedup_low"].min() / 1.1)
    high = max(claim * 1.5, numbers["speedup"].max() * 1.3, numbers["speedup_high"].max() * 1.1)
    axis.set(
        xscale="log",
        yscale="log",
        xlim=(small / 1.6, large * 1.6),
        ylim=(low, high),
        xlabel="scene size (triangles)",
        ylabel="speed-up of intersection (×)",
    )
    style.log_axis(axis.xaxis, small / 1.6, large * 1.6)
    style.log_axis(axis.yaxis, low, high)
    axis.grid(axis="y")


def _notes(axis, claim: str) -> None:
    """The two lines are named beside the plot, where no mark can lie under the words."""
    across = axis.get_yaxis_transform()
    place = float(axis.lines[1].get_ydata()[0])
    axis.text(
        1.015,
        place,
        claim.replace(": ", ":\n"),
        transform=across,
        va="center",
        color=style.PINK,
        fontsize=7.5,
        linespacing=1.1,
    )
    axis.text(1.015, 1, "equal", transform=across, va="center", fontsize=7.5)


def _scene_names(axis, numbers: pd.DataFrame, narrow: bool) -> None:
    """Names over the plot, moved apart where scenes are of about one size, each led to its place."""
    scenes = numbers.drop_duplicates("scene").sort_values("triangles")
    to_axis = axis.transScale + axis.transLimits
    places = [float(to_axis.transform((size, 1))[0]) for size in scenes["triangles"]]
    moved = style.spread(places, 0.075 if narrow else 0.045, 0.0, 1.0)
    for name, place, over in zip(scenes["scene"], places, moved, strict=True):
        axis.plot(
            [place, place, over],
            [0, 1, 1.03],
            transform=axis.transAxes,
            color=style.RULE,
            linewidth=0.6,
            clip_on=False,
            zorder=0.5,
        )
        axis.text(
            over,
            1.04,
            name,
            transform=axis.transAxes,
            rotation=38,
            ha="left",
            va="bottom",
            rotation_mode="anchor",
            fontsize=7.5,
        )


FIGURE = Figure(
    name="intersection_speedup",
    section="Figure 1 of the paper",
    title="Diffuse intersection: speed-up over work-optimal forward intersection",
    needs="diffuse runs of the deferred and the work-optimal tracer, default options, on one grid",
    machines=Machines.TOGETHER,
    select=select,
    caption=caption,
    draw=draw,
)
