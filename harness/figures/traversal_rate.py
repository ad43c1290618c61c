"""Figure 1, bottom: the rate of diffuse traversal beside the paper's."""

from __future__ import annotations

import textwrap

import numpy as np
import pandas as pd

from harness.figures import style
from harness.figures.runs import Runs, main_workload, rays_note

ORDER = 30
SECTION = "Figure 1 of the paper"
TITLE = "Diffuse traversal"
NEEDS = "diffuse runs of the deferred tracer with default options"
PAPER = "paper"


def select(runs: Runs) -> pd.DataFrame:
    """Traversal rate of the default deferred tracer for every scene and reading, and the paper's."""
    ours = {"total": runs.grid, "per-cell": runs.paper_grid.replace("total", "per-cell")}
    if runs.grid != runs.paper_grid:
        ours = {"": runs.grid}
    rows = [_ours(run) for grid in ours.values() for _, run in _candidates(runs, grid).iterrows()]
    for scene in dict.fromkeys(row["name"] for row in rows):
        known = runs.published_scene(scene)
        if known and "traverse_mrays" in known:
            title = next(row["scene"] for row in rows if row["name"] == scene)
            rows.append({"scene": title, "series": PAPER, "grid": runs.paper_grid, "rays": None,
                         "traversal_mrays_per_s": known["traverse_mrays"], "intersector": "",
                         "measured_on": f"its GPU ({known['place']})", "name": scene, "runs": ""})
    return pd.DataFrame(rows)


def _candidates(runs: Runs, grid: str) -> pd.DataFrame:
    """Default deferred runs on a grid; the paper's intersector first, for the walk is the same."""
    rows = runs.every_diffuse
    here = ((rows["tracer"] == "deferred") & (rows["options"] == "") & (rows["grid"] == grid)
            & rows["traverse"].notna())
    chosen = main_workload(rows[here])
    order = (chosen["intersector"] != "ray-space").sort_values(kind="stable").index
    return chosen.loc[order].drop_duplicates("scene").sort_index()


def _ours(run: pd.Series) -> dict:
    return {"scene": run["title"], "series": "ours", "grid": run["grid"], "rays": run["rays"],
            "traversal_mrays_per_s": run["traverse"], "traversal_mrays_per_s_low": run["traverse_low"],
            "traversal_mrays_per_s_high": run["traverse_high"], "intersector": run["intersector"],
            "measured_on": run["device"], "name": run["scene"], "runs": run["run"]}


def caption(runs: Runs, numbers: pd.DataFrame) -> str:
    """Whose device is whose."""
    text = ("Figure 1, bottom. Rays a second through the traversal stage of the deferred tracer, diffuse "
            "rays, logarithmic axis, with 95 % intervals.")
    if numbers["grid"].str.endswith("per-cell").any():
        text += (" The paper's 8³ and 128³ can be read as 128 cells an axis over the scene (total) or inside "
                 "each first-level cell (per cell); both are drawn.")
    text += f" {runs.grid_note()} {rays_note(numbers)}"
    if (numbers["series"] == PAPER).any():
        text += (" The paper's rates are from its own GPU, which it does not name: they stand beside ours "
                 "and make no ratio with them.")
    return text


def draw(runs: Runs, numbers: pd.DataFrame, narrow: bool):
    """Horizontal bars, a group a scene, the number at each bar's end."""
    series = _series(numbers, textwrap.fill(runs.device, 30 if narrow else 60))
    scenes = list(dict.fromkeys(numbers["scene"]))
    figure = style.canvas(0.75 + 0.2 * len(series) * len(scenes) + 0.14 * len(scenes), narrow)
    axis = figure.subplots()
    value = numbers["traversal_mrays_per_s"]
    low = 10 ** np.floor(np.log10(value.min() / 1.5))
    for number, (mask, label, look) in enumerate(series):
        rows = numbers[mask]
        places = [scenes.index(name) + (number - (len(series) - 1) / 2) * 0.8 / len(series)
                  for name in rows["scene"]]
        _bars(axis, rows, places, 0.72 / len(series), low, label, look)
    high = value.max() * (4.5 if narrow else 2.2)
    axis.set(xscale="log", xlim=(low, high), ylim=(len(scenes) - 0.45, -0.55),
             xlabel="diffuse traversal (million rays per second)", yticks=range(len(scenes)),
             yticklabels=[name.replace(" (stand-in)", "\n(stand-in)") for name in scenes])
    style.log_axis(axis.xaxis, low, high, sparse=True)
    axis.tick_params(axis="y", length=0)
    axis.grid(axis="x")
    figure.legend(loc="outside lower center", ncols=1)
    return figure


def _series(numbers: pd.DataFrame, device: str) -> list[tuple]:
    """Which rows, under what name, with what look; only series that have rows."""
    ours = {"facecolor": style.BLUE, "edgecolor": style.BLUE}
    finer = {"facecolor": style.SKY, "edgecolor": style.SKY}
    paper = {"facecolor": style.PAGE, "edgecolor": style.PINK, "hatch": "////"}
    mine, per_cell = numbers["series"] == "ours", numbers["grid"].str.endswith("per-cell")
    found = [(mine & ~per_cell, device, ours),
             (mine & per_cell, f"{device}, 128 cells an axis in each top cell", finer),
             (numbers["series"] == PAPER, "paper (its GPU)", paper)]
    return [one for one in found if one[0].any()]


def _bars(axis, rows: pd.DataFrame, places: list[float], height: float, low: float, label: str,
          look: dict) -> None:
    value = rows["traversal_mrays_per_s"]
    axis.barh(places, value - low, left=low, height=height, label=label, linewidth=0.8, **look)
    ends = value
    if label != "paper (its GPU)":
        axis.errorbar(value, places, xerr=style.errors(rows, "traversal_mrays_per_s"), fmt="none",
                      ecolor=style.INK, elinewidth=0.9)
        ends = rows["traversal_mrays_per_s_high"].fillna(value)
    text = style.short_number if label == "paper (its GPU)" else style.three_digits
    for place, end, number in zip(places, ends, value, strict=True):
        axis.annotate(text(number), (end, place), (4, 0), textcoords="offset points",
                      va="center", fontsize=7.5)
