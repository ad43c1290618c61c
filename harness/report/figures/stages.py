"""Where the time of a ray goes: traverse, arrange, intersect, compact, other."""

from __future__ import annotations

import pandas as pd
from matplotlib.ticker import MaxNLocator, StrMethodFormatter

from harness.analysis.names import SAME_WORK, three_digits
from harness.analysis.ratios import best, stage_nanoseconds
from harness.analysis.results import Results
from harness.report.entry import Figure
from harness.report.figures import style

MOST_VARIANTS = 6
TRACERS = ("deferred", "work-optimal", "forward")


def select(runs: Results) -> pd.DataFrame:
    """Median nanoseconds a ray by stage, for runs on the grid of figure 1 and the fastest deferred run."""
    rows = []
    for _, scene in runs.diffuse.groupby("scene", sort=False):
        paper = runs.paper[runs.paper["scene"] == scene["scene"].iloc[0]]
        chosen = [run for tracer in TRACERS for run in _variants(paper, tracer)]
        fastest = best(scene[scene["tracer"] == "deferred"])
        if fastest is not None and fastest["run"] not in {run["run"] for run in chosen}:
            chosen.insert(0, fastest)
        rows += [_numbers(run) for run in chosen]
    return pd.DataFrame(rows)


def _variants(paper: pd.DataFrame, tracer: str) -> list[pd.Series]:
    """Default runs first, then the fastest others: at most six of the deferred tracer, three of others."""
    rows = paper[(paper["tracer"] == tracer) & paper["total"].notna()].drop_duplicates([*SAME_WORK, "label"])
    defaults = rows[rows["options"] == ""]
    others = rows[rows["options"] != ""].sort_values("total", ascending=False)
    ordered = pd.concat([defaults, others]).head(MOST_VARIANTS if tracer == "deferred" else 3)
    return [run for _, run in ordered.iterrows()]


def _numbers(run: pd.Series) -> dict:
    times = stage_nanoseconds(run["record"])
    return {
        "scene": run["title"],
        "variant": run["label"],
        "tracer": run["tracer"],
        "grid": run["grid"],
        **{f"{stage}_ns": value for stage, value in times.items()},
        "rays": run["rays"],
        "runs": run["run"],
    }


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What other means."""
    return (
        "Median nanoseconds a ray: wall-clock time of the whole trace over the number of rays, split by "
        "the device time of each stage. Other is what no stage accounts for: launches, waiting, and the "
        "whole of a tracer that has no stages. Each scene has its own axis. "
        f"{runs.grid_note()} Another grid is named under its variant."
    )


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """Stacked horizontal bars, a panel a scene."""
    scenes = [rows for _, rows in numbers.groupby("scene", sort=False)]
    names = [[_row_name(row, runs.grid, narrow) for row in rows.itertuples()] for rows in scenes]
    heights = [sum(map(_height, rows)) + 1.9 for rows in names]
    figure = style.canvas(0.55 + 0.17 * sum(heights), narrow)
    axes = figure.subplots(len(scenes), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axis, scene, rows in zip(axes, scenes, names, strict=True):
        _panel(axis, scene, rows, narrow)
    axes[-1].set_xlabel("nanoseconds per ray")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3 if narrow else 5)
    return figure


def _height(name: str) -> float:
    """Room for a row, in rows of one line."""
    return 1.0 + 0.72 * name.count("\n")


def _panel(axis, scene: pd.DataFrame, names: list[str], narrow: bool) -> None:
    left = pd.Series(0.0, index=scene.index)
    heights = [_height(name) for name in names]
    places = [sum(heights[:row]) + height / 2 for row, height in enumerate(heights)]
    for stage, colour in style.STAGE_COLOURS.items():
        width = scene[f"{stage}_ns"]
        axis.barh(places, width, left=left, height=0.7, color=colour, label=stage)
        left = left + width
    for place, end in zip(places, left, strict=True):
        axis.annotate(three_digits(end), (end, place), (3, 0), textcoords="offset points", va="center", fontsize=7)
    axis.set_title(scene["scene"].iloc[0], loc="left", pad=2)
    axis.set(
        ylim=(sum(heights) + 0.1, -0.1),
        xlim=(0, left.max() * (1.16 if narrow else 1.09)),
        yticks=places,
        yticklabels=names,
    )
    axis.tick_params(axis="y", length=0, labelsize=7)
    axis.grid(axis="x")
    axis.xaxis.set_major_locator(MaxNLocator(5 if narrow else 8))
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))


def _row_name(row, usual: str, narrow: bool) -> str:
    """The variant, broken before an option where it is wider than its column, and its grid where it is another."""
    lines = [""]
    for part in row.variant.replace(":", " :").split():
        if lines[-1] and len(lines[-1]) + len(part) > (24 if narrow else 36):
            lines.append("")
        lines[-1] += part
    return "\n".join(lines if row.grid == usual else [*lines, f"grid {row.grid}"])


FIGURE = Figure(
    name="stages",
    section="Time by stage",
    title="Time of a ray, split by stage",
    needs="diffuse runs with timed stages",
    select=select,
    caption=caption,
    draw=draw,
)
