"""Speed at each accuracy floor, as search benchmarks give queries a second at a recall: what watertightness costs."""

from __future__ import annotations

import pandas as pd

from harness.analysis.results import Results
from harness.report.entry import Table
from harness.report.figures.contenders import accuracy_table
from harness.spec.structure import OVERLAPS
from harness.stats import rates_of, ratio

PADDED = OVERLAPS[0]  # the overlap test that loses nothing
FLOORS = (1.0, 1e-2, 1e-4, 3e-6)  # largest share of aimed rays that may leak; 1 is no floor


def select(runs: Results) -> pd.DataFrame:
    """One row a scene and floor: the fastest variant of all, the fastest deferred one, and its price."""
    table = accuracy_table(runs)
    rows = []
    for _, scene in table.groupby("scene", sort=False) if len(table) else ():
        deferred = scene[(scene["tracer"] == "deferred") & (scene["overlap"] == PADDED)]
        free = fastest(deferred, FLOORS[0])
        for floor in FLOORS:
            rows.append(
                {"scene": scene["scene"].iloc[0], "leak_rate_below": "any" if floor == 1 else f"{floor:g}"}
                | _numbers("", fastest(scene, floor))
                | _numbers("deferred_", fastest(deferred, floor))
                | _price(free, fastest(deferred, floor))
            )
    found = pd.DataFrame(rows)
    if len(found):
        found["runs"] = found.pop("_run") + " " + found.pop("deferred__run")
    return found


def fastest(rows: pd.DataFrame, floor: float) -> pd.Series | None:
    """The fastest of the variants whose leak rate is below `floor` with 95 % confidence; None without one."""
    kept = rows[rows["leak_bound"] <= floor]
    return None if kept.empty else kept.loc[kept["rate"].idxmax()]


def _numbers(before: str, row: pd.Series | None) -> dict:
    if row is None:
        return {
            f"{before}variant": None,
            f"{before}mrays_per_s": None,
            f"{before}mrays_per_s_low": None,
            f"{before}mrays_per_s_high": None,
            f"{before}_run": "",
        }
    return {
        f"{before}variant": row["variant"],
        f"{before}mrays_per_s": row["rate"],
        f"{before}mrays_per_s_low": row["rate_low"],
        f"{before}mrays_per_s_high": row["rate_high"],
        f"{before}_run": row["run"],
    }


def _price(free: pd.Series | None, bound: pd.Series | None) -> dict:
    """Rate of the fastest deferred variant without a floor over that of the fastest with it, repetitions paired."""
    if free is None or bound is None or len(free["seconds"]) != len(bound["seconds"]):
        return {"price": None, "price_low": None, "price_high": None}
    found = ratio(rates_of(free["seconds"], free["rays"]), rates_of(bound["seconds"], bound["rays"]))
    return {"price": found.median, "price_low": found.low, "price_high": found.high}


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """What a floor is."""
    table = accuracy_table(runs)
    most = int(table["aimed"].max())
    return (
        "The fastest variant whose share of aimed rays that leak is below the floor with 95 % confidence, over "
        "all tracers, Embree among them, and over the deferred ones on a grid that loses nothing. Price: rate of "
        "the fastest of these without a floor over that of the fastest with it, and its 95 % interval: what a "
        f"watertight ray/triangle test costs. {most:,} aimed rays without a leak show a rate below "
        f"{3 / most:.1g}; a floor under that stays empty."
    )


TABLE = Table(
    name="speed_at_floor",
    section="Speed against accuracy",
    title="Speed at each accuracy floor",
    needs="rows of 'defray accuracy'",
    select=select,
    caption=caption,
)
