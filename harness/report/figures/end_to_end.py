"""Whole-trace rate of every tracer, scene by scene."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import three_digits
from harness.analysis.ratios import beside, best, main_workload, rays_note
from harness.analysis.results import Results
from harness.report.entry import Figure
from harness.report.figures import chart as charts
from harness.report.figures import style


def select(runs: Results) -> pd.DataFrame:
    """The chosen runs of each scene, one row a line of the figure."""
    rows = []
    for _, scene in _compared(runs).groupby("scene", sort=False):
        usual = scene["rays"].mode().max()
        for series, run in _chosen(scene, runs.grid):
            rows.append(
                {
                    "scene": run["title"],
                    "series": series,
                    "tracer": run["tracer"],
                    "variant": run["label"],
                    "grid": run["grid"],
                    "rays": run["rays"],
                    "fewer_rays": bool(run["rays"] < usual),
                    "total_mrays_per_s": run["total"],
                    "total_mrays_per_s_low": run["total_low"],
                    "total_mrays_per_s_high": run["total_high"],
                    "runs": run["run"],
                }
            )
    return pd.DataFrame(rows)


def _compared(runs: Results) -> pd.DataFrame:
    """Runs of each scene's view, ray count and seed that most tracers have in common."""
    return main_workload(runs.every_diffuse, by="tracer")


def _chosen(scene: pd.DataFrame, grid: str) -> list[tuple[str, pd.Series]]:
    """Fastest deferred, default deferred by intersector, fastest forward, each Embree, brute force.

    Of several runs of Embree the one measured beside the fastest of all others, not the luckiest.
    """
    of = dict(tuple(scene.groupby("tracer", sort=False)))
    empty = scene.iloc[:0]
    ours = best(scene[~scene["tracer"].isin(("embree", "brute", "work-optimal"))])
    found = [("deferred, fastest", best(of.get("deferred", empty)))]
    found += _default_settings(of.get("deferred", empty), grid)
    found += [("forward, fastest", best(of.get("forward", empty)))]
    found += [
        (embree_title(name), best(rows if ours is None else beside(rows, ours)))
        for name, rows in of.get("embree", empty).groupby("options", sort=False)
    ]
    found += [("brute force", best(of.get("brute", empty)))]
    others = sorted(set(of) - {"deferred", "forward", "embree", "brute", "work-optimal"})
    found += [(f"{name}, fastest", best(of[name])) for name in others]
    return [(name, run) for name, run in found if run is not None]


def _default_settings(rows: pd.DataFrame, grid: str) -> list[tuple[str, pd.Series | None]]:
    here = rows[(rows["options"] == "") & (rows["grid"] == grid)]
    return [
        (f"deferred {grid.removesuffix(' total')}, {style.intersector_title(name)}", best(one))
        for name, one in here.groupby("intersector", sort=False)
    ]


def embree_title(options: str) -> str:
    """Name of an Embree run: robust unless an option says otherwise, then its other options."""
    chosen = dict(part.split("=", 1) for part in options.split(":") if part)
    robust = chosen.pop("robust", None)
    mode = chosen.pop("mode", None)
    name = mode or ("fast" if robust in ("false", "0", "off", "no") else "robust")
    rest = "".join(f", {key} {value}" for key, value in sorted(chosen.items()))
    return f"Embree {name}{rest}"


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """How the lines were chosen."""
    text = (
        "Rays a second from rays to hits, diffuse rays, 95 % intervals, logarithmic axis. "
        "Fastest: the highest median over all measured intersectors, options and grids (named in the "
        f"table); {runs.grid.removesuffix(' total')}: the tracer's default options. {runs.grid_note()} "
        f"{rays_note(numbers)} "
    )
    if numbers["tracer"].eq("embree").any():
        text += "Embree runs on all cores of this machine's CPU. "
    if numbers["fewer_rays"].any():
        text += "* fewer rays than the other lines of its scene (the table says how many). "
    if numbers["tracer"].eq("brute").any():
        text += "A rate beside ◂ lies off the axis. "
    return text + "Work-optimal is absent: it is told the cells of each hit, and so is no tracer."


