"""Figure 1, bottom: the rate of diffuse traversal beside the paper's."""

from __future__ import annotations

import textwrap

import pandas as pd

from harness.analysis.names import short_number, three_digits
from harness.analysis.ratios import main_workload, rays_note
from harness.analysis.results import Results
from harness.report.entry import Figure, Machines
from harness.report.figures import style

PAPER = "paper"


def select(runs: Results) -> pd.DataFrame:
    """Traversal rate of the default deferred tracer for every scene and reading, and the paper's."""
    ours = {"total": runs.grid, "per-cell": runs.paper_grid.replace("total", "per-cell")}
    if runs.grid != runs.paper_grid:
        ours = {"": runs.grid}
    rows = [_ours(run) for grid in ours.values() for _, run in _candidates(runs, grid).iterrows()]
    for scene in dict.fromkeys(row["name"] for row in rows):
        known = runs.published_scene(scene)
        if known and "traverse_mrays" in known:
            title = next(row["scene"] for row in rows if row["name"] == scene)
            rows.append(
                {
                    "scene": title,
                    "series": PAPER,
                    "grid": runs.paper_grid,
                    "rays": None,
                    "traversal_mrays_per_s": known["traverse_mrays"],
                    "intersector": "",
                    "measured_on": f"its GPU ({known['place']})",
                    "name": scene,
                    "runs": "",
                }
            )
    return pd.DataFrame(rows)


def _candidates(runs: Results, grid: str) -> pd.DataFrame:
    """Default deferred runs on a grid; the paper's intersector first, for the walk is the same."""
    rows = runs.every_diffuse
    here = (
        (rows["tracer"] == "deferred") & (rows["options"] == "") & (rows["grid"] == grid) & rows["traverse"].notna()
    )
    chosen = main_workload(rows[here])
    order = (chosen["intersector"] != "ray-space").sort_values(kind="stable").index
    return chosen.loc[order].drop_duplicates("scene").sort_index()


def _ours(run: pd.Series) -> dict:
    return {
        "scene": run["title"],
        "series": "ours",
        "grid": run["grid"],
        "rays": run["rays"],
        "traversal_mrays_per_s": run["traverse"],
        "traversal_mrays_per_s_low": run["traverse_low"],
        "traversal_mrays_per_s_high": run["traverse_high"],
        "intersector": run["intersector"],
        "measured_on": run["device"],
        "name": run["scene"],
        "runs": run["run"],
    }


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """Whose device is whose."""
    text = (
        "Figure 1, bottom. Rays a second through the traversal stage of the deferred tracer, diffuse "
        "rays, logarithmic axis, with 95 % intervals."
    )
    if numbers["grid"].str.endswith("per-cell").any():
        text += (
            " The paper's 8³ and 128³ can be read as 128 cells an axis over the scene (total) or inside "
            "each first-level cell (per cell); both are drawn."
        )
    text += f" {runs.grid_note()} {rays_note(numbers)}"
    if (numbers["series"] == PAPER).any():
        text += (
            " The paper's rates are from its own GPU, which it does not name: they stand beside ours "
            "and make no ratio with them."
        )
    return text


def together(numbers: pd.DataFrame) -> pd.DataFrame:
    """The numbers of all machines; the paper's rates stand there once, and are of none of them."""
    paper = numbers["series"] == PAPER
    numbers = numbers.assign(machine=numbers["machine"].mask(paper, ""))
    return numbers[~paper | ~numbers.duplicated(["scene", "series"])].reset_index(drop=True)


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """A dot with its interval and number for each scene and series, scenes one below another."""
    series = _series(numbers, runs.device, 30 if narrow else 75)
    scenes = list(dict.fromkeys(numbers["scene"]))
    figure = style.canvas(0.7 + 0.19 * len(series) * len(scenes) + 0.16 * len(series), narrow)
    axis = figure.subplots()
    value = numbers["traversal_mrays_per_s"]
    ends = numbers["traversal_mrays_per_s_low"].min() / 1.15  # an interval may leave the picture, if it is a long one
    low, high = max(value.min() / 4, min(value.min() / 1.6, ends)), value.max() * (3.2 if narrow else 1.9)
    axis.set(
        xscale="log",
        xlim=(low, high),
        ylim=(len(scenes) - 0.5, -0.5),
        xlabel="diffuse traversal (million rays per second)",
        yticks=range(len(scenes)),
        yticklabels=[name.replace(" (stand-in)", "\n(stand-in)") for name in scenes],
    )
    for number in range(0, len(scenes), 2):
        axis.axhspan(number - 0.5, number + 0.5, color=style.BAND, zorder=0, linewidth=0)
    for number, (mask, label, look) in enumerate(series):
        shift = (number - (len(series) - 1) / 2) * 0.84 / len(series)
        rows = numbers[mask]
        _dots(axis, rows, [scenes.index(name) + shift for name in rows["scene"]], label, look)
    style.log_axis(axis.xaxis, low, high, sparse=True)
    axis.tick_params(axis="y", length=0)
    axis.grid(axis="x")
    axis.spines["left"].set_visible(False)
    figure.legend(loc="outside lower center", ncols=1)
    return figure


def _series(numbers: pd.DataFrame, device: str, width: int) -> list[tuple]:
    """Which rows, under what name, with what look; only series that have rows, a machine after another."""
    mine, per_cell = numbers["series"] == "ours", numbers["grid"].str.endswith("per-cell")
    here = numbers["machine"] if "machine" in numbers else pd.Series(device, index=numbers.index)
    found = []
    for number, machine in enumerate(dict.fromkeys(here[mine])):
        colour, marker = style.machine_look(number)
        own, look = mine & (here == machine), {"color": colour, "marker": marker}
        found += [
            (own & ~per_cell, textwrap.fill(machine, width), look),
            (
                own & per_cell,
                textwrap.fill(f"{machine}, 128 cells an axis in each top cell", width),
                look | {"markerfacecolor": style.PAGE},
            ),
        ]
    found.append(
        (
            numbers["series"] == PAPER,
            "the paper, on its own GPU",
            {"color": style.PINK, "marker": "D", "markerfacecolor": style.PAGE},
        )
    )
    return [one for one in found if one[0].any()]


def _dots(axis, rows: pd.DataFrame, places: list[float], label: str, look: dict) -> None:
    value, published = rows["traversal_mrays_per_s"], (rows["series"] == PAPER).all()
    ends = value
    if not published:
        axis.errorbar(
            value,
            places,
            xerr=style.errors(rows, "traversal_mrays_per_s"),
            fmt="none",
            ecolor=look["color"],
            elinewidth=1.2,
            capsize=0,
        )
        ends = rows["traversal_mrays_per_s_high"].fillna(value)
    axis.plot(value, places, linestyle="none", markersize=5, label=label, zorder=3, **look)
    text = short_number if published else three_digits
    for place, end, number in zip(places, ends, value, strict=True):
        axis.annotate(text(number), (end, place), (6, 0), textcoords="offset points", va="center", fontsize=7)


FIGURE = Figure(
    name="traversal_rate",
    section="Figure 1 of the paper",
    title="Diffuse traversal",
    needs="diffuse runs of the deferred tracer with default options",
    machines=Machines.TOGETHER,
    select=select,
    caption=caption,
    draw=draw,
    together=together,
)
