"""Rates and ratios of runs: the best, the paired speedup, the time of each stage."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import WORKLOAD, beside_text
from harness.data import STAGES
from harness.records.run_row import RunBody
from harness.stats import interval, rates_of, ratio


def beside(rows: pd.DataFrame, run: pd.Series) -> pd.DataFrame:
    """Those of the rows that were interleaved with `run`, so that ratios are paired; all where none was.

    Among them the ones with as many repetitions, if there are any.
    """
    same = rows["beside"] == run["beside"]
    for column in ("kind", *WORKLOAD):
        same &= rows[column] == run[column]
    for kept in (rows[same & (rows["repetitions"] == run["repetitions"])], rows[same]):
        if not kept.empty:
            return kept
    return rows


def robust_embree(rows: pd.DataFrame) -> pd.DataFrame:
    """Those of `rows` that are Embree's in its robust mode, its default."""
    return rows[(rows["tracer"] == "embree") & rows["options"].isin(("", "robust=true"))]


def main_workload(rows: pd.DataFrame, by: str = "method", others: bool = True) -> pd.DataFrame:
    """Rows of each scene at the view, ray count and seed that have most different values of `by`, then
    most rays; with `others`, a tracer never run there keeps its own most rays (brute force is given fewer)."""
    kept = []
    for _, scene in rows.groupby("scene", sort=False):
        works = [work for _, work in scene.groupby(WORKLOAD[1:], sort=False)]
        main = max(works, key=lambda work: (work[by].nunique(), work["rays"].iloc[0]))
        here = scene.index.isin(main.index)
        absent = ~scene["tracer"].isin(main["tracer"])
        most = scene["rays"] == scene.groupby("tracer")["rays"].transform("max")
        kept.append(scene[here | (absent & most & others)])
    return pd.concat(kept).reset_index(drop=True) if kept else rows


def rays_note(numbers: pd.DataFrame) -> str:
    """One sentence: how many rays were traced, and on which scenes fewer or more."""
    counts = numbers.dropna(subset=["rays"]).groupby("scene", sort=False)["rays"].max().astype(int)
    usual = counts.mode().max()
    others = [f"{scene} {count:,}" for scene, count in counts.items() if count != usual]
    return f"Rays: {usual:,}" + (f" ({', '.join(others)})." if others else ".")


def best(rows: pd.DataFrame, rate: str = "total") -> pd.Series | None:
    """The run with the highest median rate; None where no run has that rate."""
    rated = rows[rows[rate].notna()]
    return None if rated.empty else rated.loc[rated[rate].idxmax()]


def stage_rates(run: RunBody, stage: str) -> list[float]:
    """Rays per second of each repetition of a stage; empty where the run has none."""
    seconds = getattr(run.samples, stage)
    return rates_of(seconds, run.rays.count) if seconds and min(seconds) > 0 else []


def speedup(run: RunBody, base: RunBody, stage: str) -> dict[str, float] | None:
    """Ratio of two runs' rates of a stage with its 95 % interval; None where either has no rate.

    Repetitions are paired where both runs have as many and were interleaved, beside the same grid; else the interval
    is the quotient of the two runs' own intervals, which is the wider one.
    """
    rates, base_rates = stage_rates(run, stage), stage_rates(base, stage)
    if not rates or not base_rates:
        return None
    if len(rates) == len(base_rates) and beside_text(run) == beside_text(base):
        found = ratio(rates, base_rates)
        return {"ratio": found.median, "ratio_low": found.low, "ratio_high": found.high}
    one, two = interval(rates), interval(base_rates)
    return {"ratio": one.median / two.median, "ratio_low": one.low / two.high, "ratio_high": one.high / two.low}


def stage_nanoseconds(run: RunBody) -> dict[str, float]:
    """Median nanoseconds a ray of each stage, what no stage accounts for as `other`, and the total."""
    samples = {stage: getattr(run.samples, stage) for stage in STAGES}
    times = {name: interval(each).median / run.rays.count * 1e9 if each else 0.0 for name, each in samples.items()}
    total = times.pop("total")
    return {**times, "other": max(0.0, total - sum(times.values())), "total": total}
