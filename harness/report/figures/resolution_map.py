"""Rate and memory over the resolutions of both levels, as a map."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.patches import Rectangle

from harness.analysis.names import three_digits
from harness.analysis.ratios import rays_note
from harness.analysis.results import Results
from harness.records.run_row import Record
from harness.report.entry import Figure
from harness.report.figures import style

VALUES = (("rate_mrays_per_s", "million rays/s", style.BLUE), ("grid_megabytes", "MB", style.ORANGE))


def select(runs: Results) -> pd.DataFrame:
    """One row a grid of each scene measured on a map of them, at the workload that most grids share."""
    rows = runs.every_diffuse
    rows = rows.assign(chosen=rows["record"].map(is_chosen).astype(bool))
    # A chosen grid comes with the options chosen for it.
    rows = rows[
        (rows["tracer"] == "deferred")
        & (rows["intersector"] == "ray-space")
        & rows["total"].notna()
        & ((rows["options"] == "") | rows["chosen"])
        & rows["reading"].isin(("total", "adaptive"))
    ]
    kept = []
    for _, scene in rows.groupby("scene", sort=False):
        works = [work for _, work in scene.groupby(["view", "rays", "seed"], sort=True)]
        most = max(works, key=lambda work: (_extent(work), work["rays"].iloc[0]))
        if _extent(most):
            kept += _scene(most)
    return pd.DataFrame(kept)


def _extent(work: pd.DataFrame) -> int:
    """Number of uniform grids where both levels vary, else 0."""
    uniform = work[work["reading"] == "total"]
    varied = uniform["top"].nunique() > 1 and uniform["leaf"].nunique() > 1
    return len(uniform.drop_duplicates(["top", "leaf"])) if varied else 0


def _scene(work: pd.DataFrame) -> list[dict]:
    rows = [
        {
            "scene": run["title"],
            "grid": run["grid"],
            "first_level": int(run["top"]),
            "second_level": int(run["leaf"]),
            "reading": run["reading"],
            "rate_mrays_per_s": run["total"],
            "rate_mrays_per_s_low": run["total_low"],
            "rate_mrays_per_s_high": run["total_high"],
            "grid_megabytes": run["grid_megabytes"],
            "chosen": bool(run["chosen"]),
            "rays": run["rays"],
            "runs": run["run"],
        }
        for _, run in work.iterrows()
    ]
    fastest = max((row["rate_mrays_per_s"] for row in rows if row["reading"] == "total"), default=0)
    return [row | {"fastest": row["reading"] == "total" and row["rate_mrays_per_s"] == fastest} for row in rows]


def is_chosen(record: Record) -> bool:
    """Whether the run's grid was chosen by the harness (`--grid auto`), as its record says."""
    return record.grid is not None and bool(record.grid.chosen)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What the axes are and what is marked."""
    text = (
        "Deferred tracer, diffuse rays, default options. Across: leaf cells an axis over the whole scene; "
        "upwards: cells an axis of the first level. Left, median rate of the whole trace; right, bytes of the "
        "grid; each map has its own scale, logarithmic, darker is more. Framed: the fastest uniform grid "
        "measured; dotted: the paper's 8/128."
    )
    if numbers["chosen"].any():
        text += " A star marks the grid that the harness chooses by itself."
    if (numbers["reading"] == "adaptive").any():
        text += " Beneath each map: the adaptive grid, whose second level follows the density of triangles."
    return f"{text} {rays_note(numbers)} Intervals stand in the table."


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """A row a scene: the map of rates, and that of memory beside it; two scenes a row on a wide page."""
    scenes = [rows for _, rows in numbers.groupby("scene", sort=False)]
    across = 1 if narrow or len(scenes) == 1 else 2
    down = -(-len(scenes) // across)
    tallest = max(rows.loc[rows["reading"] == "total", "first_level"].nunique() for rows in scenes)
    figure = style.canvas(down * (0.95 + 0.24 * tallest) + 0.1, narrow)
    axes = np.atleast_2d(figure.subplots(down, 2 * across, squeeze=False))
    places = axes.reshape(-1, 2)
    for number, pair in enumerate(places):
        if number >= len(scenes):
            for axis in pair:
                axis.set_axis_off()
            continue
        for axis, (column, label, colour) in zip(pair, VALUES, strict=True):
            _map(axis, scenes[number], column, label, colour)
        pair[0].set_ylabel("first level")
        pair[0].set_title(scenes[number]["scene"].iloc[0], loc="left", pad=12)
    return figure


def _map(axis, scene: pd.DataFrame, column: str, label: str, colour: str) -> None:
    """One map with its number in each cell, and marks on those that stand out."""
    uniform = scene[scene["reading"] == "total"]
    table = uniform.pivot_table(index="first_level", columns="second_level", values=column)
    values = table.to_numpy()
    low, high = np.nanmin(values), np.nanmax(values)
    shade = LinearSegmentedColormap.from_list("shade", [style.PAPER, style.fixed_colour(colour)])
    norm = LogNorm(low / 1.6, max(high, low * 1.05))
    axis.pcolormesh(values, cmap=shade, norm=norm, edgecolors=style.PAGE, linewidth=0.8)
    for (row, place), value in np.ndenumerate(values):
        if np.isfinite(value):
            dark = norm(value) > 0.75 and colour == style.BLUE
            axis.text(
                place + 0.5,
                row + 0.5,
                three_digits(value),
                ha="center",
                va="center",
                fontsize=6.5,
                color=style.PAPER if dark else style.PRINT,
            )
    tops, leaves = list(table.index), list(table.columns)
    axis.set(
        xticks=np.arange(len(leaves)) + 0.5,
        yticks=np.arange(len(tops)) + 0.5,
        xlim=(0, len(leaves)),
        ylim=(0, len(tops)),
        xticklabels=[f"{leaf}" for leaf in leaves],
        yticklabels=[f"{top}" for top in tops],
    )
    axis.tick_params(length=0)
    for side in ("left", "bottom"):
        axis.spines[side].set_visible(False)
    axis.annotate(
        label,
        (1, 1),
        (0, 3),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=7,
        color=style.MUTED,
    )
    axis.set_xlabel(_below(scene, column), fontsize=7)
    _marks(axis, uniform, tops, leaves)


def _marks(axis, uniform: pd.DataFrame, tops: list, leaves: list) -> None:
    for row in uniform.itertuples():
        place = leaves.index(row.second_level), tops.index(row.first_level)
        if (row.first_level, row.second_level) == (8, 128):
            axis.add_patch(
                Rectangle(
                    place,
                    1,
                    1,
                    fill=False,
                    edgecolor=style.PINK,
                    linestyle=":",
                    linewidth=1.4,
                    clip_on=False,
                    zorder=4,
                )
            )
        if row.fastest:
            axis.add_patch(
                Rectangle(place, 1, 1, fill=False, edgecolor=style.INK, linewidth=1.4, clip_on=False, zorder=3)
            )
        if row.chosen:
            axis.plot([place[0] + 0.88], [place[1] + 0.82], marker="*", color=style.INK, markersize=5, zorder=5)


def _below(scene: pd.DataFrame, column: str) -> str:
    """The axis's name, and the values of the fastest adaptive grid and of the chosen one where they were measured."""
    text = "second level"
    for name, rows in (
        ("adaptive", scene[(scene["reading"] == "adaptive") & ~scene["chosen"]]),
        ("★ chosen", scene[(scene["reading"] == "adaptive") & scene["chosen"]]),
    ):
        if len(rows):
            best = rows.loc[rows["rate_mrays_per_s"].idxmax()]
            text += f"\n{name}: {three_digits(best[column])}"
    return text


FIGURE = Figure(
    name="resolution_map",
    section="Resolution of the grid",
    title="Rate and memory over the resolutions of both levels",
    needs="diffuse runs of the deferred tracer, default options, on grids of two or more first and second levels",
    select=select,
    caption=caption,
    draw=draw,
)