def chart(runs: Results, numbers: pd.DataFrame) -> dict:
    """Every diffuse run of the main workload to compare, not the chosen ones alone; hover for the record."""
    compared, rows = _compared(runs), []
    for run in compared.itertuples():
        for rate, stage in (("total", "whole trace"), ("traverse", "traversal"), ("intersect", "intersection")):
            if pd.notna(getattr(run, rate)):
                rows.append(
                    {
                        "scene": run.title,
                        "tracer": run.tracer,
                        "intersector": run.intersector or "its own",
                        "name": f"{run.label}, {run.grid}" if run.grid else run.label,
                        "stage": stage,
                        "variant": run.label,
                        "grid": run.grid,
                        "rate": getattr(run, rate),
                        "low": getattr(run, f"{rate}_low"),
                        "high": getattr(run, f"{rate}_high"),
                        "rate_text": charts.interval(compared.loc[run.Index], rate),
                        "rays": charts.number(run.rays),
                        "repetitions": run.repetitions,
                        **charts.record_facts(runs, run.run),
                    }
                )
    fields = {
        "scene": "scene",
        "variant": "variant",
        "grid": "grid",
        "stage": "stage",
        "rate_text": "million rays/s",
        "rays": "rays",
        "repetitions": "repetitions",
        **charts.RECORD_FIELDS,
    }
    y = {
        "field": "name",
        "type": "nominal",
        "title": None,
        "sort": {"field": "rate", "op": "max", "order": "descending"},
        "axis": {"labelLimit": 330, "grid": True, "labelOverlap": False},
    }
    x = {
        "type": "quantitative",
        "title": "million rays per second",
        "axis": {"tickCount": 6, "titleAnchor": "end"},
        "scale": {"type": "log", "nice": False, "padding": 12},
    }
    colour = charts.by_tracer(rows)
    layers = [
        {
            "mark": {"type": "rule"},
            "encoding": {"y": y, "x": {**x, "field": "low"}, "x2": {"field": "high"}, "color": colour},
        },
        {
            "mark": {"type": "point", "filled": True, "size": 60},
            "encoding": {"y": y, "x": {**x, "field": "rate"}, "color": colour, "tooltip": charts.tooltip(fields)},
        },
    ]
    filters = {"scene": "scene", "tracer": "tracer", "intersector": "ray/triangle test", "stage": "stage"}
    return charts.explored(
        rows, filters, layers, 40 + 18 * len({row["name"] for row in rows}), defaults={"stage": "whole trace"}
    )


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """Dots with intervals and numbers; scenes one above another on one axis."""
    scenes = [rows for _, rows in numbers.groupby("scene", sort=False)]
    figure = style.canvas(0.55 + 0.165 * len(numbers) + 0.27 * len(scenes), narrow)
    axis = figure.subplots()
    place, ticks, names = 0.0, [], []
    low, high = _range(numbers)
    axis.set(xscale="log", xlim=(low / 1.6, high * (4.5 if narrow else 1.9)))
    for number, scene in enumerate(scenes):
        top = place - 0.6
        axis.text(
            0,
            place,
            scene["scene"].iloc[0],
            transform=axis.get_yaxis_transform(),
            ha="left",
            va="center",
            fontweight="bold",
            fontsize=8,
        )
        for row in scene.itertuples():
            place += 1
            ticks.append(place)
            names.append(row.series + ("*" if row.fewer_rays else ""))
            _dot(axis, row, place)
        place += 1.5
        if number % 2 == 0:
            axis.axhspan(top, place - 0.7, color=style.BAND, zorder=0, linewidth=0)
    axis.set(
        ylim=(place - 0.6, -0.7), yticks=ticks, yticklabels=names, xlabel="whole trace (million rays per second)"
    )
    style.log_axis(axis.xaxis, *axis.get_xlim(), sparse=narrow)
    axis.tick_params(axis="y", length=0)
    axis.grid(axis="x")
    axis.spines["left"].set_visible(False)
    return figure


def _range(numbers: pd.DataFrame) -> tuple[float, float]:
    """Rates that the axis must show; brute force, thousands of times slower, would leave no room."""
    shown = numbers[numbers["tracer"] != "brute"]
    rates = (numbers if shown.empty else shown)["total_mrays_per_s"]
    return rates.min(), rates.max()


def _dot(axis, row, place: float) -> None:
    colour, marker = style.tracer_look(row.tracer)
    value = row.total_mrays_per_s
    if value < axis.get_xlim()[0]:
        axis.annotate(
            f"◂ {three_digits(value)}",
            (0, place),
            (2, 0),
            va="center",
            fontsize=7,
            color=style.MUTED,
            xycoords=axis.get_yaxis_transform(),
            textcoords="offset points",
        )
        return
    ends = [value if pd.isna(end) else end for end in (row.total_mrays_per_s_low, row.total_mrays_per_s_high)]
    axis.plot(ends, [place, place], color=colour, linewidth=1.6, solid_capstyle="butt")
    hollow = row.tracer == "deferred" and "fastest" not in row.series
    axis.plot(
        [value],
        [place],
        marker=marker,
        color=colour,
        markersize=5,
        linestyle="none",
        markerfacecolor=style.PAGE if hollow else colour,
    )
    axis.annotate(three_digits(value), (ends[1], place), (6, 0), textcoords="offset points", va="center", fontsize=7)


FIGURE = Figure(
    name="end_to_end",
    section="End to end",
    title="Whole trace: deferred, forward, Embree, brute force",
    needs="diffuse runs of any tracer that traces a ray to its hit by itself",
    select=select,
    caption=caption,
    draw=draw,
    chart=chart,
)
