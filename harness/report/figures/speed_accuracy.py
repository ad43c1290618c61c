"""Speed against accuracy: end-to-end rate over leaks of aimed rays, drawn as ann-benchmarks draws its trade-offs."""

from __future__ import annotations

import itertools
import math
import textwrap

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from harness.analysis.ratios import rays_note
from harness.analysis.results import Results
from harness.report.entry import Figure, Machines
from harness.report.figures import chart as charts
from harness.report.figures import style
from harness.report.figures.contenders import accuracy_table, intersector_family, marks
from harness.report.figures.metrics import METRICS, frontier
from harness.spec import intersectors

X, Y = "leak_rate", "rate"
DEFAULT = f"deferred:{intersectors.DEFAULT}"  # the bare deferred tracer
LINE = 7.4  # points from one line of a name to the next
LETTER = 3.6  # points a letter of a name is wide, with its share of the margin


def select(runs: Results) -> pd.DataFrame:
    """One row a variant and scene, with the frontier over all variants of the scene and over those of its tracer."""
    table = accuracy_table(runs)
    if table.empty:
        return table
    parts = []
    for _, scene in table.groupby("scene", sort=False):
        scene = scene.assign(on_frontier=_on_frontier(scene))
        own = [
            rows.assign(on_own_frontier=_on_frontier(rows), within_noise=_within_noise(rows))
            for _, rows in scene.groupby("tracer", sort=False)
        ]
        parts += own
    table = pd.concat(parts, ignore_index=True)
    return pd.DataFrame(
        {
            "scene": table["scene"],
            "series": table["name"],
            "tracer": table["tracer"],
            "intersector": table["intersector"],
            "variant": table["variant"],
            "rays": table["rays"],
            "aimed_rays": table["aimed"],
            "leaks": table["leaks"],
            "leak_rate": table["leak_rate"],
            "leak_bound": table["leak_bound"],
            "minus_log10_leak_bound": -np.log10(table["leak_bound"]),
            "total_mrays_per_s": table["rate"],
            "total_mrays_per_s_low": table["rate_low"],
            "total_mrays_per_s_high": table["rate_high"],
            "t_error_p99": table["t_error_p99"],
            "default": table["variant"] == DEFAULT,
            "on_frontier": table["on_frontier"],
            "on_own_frontier": table["on_own_frontier"],
            "within_noise": table["within_noise"],
            "runs": table["run"],
        }
    )


def _on_frontier(rows: pd.DataFrame) -> np.ndarray:
    return frontier(rows["leak_bound"], rows["rate"], X, Y)


def _within_noise(rows: pd.DataFrame) -> np.ndarray:
    """bool[n]: no variant that leaks as little, or less, has an interval of its rate wholly above this one's."""
    leaks, low, high = (rows[name].to_numpy(float) for name in ("leak_bound", "rate_low", "rate_high"))
    return ~((leaks[:, None] <= leaks) & (low[:, None] > high)).any(axis=0)


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """How to read it."""
    aimed = int(numbers["aimed_rays"].max())
    default = numbers[numbers["default"]]
    near = f"{int(default['within_noise'].sum())} of {len(default)} {'panels' if 'machine' in numbers else 'scenes'}"
    standing = ". ".join(
        default_standing(name, rows) for name, rows in split_panels(numbers) if rows["default"].any()
    )
    return (
        f"Up is faster, right loses fewer rays. Across: the share of up to {aimed:,} aimed rays that a "
        "variant lets through, at the upper end of its 95 % interval; each ray is aimed at an edge or a vertex "
        "whose triangles face it and leave no gap. Hollow marks with an arrow: none was let through, drawn at "
        "3/N. Lines join the variants of one tracer that no other of it beats in both; the broad grey line, "
        "those that none beats at all. Colour is the tracer, the mark its ray/triangle test; beaten points are "
        "pale, but for the default variant, which is on the deferred tracer's frontier, or within the noise of "
        f"it, on {near}. The default variant on {standing or 'no scene'}. "
        "Embree runs its own hierarchy and vector code on all cores: the outside reference. "
        f"{rays_note(numbers)} So few favour forward tracing and Embree: deferral gains with their number, as "
        "the figure of whole traces shows; compare the variants of one tracer."
    )


