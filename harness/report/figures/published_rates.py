"""Rates that others published, beside ours as context: other hardware and rays."""

from __future__ import annotations

import textwrap

import pandas as pd

from harness.analysis.names import plain
from harness.analysis.ratios import best
from harness.analysis.results import Results
from harness.report.entry import Figure
from harness.report.figures import style
from harness.report.figures.end_to_end import embree_title

OURS = "this machine"


def select(runs: Results) -> pd.DataFrame:
    """Ours first, then the paper's traversal, then others; one row a system and scene with a number."""
    rows = _ours(runs)
    if not rows:
        return pd.DataFrame()
    for scene in runs.published["scene"]:
        rows.append(
            _row(
                scene["name"],
                "the paper, traversal alone",
                "its GPU, not named",
                scene["traverse_mrays"],
                "diffuse",
                scene["place"],
            )
        )
    for other in runs.published.get("other", []):
        rows += [
            _row(name, other["system"], other["hardware"], rate, other["rays"], other["place"])
            for name, rate in other["rates"].items()
        ]
    numbers = pd.DataFrame(rows)
    order = {scene["name"]: number for number, scene in enumerate(runs.published["scene"])}
    systems = list(dict.fromkeys(numbers["system"]))
    key = [(systems.index(row.system), order.get(row.name, 99)) for row in numbers.itertuples(index=False)]
    numbers["scene"] = [runs.scene_title(name) for name in numbers["name"]]
    return numbers.iloc[sorted(range(len(key)), key=key.__getitem__)].reset_index(drop=True)


def _ours(runs: Results) -> list[dict]:
    """The fastest deferred run and each Embree on the paper's real scenes: a stand-in has no place beside them."""
    known = {plain(scene["name"]): scene["name"] for scene in runs.published["scene"]}
    found = []
    rows = runs.diffuse[runs.diffuse["source"] == "real"]
    deferred = rows[rows["tracer"].isin(("deferred", "streamed"))]
    embree = rows[rows["tracer"] == "embree"].groupby("options", sort=False)
    systems = [("deferred, fastest measured", deferred), *((embree_title(kind), some) for kind, some in embree)]
    for system, some in systems:
        for scene, runs_there in some.groupby("scene", sort=False):
            run = best(runs_there)
            if run is not None and plain(scene) in known:
                row = _row(known[plain(scene)], system, OURS, run["total"], "diffuse", "records of this report")
                found.append(
                    row
                    | {
                        "rate_mrays_per_s_low": run["total_low"],
                        "rate_mrays_per_s_high": run["total_high"],
                        "runs": run["run"],
                    }
                )
    return found


def _row(name: str, system: str, hardware: str, rate: float, rays: str, place: str) -> dict:
    return {
        "system": system,
        "hardware": hardware,
        "scene": "",
        "rate_mrays_per_s": float(rate),
        "rays_traced": rays,
        "read_in": place,
        "name": name,
        "runs": "",
    }


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """Why nothing here is divided by anything."""
    return (
        "Incoherent rays a second, logarithmic axis. Filled: measured here, on real scenes. Hollow: as "
        "published, on other hardware, with other rays and sometimes another version of the scene; they show "
        "orders of magnitude and make no ratio with ours. The paper's numbers count traversal alone. Sources "
        "stand in the table."
    )


def draw(runs: Results, numbers: pd.DataFrame, narrow: bool):
    """A line a system, a mark a scene."""
    systems = list(dict.fromkeys(zip(numbers["system"], numbers["hardware"], strict=True)))
    figure = style.canvas(0.85 + (0.36 if narrow else 0.25) * len(systems), narrow)
    axis = figure.subplots()
    for name, rows in numbers.groupby("name", sort=False):
        colour, marker = style.SCENE_LOOKS.get(name, (style.GREY, "P"))
        for ours, part in rows.groupby(rows["hardware"] == OURS):
            places = [systems.index(key) for key in zip(part["system"], part["hardware"], strict=True)]
            axis.plot(
                part["rate_mrays_per_s"],
                places,
                linestyle="none",
                marker=marker,
                color=colour,
                markersize=5,
                markerfacecolor=colour if ours else style.PAGE,
                clip_on=False,
                zorder=3,
            )
        axis.plot([], [], linestyle="none", marker=marker, color=colour, label=rows["scene"].iloc[0])
    mine = sum(hardware == OURS for _, hardware in systems)
    axis.axhspan(-0.5, mine - 0.5, color=style.BAND, zorder=0, linewidth=0)
    axis.set(
        xscale="log",
        ylim=(len(systems) - 0.4, -0.6),
        yticks=range(len(systems)),
        yticklabels=[_system_name(*key, narrow) for key in systems],
        xlabel="million rays/s" if narrow else "million rays per second",
    )
    low, high = numbers["rate_mrays_per_s"].min() / 1.5, numbers["rate_mrays_per_s"].max() * 1.5
    axis.set_xlim(low, high)
    style.log_axis(axis.xaxis, low, high, sparse=True)
    axis.tick_params(axis="y", length=0, labelsize=6.5 if narrow else 7)
    axis.grid(axis="both")
    axis.plot(
        [],
        [],
        linestyle="none",
        marker="o",
        color=style.MUTED,
        markerfacecolor=style.PAGE,
        label="hollow: other hardware and rays",
    )
    figure.legend(loc="outside lower center", ncols=2 if narrow else 3)
    return figure


def _system_name(system: str, hardware: str, narrow: bool) -> str:
    if hardware == OURS:
        return f"{system} (here)"
    kind = hardware.split(",")[0].removeprefix("its ")
    kind = f"unnamed {kind}" if "not named" in hardware else hardware
    return textwrap.fill(f"{system} ({kind})", 28) if narrow else f"{system} ({kind})"


FIGURE = Figure(
    name="published_rates",
    section="End to end",
    title="Rates published elsewhere: other hardware and rays",
    needs="diffuse runs of the deferred tracer or of Embree on a scene that others measured",
    select=select,
    caption=caption,
    draw=draw,
)
