"""Rate and speed-up against the size of the scene, everything else equal: the rungs of each scene."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import scene_and_size
from harness.analysis.ratios import best, speedup
from harness.analysis.results import Results
from harness.report.entry import Figure
from harness.report.figures import style
from harness.report.figures.powers import power_text, with_power

REAL, STAND_IN = "real geometry", "stand-in"
SPARE = ((style.SKY, "P"), (style.GREY, "X"))
PANELS = (
    ("rate_mrays_per_s", "deferred, whole trace\n(million rays/s)"),
    ("speedup", "speed-up of intersection\nover work-optimal (×)"),
)


def select(runs: Results) -> pd.DataFrame:
    """Rate and speed-up of every rung of the scenes that have three or more, one workload and grid a scene."""
    rows = runs.valid
    rows = rows[
        (rows["kind"] == "diffuse")
        & (rows["options"] == "")
        & (rows["intersector"] == "ray-space")
        & rows["tracer"].isin(("deferred", "work-optimal"))
    ].copy()
    rows["base"] = [scene_and_size(name)[0] for name in rows["scene"]]
    kept = []
    for _, ladder in rows.groupby("base", sort=False):
        most = ladder.groupby(["rays", "seed", "view", "grid"])["scene"].nunique()
        if len(most) and most.max() >= 3:
            rays, seed, view, grid = most[most == most.max()].index[-1]
            same = ladder[
                (ladder["rays"] == rays)
                & (ladder["seed"] == seed)
                & (ladder["view"] == view)
                & (ladder["grid"] == grid)
            ]
            kept += [_numbers(resized) for _, resized in same.sort_values("triangles").groupby("scene", sort=False)]
    numbers = pd.DataFrame([row for row in kept if row])
    return _fitted(numbers) if len(numbers) else numbers


def _numbers(resized: pd.DataFrame) -> dict | None:
    """One row of one rung; None where the deferred tracer has no rate there."""
    run = best(resized[resized["tracer"] == "deferred"])
    if run is None:
        return None
    base = best(resized[resized["tracer"] == "work-optimal"], "intersect")
    found = (speedup(run["record"], base["record"], "intersect") if base is not None else None) or {}
    return {
        "scene": run["base"],
        "kind": STAND_IN if run["source"] == "stand-in" else REAL,
        "size": run["size"],
        "title": run["title"],
        "triangles": run["triangles"],
        "rate_mrays_per_s": run["total"],
        "rate_mrays_per_s_low": run["total_low"],
        "rate_mrays_per_s_high": run["total_high"],
        **{
            key.replace("ratio", "speedup"): found.get(key, float("nan"))
            for key in ("ratio", "ratio_low", "ratio_high")
        },
        "grid": run["grid"],
        "rays": run["rays"],
        "runs": " ".join([run["run"]] + ([base["run"]] if base is not None else [])),
    }


def _fitted(numbers: pd.DataFrame) -> pd.DataFrame:
    """`numbers` with the power of triangles that each panel's value goes as, of either kind of scene."""
    for column, _ in PANELS:
        numbers = with_power(numbers, "kind", "triangles", column, f"{column}_exponent")
    return numbers


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is held fixed, and the exponents."""
    text = (
        "Each line is one scene in several sizes: decimated to 1/64, 1/16 and 1/4 of its triangles, whole, and "
        "for stand-ins cut into 4 times as many; view, rays and grid stay the same. Filled and solid: real "
        "geometry; hollow and dashed: stand-ins. Bars are 95 % intervals; both axes are logarithmic."
    )
    for column, name in (("rate_mrays_per_s", "the rate"), ("speedup", "the speed-up")):
        parts = [
            f"{power} for {'stand-ins' if kind == STAND_IN else kind}" for kind, power in _powers(numbers, column)
        ]
        if parts:
            text += f" Over triangles, {name} goes as the power {' and '.join(parts)}"
            text += ", fitted with a factor for each scene, with Student's 95 % intervals over the rungs."
    grids, rays = sorted(set(numbers["grid"])), sorted(set(numbers["rays"]))
    return f"{text} Grid {', '.join(grids)}. Rays: {', '.join(f'{count:,}' for count in rays)}."


def _powers(numbers: pd.DataFrame, column: str) -> list[tuple[str, str]]:
    """Each kind that has a power, and the power with its interval as text."""
    name = f"{column}_exponent"
    if name not in numbers:
        return []
    return [(kind, power_text(rows.iloc[0], name)) for kind, rows in numbers.dropna(subset=[name]).groupby("kind")]


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """Two panels: rate, and speed-up."""
    figure = style.canvas(5.6 if narrow else 3.4, narrow)
    axes = figure.subplots(2, 1, sharex=True) if narrow else figure.subplots(1, 2)
    names = list(dict.fromkeys(numbers["scene"]))
    spare = iter(SPARE * len(names))
    looks = {name: style.SCENE_LOOKS.get(name) or next(spare) for name in names}
    for axis, (column, label) in zip(axes, PANELS, strict=True):
        for (_, kind), rows in numbers.dropna(subset=[column]).groupby(["scene", "kind"], sort=False):
            _line(axis, rows, column, kind, looks[rows["scene"].iloc[0]])
        _axis(axis, numbers, column, label)
    for axis in axes[-1:] if narrow else axes:
        axis.set_xlabel("triangles")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2 if narrow else 5)
    return figure


def _line(axis, rows: pd.DataFrame, column: str, kind: str, look: tuple[str, str]) -> None:
    colour, marker = look
    whole = rows[rows["size"] == "1"]
    title = (whole if len(whole) else rows)["title"].iloc[0].split(" at ")[0]
    if kind == STAND_IN and "stand-in" not in title:
        title += " (stand-in)"
    axis.errorbar(
        rows["triangles"],
        rows[column],
        yerr=style.errors(rows, column),
        color=colour,
        marker=marker,
        markerfacecolor=colour if kind == REAL else style.PAGE,
        markersize=4.5,
        elinewidth=0.8,
        linewidth=1.2,
        linestyle="-" if kind == REAL else "--",
        label=title,
    )


def _axis(axis, numbers: pd.DataFrame, column: str, label: str) -> None:
    values = pd.concat([numbers[column], numbers[f"{column}_high"], numbers[f"{column}_low"]]).dropna()
    small, large = numbers["triangles"].min() / 1.6, numbers["triangles"].max() * 1.6
    axis.set(xscale="log", yscale="log", xlim=(small, large), ylabel=label)
    if len(values):
        # A long interval downwards may leave the picture; the mark it belongs to may not.
        low, high = max(values.min() / 1.2, numbers[column].min() / 3), values.max() * 1.2
        axis.set_ylim(low, high)
        style.log_axis(axis.yaxis, low, high)
    if column == "speedup":
        axis.axhline(1, color=style.INK, linewidth=0.9)
    style.log_axis(axis.xaxis, small, large)
    for line, (kind, power) in enumerate(_powers(numbers, column)):
        axis.text(
            0.02,
            1.09 - 0.06 * line,
            f"{kind}: power {power}",
            transform=axis.transAxes,
            fontsize=7.5,
            color=style.MUTED,
        )
    axis.grid(axis="y")


FIGURE = Figure(
    name="size_ladder",
    section="Size of the scene",
    title="Rate and speed-up over the number of triangles of one scene",
    needs="diffuse runs of the deferred and the work-optimal tracer on at least three sizes of one scene, on one "
    "grid",
    select=select,
    caption=caption,
    draw=draw,
)
