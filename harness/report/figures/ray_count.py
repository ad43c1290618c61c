"""Time and rate against the number of rays, everything else equal: from too few rays to fill a wave to millions."""

from __future__ import annotations

import pandas as pd

from harness.analysis.ratios import robust_embree
from harness.analysis.results import Results
from harness.report.entry import Figure
from harness.report.figures import style
from harness.report.figures.powers import power_text, with_power
from harness.report.figures.size_ladder import SPARE
from harness.stats import interval

TRACERS = {"deferred": ("-", True), "embree": (":", False)}  # line, filled marks
TITLES = {"deferred": "deferred", "embree": "Embree"}
MANY = 1_000_000  # rays from which on the power is fitted too: waves are full there
PANELS = (("seconds", "whole trace (s)"), ("ns_per_ray", "nanoseconds per ray"))


def select(runs: Results) -> pd.DataFrame:
    """One row a scene, tracer and number of rays; scenes where the deferred tracer traced three numbers or more."""
    rows = runs.every_diffuse
    deferred = (
        (rows["tracer"] == "deferred")
        & (rows["intersector"] == "ray-space")
        & (rows["options"] == "")
        & (rows["grid"] == runs.grid)
    )
    rows = pd.concat([rows[deferred], robust_embree(rows)])
    # One repetition has no interval: those runs, of a few hundred rays, are there to be held against brute force.
    rows = rows[rows["total"].notna() & (rows["repetitions"] > 1)]
    rows = rows.sort_values("beside", key=lambda name: name != runs.grid, kind="stable")  # Embree's beside ours first
    rows = rows.drop_duplicates(["scene", "view", "seed", "tracer", "rays"])
    found = []
    for _, scene in rows.groupby("scene", sort=False):
        ours = scene[scene["tracer"] == "deferred"]
        if ours.empty:
            continue
        _, work = max(ours.groupby(["view", "seed"], sort=False), key=lambda work: work[1]["rays"].nunique())
        if work["rays"].nunique() < 3:
            continue
        same = scene[
            (scene["view"] == work["view"].iloc[0])
            & (scene["seed"] == work["seed"].iloc[0])
            & scene["rays"].isin(work["rays"])
        ]
        found += [_numbers(run) for _, run in same.sort_values(["tracer", "rays"]).iterrows()]
    return _fitted(pd.DataFrame(found)) if found else pd.DataFrame()


def _numbers(run: pd.Series) -> dict:
    seconds = interval(run["record"].samples.total)
    row = {"scene": run["title"], "name": run["scene"], "tracer": run["tracer"], "rays": run["rays"]}
    for end, value in (("", seconds.median), ("_low", seconds.low), ("_high", seconds.high)):
        row |= {f"seconds{end}": value, f"ns_per_ray{end}": 1e9 * value / run["rays"]}
    return row | {"grid": run["grid"], "runs": run["run"]}


def _fitted(numbers: pd.DataFrame) -> pd.DataFrame:
    """`numbers` with the power of rays that each tracer's time goes as, over all rays and over MANY or more."""
    numbers = with_power(numbers, "tracer", "rays", "seconds", "exponent")
    return with_power(numbers, "tracer", "rays", "seconds", "exponent_many", least=MANY)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is held fixed, and the powers."""
    text = (
        "Each line is one scene: view, grid and options stay the same, and more rays are more pixels of the same "
        "image. Solid and filled: deferred; dotted and hollow: Embree. Bars are 95 % intervals, both axes are "
        "logarithmic, and a tracer whose cost is in proportion to its rays is level on the right."
    )
    for tracer, rows in numbers.groupby("tracer", sort=False):
        text += _sentence(tracer, rows.iloc[0])
    grids = [grid for grid in dict.fromkeys(numbers["grid"]) if grid]
    return (
        f"{text} Powers are fitted with a factor for each scene, with Student's 95 % intervals. More "
        "rays than a batch are traced batch after batch, in the same device memory. "
        f"Grid {', '.join(grids)}."
    )


def _sentence(tracer: str, row: pd.Series) -> str:
    if pd.isna(row.get("exponent")):
        return ""
    text = f" The time of {TITLES[tracer]} goes as the power {power_text(row, 'exponent')} of the number of rays"
    if not pd.isna(row.get("exponent_many")):
        text += f", from a million on {power_text(row, 'exponent_many')}"
    return text + "."


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """Two panels: seconds, and nanoseconds a ray."""
    figure = style.canvas(5.6 if narrow else 3.4, narrow)
    axes = figure.subplots(2, 1, sharex=True) if narrow else figure.subplots(1, 2)
    spare = iter(SPARE * len(numbers))
    looks = {name: style.SCENE_LOOKS.get(name) or next(spare) for name in dict.fromkeys(numbers["name"])}
    for axis, (column, label) in zip(axes, PANELS, strict=True):
        for (name, tracer), rows in numbers.groupby(["name", "tracer"], sort=False):
            _line(axis, rows, column, tracer, looks[name])
        _axis(axis, numbers, column, label)
    for line, tracer in enumerate(tracer for tracer in TRACERS if tracer in set(numbers["tracer"])):
        row = numbers[numbers["tracer"] == tracer].iloc[0]
        if not pd.isna(row.get("exponent")):
            axes[0].text(
                0.02,
                1.09 - 0.06 * line,
                f"{TITLES[tracer]}: power {power_text(row, 'exponent')}",
                transform=axes[0].transAxes,
                fontsize=7.5,
                color=style.MUTED,
            )
    for axis in axes[-1:] if narrow else axes:
        axis.set_xlabel("rays")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2 if narrow else 4)
    return figure


def _line(axis, rows: pd.DataFrame, column: str, tracer: str, look: tuple[str, str]) -> None:
    (colour, marker), (line, filled) = look, TRACERS[tracer]
    axis.errorbar(
        rows["rays"],
        rows[column],
        yerr=style.errors(rows, column),
        color=colour,
        marker=marker,
        markerfacecolor=colour if filled else style.PAGE,
        markersize=4.5,
        elinewidth=0.8,
        linewidth=1.2,
        linestyle=line,
        label=f"{rows['scene'].iloc[0]}, {TITLES[tracer]}",
    )


def _axis(axis, numbers: pd.DataFrame, column: str, label: str) -> None:
    small, large = numbers["rays"].min() / 1.6, numbers["rays"].max() * 1.6
    low, high = numbers[f"{column}_low"].min() / 1.3, numbers[f"{column}_high"].max() * 1.3
    axis.set(xscale="log", yscale="log", xlim=(small, large), ylim=(low, high), ylabel=label)
    style.log_axis(axis.xaxis, small, large)
    style.log_axis(axis.yaxis, low, high)
    axis.grid(axis="y")


FIGURE = Figure(
    name="ray_count",
    section="Number of rays",
    title="Time over the number of rays of one scene",
    needs="diffuse runs of the deferred tracer with at least three numbers of rays on one scene and grid",
    select=select,
    caption=caption,
    draw=draw,
)
