"""Waves and compaction: work and time of a ray as the length of a wave changes, and without compaction."""

from __future__ import annotations

import pandas as pd
from matplotlib.ticker import StrMethodFormatter

from harness.analysis.names import SAME_WORK
from harness.analysis.ratios import stage_nanoseconds
from harness.analysis.results import Results
from harness.records.run_row import Record
from harness.report.entry import Figure
from harness.report.figures import style
from harness.spec.tracer_facts import listed_tracers

STAGES = ("traverse", "arrange", "intersect", "compact", "other")
USUAL = listed_tracers()["deferred"].defaults["wave"]
WITHOUT = "no compaction"


def select(runs: Results) -> pd.DataFrame:
    """Tests and nanoseconds of a ray for each length of a wave, on the workload of each scene with most lengths."""
    rows = runs.every_diffuse
    rows = rows[(rows["intersector"] == "ray-space") & rows["total"].notna()]
    kept = []
    for _, scene in rows.groupby("scene", sort=False):
        works = [_work(work) for _, work in scene.groupby(SAME_WORK, sort=True)]
        most = max(works, key=lambda work: (len(work), work[0]["rays"] if work else 0))
        kept += most if len(most) >= 3 else []
    return pd.DataFrame(kept)


def _work(work: pd.DataFrame) -> list[dict]:
    """One row a setting, longest wave last and the run without compaction after it."""
    optimal = work[(work["tracer"] == "work-optimal") & (work["options"] == "")]
    needed = _tests(optimal.iloc[0]["record"]) if len(optimal) else float("nan")
    found = []
    for _, run in work[work["tracer"] == "deferred"].iterrows():
        setting = wave_setting(run["record"].options)
        if setting is None:
            continue
        times = stage_nanoseconds(run["record"])
        found.append(
            {
                "scene": run["title"],
                "setting": setting,
                "tests_per_ray": _tests(run["record"]),
                "tests_needed": needed,
                "waves": run["record"].counters.waves,
                **{f"{stage}_ns": times[stage] for stage in (*STAGES, "total")},
                "total_ns_low": 1e3 / run["total_high"],
                "total_ns_high": 1e3 / run["total_low"],
                "grid": run["grid"],
                "rays": run["rays"],
                "runs": run["run"],
            }
        )
    return sorted(found, key=lambda row: _place(row["setting"]))


def _tests(record: Record) -> float:
    return record.counters.tests / record.rays.count


def wave_setting(options: dict) -> str | None:
    """A wave's length, or that compaction was off; None where the run differs from the default in anything else."""
    if set(options) - {"wave", "compaction"}:
        return None
    wave = options.get("wave", USUAL)
    if options.get("compaction", "true") == "false":
        return WITHOUT if wave == USUAL else None
    return wave


def _place(setting: str) -> tuple[int, int]:
    return (2, 0) if setting == WITHOUT else (1, 0) if setting == "all" else (0, int(setting))


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What is counted and what is timed."""
    grids, rays = ", ".join(dict.fromkeys(numbers["grid"])), sorted(set(numbers["rays"]))
    text = (
        f"Deferred tracer, diffuse rays, grid {grids}. A wave takes each ray through so many non-empty cells "
        "before their triangles are tested; all: a single wave, every ray-cell pair intersected. Above, tests of "
        "a ray, counted exactly"
    )
    if numbers["tests_needed"].notna().any():
        text += "; the line is what work-optimal intersection needs, and what lies over it is wasted"
    return (
        f"{text}. Below, median nanoseconds of a ray by stage, with the 95 % interval of their sum. Kept: "
        f"without compaction, finished rays stay from wave to wave, of {USUAL} cells as by default (*). Scenes "
        "have axes of their own. "
        f"Rays: {', '.join(f'{count:,}' for count in rays)}."
    )


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """A column a scene, tests over time; on a narrow page a row a scene."""
    scenes = [rows for _, rows in numbers.groupby("scene", sort=False)]
    count = len(scenes)
    figure = style.canvas(0.6 + 1.75 * count if narrow else 3.9, narrow)
    axes = figure.subplots(count, 2, squeeze=False) if narrow else figure.subplots(2, count, squeeze=False).T
    for number, (scene, (above, below)) in enumerate(zip(scenes, axes, strict=True)):
        _tests_panel(above, scene)
        _time_panel(below, scene)
        above.set_title(scene["scene"].iloc[0], loc="left", pad=3)
        if narrow or number == 0:
            above.set_ylabel("tests a ray")
            below.set_ylabel("ns a ray")
        for axis in (above, below) if narrow else (below,):
            axis.set_xlabel("cells in a wave")
    handles, labels = axes[0][1].get_legend_handles_labels()
    lines = next(
        (axis.get_legend_handles_labels() for axis in axes[:, 0] if axis.get_legend_handles_labels()[0]), ([], [])
    )
    figure.legend(handles + lines[0], labels + lines[1], loc="outside lower center", ncols=3 if narrow else 6)
    return figure


def _tests_panel(axis, scene: pd.DataFrame) -> None:
    places = range(len(scene))
    axis.plot(places, scene["tests_per_ray"], color=style.BLUE, marker="o", markersize=4, linestyle="none")
    needed = scene["tests_needed"].iloc[0]
    if pd.notna(needed):
        axis.axhline(needed, color=style.RED, linewidth=1.2, label="tests needed")
        axis.vlines(places, needed, scene["tests_per_ray"], color=style.BLUE, linewidth=1)
    axis.set_ylim(0, scene["tests_per_ray"].max() * 1.12)
    _ticks(axis, scene)


def _time_panel(axis, scene: pd.DataFrame) -> None:
    under = pd.Series(0.0, index=scene.index)
    for stage in STAGES:
        values = scene[f"{stage}_ns"]
        axis.bar(range(len(scene)), values, bottom=under, width=0.74, color=style.STAGE_COLOURS[stage], label=stage)
        under = under + values
    axis.errorbar(
        range(len(scene)), under, yerr=style.errors(scene, "total_ns"), fmt="none", ecolor=style.INK, elinewidth=0.8
    )
    axis.set_ylim(0, max(under.max(), scene["total_ns_high"].max()) * 1.05)
    _ticks(axis, scene)


def _ticks(axis, scene: pd.DataFrame) -> None:
    titles = {WITHOUT: f"{USUAL},\nkept", USUAL: f"{USUAL}*"}
    names = [titles.get(name, name) for name in scene["setting"]]
    axis.set_xticks(range(len(scene)), names)
    axis.set_xlim(-0.6, len(scene) - 0.4)
    axis.tick_params(axis="x", length=0, labelsize=6.5)
    axis.yaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    axis.grid(axis="y")


FIGURE = Figure(
    name="waves",
    section="Time by stage",
    title="Waves and compaction",
    needs="diffuse runs of the deferred tracer that differ in `wave` or `compaction` alone",
    select=select,
    caption=caption,
    draw=draw,
)