def default_standing(name: str, scene: pd.DataFrame) -> str:
    """Where the default stands on a scene: on which frontiers, and how much faster is what leaks as little."""
    default = scene[scene["default"]].iloc[0]
    own = "on" if default["on_own_frontier"] else "off"
    every = "on" if default["on_frontier"] else "off"
    text = f"{name}: {own} its tracer's frontier, {every} that of all; "
    leak_as_little = scene[scene["leak_bound"] <= default["leak_bound"]]
    own_tracer = leak_as_little[leak_as_little["tracer"] == default["tracer"]]
    best = [rows.loc[rows["total_mrays_per_s"].idxmax()] for rows in (own_tracer, leak_as_little)]
    faster = [
        f"{row['series']}{'' if row['tracer'] == default['tracer'] else ' (' + row['tracer'] + ')'} is "
        f"{row['total_mrays_per_s'] / default['total_mrays_per_s']:.3g} times as fast"
        for row in best
        if row["total_mrays_per_s"] > default["total_mrays_per_s"]
    ]
    return text + (
        f"with as few leaks, {' and '.join(dict.fromkeys(faster))}"
        if faster
        else "nothing with as few leaks is faster"
    )


def split_panels(numbers: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """Title and rows of each panel: a scene; with several machines, each scene on each, side by side.

    Scenes that most machines have come first, so that no gap parts two machines on a later scene.
    """
    if "machine" not in numbers:
        return list(numbers.groupby("scene", sort=False))
    groups = dict(list(numbers.groupby(["scene", "machine"], sort=False)))
    scenes, machines = (list(dict.fromkeys(numbers[name])) for name in ("scene", "machine"))
    scenes.sort(key=lambda scene: -sum((scene, machine) in groups for machine in machines))
    keys = [(scene, machine) for scene in scenes for machine in machines if (scene, machine) in groups]
    return [(", ".join(key), groups[key]) for key in keys]


def chart(runs: Results, numbers: pd.DataFrame) -> dict:
    """The same points to explore: hover for the record, choose scene, tracer and ray/triangle test."""
    return chart_together([(runs, numbers)])


def chart_together(found: list[tuple[Results, pd.DataFrame]]) -> dict:
    """The chart of one or several machines, each with its own numbers; several can be chosen from."""
    rows = [row for runs, numbers in found for row in _chart_rows(runs, numbers)]
    filters = {"scene": "scene", "tracer": "tracer", "intersector": "ray/triangle test"}
    if len(found) > 1:
        filters = {"machine": "machine", **filters}
    families = list(
        dict.fromkeys(intersector_family(name) for _, numbers in found for name in numbers["intersector"])
    )
    return charts.explored(rows, filters, _layers(rows, families, len(found) > 1), 420)


def _chart_rows(runs: Results, numbers: pd.DataFrame) -> list[dict]:
    return [
        {
            "scene": row.scene,
            "tracer": row.tracer,
            "intersector": row.intersector or "Embree's own",
            "family": intersector_family(row.intersector)[1],
            "variant": row.variant,
            "x": row.minus_log10_leak_bound,
            "rate": row.total_mrays_per_s,
            "low": row.total_mrays_per_s_low,
            "high": row.total_mrays_per_s_high,
            "rate_text": charts.interval(numbers.loc[row.Index], "total_mrays_per_s"),
            "leaks": f"{row.leaks:,} of {row.aimed_rays:,} aimed rays",
            "t_error": charts.number(row.t_error_p99),
            "frontier": "on its tracer's frontier" if row.on_own_frontier else "beaten",
            **({"machine": runs.machine} if runs.machine else {}),
            **charts.record_facts(runs, row.runs),
        }
        for row in numbers.itertuples()
    ]


def _layers(rows: list[dict], families: list[tuple[str, str]], several: bool) -> list[dict]:
    """Intervals and points; `families`: marker and title of those among the rows."""
    fields = {
        **({"machine": "machine"} if several else {}),
        "scene": "scene",
        "variant": "variant",
        "rate_text": "million rays/s",
        "leaks": "leaks",
        "t_error": "t error, 99th percentile",
        "frontier": "standing",
        **charts.RECORD_FIELDS,
    }
    x = {
        "field": "x",
        "type": "quantitative",
        "title": "−log10 of the leak rate, upper 95 % bound",
        "scale": {"zero": False, "padding": 12},
    }
    y = {
        "type": "quantitative",
        "scale": {"type": "log", "nice": False, "padding": 12},
        "title": "million rays per second, whole trace",
    }
    shape = {
        "field": "family",
        "type": "nominal",
        "title": None,
        "scale": {"domain": [name for _, name in families], "range": [charts.SHAPES[mark] for mark, _ in families]},
    }
    colour = charts.by_tracer(rows)
    pale = {"condition": {"test": "datum.frontier == 'beaten'", "value": 0.4}, "value": 1}
    return [
        {
            "mark": {"type": "rule"},
            "encoding": {
                "x": x,
                "y": {**y, "field": "low"},
                "y2": {"field": "high"},
                "color": colour,
                "opacity": pale,
            },
        },
        {
            "mark": {"type": "point", "filled": True, "size": 70},
            "encoding": {
                "x": x,
                "y": {**y, "field": "rate"},
                "color": colour,
                "shape": shape,
                "opacity": pale,
                "tooltip": charts.tooltip(fields),
            },
        },
    ]


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """One panel a scene; with several machines, one for each side by side, on the same axes."""
    panels = split_panels(numbers)
    columns = 1 if narrow or len(panels) == 1 else 2
    lines = -(-len(panels) // columns)
    height = max(panel_height(rows) for _, rows in panels)
    figure = style.canvas(1.2 + (height + 0.55) * lines, narrow)
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True).ravel()
    for axis, (name, rows) in zip(axes, panels):
        beside = numbers[numbers["scene"] == rows["scene"].iloc[0]]
        _panel(axis, rows, beside, numbers, columns == 1 and not narrow, LINE / (72 * height))
        axis.set_title(textwrap.fill(name, 44), loc="left", fontsize=8.5 if len(name) < 30 else 7)
        axis.set_ylabel(METRICS[Y].label if narrow or columns == 1 else "million rays per second")
    for axis in axes[len(panels) :]:
        axis.remove()
    for axis in axes[max(0, len(panels) - columns) : len(panels)]:
        axis.set_xlabel("leak rate (share of aimed rays), fewer to the right")
        axis.tick_params(labelbottom=True)
    figure.legend(handles=legend_lines(numbers), loc="outside lower center", ncols=2 if narrow else 4)
    return figure


def panel_height(numbers: pd.DataFrame) -> float:
    """Inches of a panel in which the names of the densest scene fit below one another."""
    lines = (
        sum(point_label(row).count("\n") + 1.3 for row in named(scene).itertuples())
        for _, scene in numbers.groupby("scene", sort=False)
    )
    return max(2.2, max(lines) * LINE / 72 / 0.94)


def named(scene: pd.DataFrame) -> pd.DataFrame:
    """Variants whose names are written, slowest first: those on their tracer's frontier, and the default."""
    return scene[scene["on_own_frontier"] | scene["default"]].sort_values("total_mrays_per_s")


def point_label(row) -> str:
    """Name of a variant in lines of a panel's width."""
    return textwrap.fill(f"{row.series} (default)" if row.default else row.series, 24)


def _panel(axis, scene: pd.DataFrame, beside: pd.DataFrame, numbers: pd.DataFrame, wide: bool, line: float) -> None:
    """`beside`: this scene on all machines, which share an axis; `line`: a line of text, as a share of the height."""
    worst, best = numbers["minus_log10_leak_bound"].min(), numbers["minus_log10_leak_bound"].max()
    low, high = beside["total_mrays_per_s_low"].min() / 1.1, beside["total_mrays_per_s_high"].max() * 1.2
    ticks = range(math.ceil(max(0, worst - 0.3)), math.floor(best) + 1)
    axis.set(
        yscale="log",
        xlim=(max(0, worst - 0.3), best + (best - worst) * (0.4 if wide else 0.65)),
        ylim=(low, high),
        xticks=ticks,
        xticklabels=["1" if tick == 0 else f"1e−{tick}" for tick in ticks],
    )
    style.log_axis(axis.yaxis, low, high)
    axis.grid()
    _line(axis, scene[scene["on_frontier"]], style.RULE, 4.5)
    for tracer, rows in scene.groupby("tracer", sort=False):
        _line(axis, rows[rows["on_own_frontier"]], style.tracer_look(tracer)[0], 1.0)
    for row in scene.sort_values(["on_own_frontier", "default"]).itertuples():
        _point(axis, row)
    _names(axis, named(scene), scene, line)


def _line(axis, rows: pd.DataFrame, colour: str, width: float) -> None:
    rows = rows.sort_values("minus_log10_leak_bound")
    axis.plot(
        rows["minus_log10_leak_bound"],
        rows["total_mrays_per_s"],
        color=colour,
        linewidth=width,
        zorder=1.5,
        solid_capstyle="round",
    )


def _point(axis, row) -> None:
    look, x = marks(row, row.on_own_frontier or row.default), row.minus_log10_leak_bound
    ends = [row.total_mrays_per_s_low, row.total_mrays_per_s_high]
    axis.plot([x, x], ends, color=look["color"], alpha=look["alpha"], linewidth=0.8, zorder=2)
    hollow = row.leaks == 0
    if hollow:
        axis.annotate(
            "",
            (x, row.total_mrays_per_s),
            (11, 0),
            textcoords="offset points",
            arrowprops={
                "arrowstyle": "<-",
                "color": look["color"],
                "alpha": look["alpha"],
                "linewidth": 0.8,
                "shrinkA": 0,
                "shrinkB": 2,
            },
        )
    axis.plot(
        [x],
        [row.total_mrays_per_s],
        linestyle="none",
        markersize=5,
        zorder=3,
        **look,
        markerfacecolor=style.PAGE if hollow else look["color"],
    )


def _names(axis, rows: pd.DataFrame, scene: pd.DataFrame, line: float) -> None:
    """Names of the frontier's points to their right, moved apart where they would meet.

    A name that would lie on a point of the scene goes to the column right of all points.
    """
    to_axis = axis.transScale + axis.transLimits
    points, every = (
        to_axis.transform(part[["minus_log10_leak_bound", "total_mrays_per_s"]].to_numpy(float))
        for part in (rows, scene)
    )
    letter = LETTER / (72 * axis.figure.get_figwidth() / axis.get_subplotspec().get_gridspec().ncols)
    texts = [point_label(row) for row in rows.itertuples()]
    sizes = [(text.count("\n") + 1.3) * line for text in texts]
    gaps = [(one + two) / 2 for one, two in itertools.pairwise(sizes)]
    heights = style.spread([y for _, y in points], gaps, sizes[0] / 2, 1 - sizes[-1] / 2) if sizes else []
    for row, (x, y), height, text, size in zip(rows.itertuples(), points, heights, texts, sizes, strict=True):
        colour = style.tracer_look(row.tracer)[0]
        right = x + 0.08 + letter * max(map(len, text.splitlines()))
        covered = (every[:, 0] > x + 0.02) & (every[:, 0] < right) & (abs(every[:, 1] - height) < size / 2 + line / 2)
        place = (every[:, 0].max() if covered.any() else x) + 0.055
        axis.annotate(
            text,
            (x, y),
            (place, height),
            xycoords="axes fraction",
            textcoords="axes fraction",
            fontsize=6,
            va="center",
            color=colour,
            zorder=4,
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.4, "shrinkA": 0, "shrinkB": 3},
        )


def legend_lines(numbers: pd.DataFrame) -> list[Line2D]:
    """A patch of colour for each tracer and a mark for each family of intersectors."""
    colours = [
        Line2D([], [], color=style.tracer_look(name)[0], linewidth=3, label=name)
        for name in dict.fromkeys(numbers["tracer"])
    ]
    families = dict.fromkeys(intersector_family(name) for name in numbers["intersector"])
    return colours + [
        Line2D([], [], color=style.MUTED, marker=marker, linestyle="none", label=title) for marker, title in families
    ]


FIGURE = Figure(
    name="speed_accuracy",
    section="Speed against accuracy",
    title="Whole trace against leaks of rays aimed at edges and vertices",
    needs="rows of 'defray accuracy'",
    machines=Machines.TOGETHER,
    select=select,
    caption=caption,
    draw=draw,
    chart=chart,
    chart_together=chart_together,
)
