"""Rate and memory against the resolution of the grid's second level."""

from __future__ import annotations

import pandas as pd

from harness.analysis.ratios import main_workload, rays_note
from harness.analysis.results import Results
from harness.report.entry import Figure
from harness.report.figures import chart as charts
from harness.report.figures import style

SERIES = (
    ("deferred", "total", "-"),
    ("deferred", "intersect", "--"),
    ("forward", "total", "-"),
    ("work-optimal", "intersect", "--"),
)


def select(runs: Results) -> pd.DataFrame:
    """Rates of default runs over resolution, for scenes measured at three resolutions or more."""
    rows = runs.every_diffuse
    rows = rows[
        rows["tracer"].isin({tracer for tracer, _, _ in SERIES}) & (rows["options"] == "") & rows["cells"].notna()
    ]
    kept = []
    for _, scene in main_workload(rows, "cells", others=False).groupby("scene", sort=False):
        scene = _one_kind(scene)
        if scene["cells"].nunique() >= 3:
            kept.append(scene)
    return pd.DataFrame([_numbers(run) for _, run in pd.concat(kept).iterrows()]) if kept else pd.DataFrame()


def _one_kind(scene: pd.DataFrame) -> pd.DataFrame:
    """The runs of the intersector and of the top level measured at the most resolutions."""
    for column in ("intersector", "top"):
        counts = scene.groupby(column)["cells"].nunique()
        favourite = {"intersector": "ray-space", "top": 8}[column]
        chosen = favourite if counts.get(favourite) == counts.max() else counts.idxmax()
        scene = scene[scene[column] == chosen]
    return scene.sort_values(["tracer", "cells"]).drop_duplicates(["tracer", "cells"])


def _numbers(run: pd.Series) -> dict:
    rates = {
        f"{rate}_mrays_per_s{end}": run[f"{rate}{end}"]
        for rate in ("total", "intersect")
        for end in ("", "_low", "_high")
    }
    return {
        "scene": run["title"],
        "tracer": run["tracer"],
        "intersector": run["intersector"],
        "grid": run["grid"],
        "cells_per_axis": int(run["cells"]),
        **rates,
        "grid_megabytes": run["grid_megabytes"],
        "rays": run["rays"],
        "runs": run["run"],
    }


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is held fixed."""
    names = ", ".join(style.intersector_title(name) for name in numbers["intersector"].unique())
    grids = sorted({grid.split("/")[0] for grid in numbers["grid"]}, key=int)
    return (
        f"Diffuse rays, intersector {names}, {' or '.join(grids)} cells an axis in the first level. The "
        "horizontal axis counts leaf cells an axis over the whole scene. Solid: the whole trace; dashed: "
        "the intersection stage alone. Below: bytes of the grid. The dotted line is the paper's 128. "
        f"{rays_note(numbers)}"
    )


def chart(runs: Results, numbers: pd.DataFrame) -> dict:
    """The same runs to explore: a line a tracer and stage, hover for the record."""
    rows = []
    for row in numbers.itertuples():
        for rate, stage in (("total", "whole trace"), ("intersect", "intersection")):
            name = f"{rate}_mrays_per_s"
            if pd.notna(getattr(row, name)):
                rows.append(
                    {
                        "scene": row.scene,
                        "tracer": row.tracer,
                        "intersector": row.intersector,
                        "stage": stage,
                        "cells": row.cells_per_axis,
                        "grid": row.grid,
                        "rate": getattr(row, name),
                        "low": getattr(row, f"{name}_low"),
                        "high": getattr(row, f"{name}_high"),
                        "rate_text": charts.interval(numbers.loc[row.Index], name),
                        "megabytes": charts.number(row.grid_megabytes),
                        "rays": charts.number(row.rays),
                        **charts.record_facts(runs, row.runs),
                    }
                )
    fields = {
        "scene": "scene",
        "tracer": "tracer",
        "stage": "stage",
        "grid": "grid",
        "rate_text": "million rays/s",
        "megabytes": "grid (MB)",
        "rays": "rays",
        **charts.RECORD_FIELDS,
    }
    x = {
        "field": "cells",
        "type": "quantitative",
        "title": "leaf cells per axis over the scene",
        "scale": {"type": "log", "base": 2, "nice": False, "padding": 12},
        "axis": {"values": sorted(map(int, numbers["cells_per_axis"].unique()))},
    }
    y = {
        "type": "quantitative",
        "scale": {"type": "log", "nice": False, "padding": 12},
        "title": "million rays per second",
    }
    colour = charts.by_tracer(rows)
    dash = {
        "field": "stage",
        "type": "nominal",
        "title": None,
        "scale": {"domain": ["whole trace", "intersection"], "range": [[1, 0], [5, 3]]},
    }
    detail = {"field": "scene", "type": "nominal"}
    layers = [
        {
            "mark": {"type": "line"},
            "encoding": {"x": x, "y": {**y, "field": "rate"}, "color": colour, "strokeDash": dash, "detail": detail},
        },
        {
            "mark": {"type": "rule"},
            "encoding": {"x": x, "y": {**y, "field": "low"}, "y2": {"field": "high"}, "color": colour},
        },
        {
            "mark": {"type": "point", "filled": True, "size": 60},
            "encoding": {"x": x, "y": {**y, "field": "rate"}, "color": colour, "tooltip": charts.tooltip(fields)},
        },
    ]
    filters = {"scene": "scene", "tracer": "tracer", "intersector": "ray/triangle test", "stage": "stage"}
    return charts.explored(rows, filters, layers, 360)


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """Small multiples: a column a scene with rate over memory (a row a scene on a narrow page)."""
    scenes = list(dict.fromkeys(numbers["scene"]))
    if narrow:
        figure = style.canvas(0.7 + 1.5 * len(scenes), narrow)
        axes = figure.subplots(len(scenes), 2, squeeze=False, sharex=True, sharey="col")
    else:
        figure = style.canvas(3.9, narrow)
        axes = figure.subplots(2, len(scenes), squeeze=False, sharex=True, sharey="row", height_ratios=(2, 1)).T
    for pair, name in zip(axes, scenes, strict=True):
        scene = numbers[numbers["scene"] == name]
        _rates(pair[0], scene)
        _memory(pair[1], scene)
        pair[0].set_title(name if narrow else name.replace(" (stand-in)", "\n(stand-in)"), loc="left", fontsize=8)
    _axes(axes, numbers, narrow)
    handles, labels = _legend(axes)
    figure.legend(handles, labels, loc="outside lower center", ncols=2 if narrow else 4)
    return figure


def _rates(axis, scene: pd.DataFrame) -> None:
    for tracer, rate, line in SERIES:
        rows = scene[(scene["tracer"] == tracer) & scene[f"{rate}_mrays_per_s"].notna()]
        if rows.empty:
            continue
        colour, marker = style.tracer_look(tracer)
        part = "total" if rate == "total" else "intersection"
        axis.errorbar(
            rows["cells_per_axis"],
            rows[f"{rate}_mrays_per_s"],
            label=f"{tracer}, {part}",
            yerr=style.errors(rows, f"{rate}_mrays_per_s"),
            color=colour,
            marker=marker,
            linestyle=line,
            markersize=3.5,
            elinewidth=0.8,
            linewidth=1.2,
            markerfacecolor=colour if rate == "total" else style.PAGE,
        )


def _memory(axis, scene: pd.DataFrame) -> None:
    rows = scene.drop_duplicates("cells_per_axis").sort_values("cells_per_axis")
    axis.plot(rows["cells_per_axis"], rows["grid_megabytes"], color=style.MUTED, marker=".", markersize=5)


def _axes(axes, numbers: pd.DataFrame, narrow: bool) -> None:
    """Scales, ticks and titles; the outer axes alone are labelled."""
    cells = sorted(numbers["cells_per_axis"].unique())
    ticks = cells if len(cells) <= 4 else cells[::2]
    paper = 128
    for axis in axes.ravel():
        axis.set_xscale("log", base=2)
        axis.set_yscale("log")
        axis.set_xticks(ticks, [str(cell) for cell in ticks], rotation=0)
        axis.grid(axis="y")
        axis.axvline(paper, color=style.PINK, linewidth=0.9, linestyle=":", zorder=0.5)
    for row in axes:
        for axis in row:
            style.log_axis(axis.yaxis, *axis.get_ylim())
    outer = axes[:, :1].ravel() if narrow else axes[:1, 0]
    for axis in outer:
        axis.set_ylabel("million rays/s")
    for axis in axes[:, 1] if narrow else axes[:1, 1]:
        axis.set_ylabel("grid (MB)")
    for axis in axes[-1, :] if narrow else axes[:, 1]:
        axis.set_xlabel("cells per axis" if narrow or len(axes) > 3 else "leaf cells per axis")


def _legend(axes):
    found = {}
    for axis in axes[:, 0]:
        handles, labels = axis.get_legend_handles_labels()
        found.update(dict(zip(labels, handles, strict=True)))
    return list(found.values()), list(found)


FIGURE = Figure(
    name="resolution",
    section="Resolution of the grid",
    title="Rate and memory over the resolution of the second level",
    needs="diffuse runs of one scene on at least three resolutions of the grid",
    select=select,
    caption=caption,
    draw=draw,
    chart=chart,
)
