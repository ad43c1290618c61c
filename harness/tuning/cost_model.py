"""The cost model: seconds of a ray as a sum of its work times coefficients that are fitted to measured runs.

a steps + b pairs + c tests, and what else a device spends on bins, waves and rays; each stage of a tracer has its own
terms, which the tracer states. Work at other densities follows power laws of the leaf cells per axis, their
exponents fitted as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.optimize import nnls

from harness.spec.tracer_facts import tracer_facts
from harness.tuning.sampling import RayWork

SCALED = ("steps", "pairs", "tests", "nonempty", "references")  # what has an exponent


@dataclass(frozen=True)
class TimedRun:
    """A measured run: the seconds of its stages and in total, its work, and its grid's size.

    `work`: a ray's. `per_axis`: leaf cells per axis of a top cell, the root mean cube. `references`: beyond the first
    of each triangle, which any grid has. `predicted_padding`: what
    `sampling.padding` makes of the run, 0 without one.
    """

    tracer: str
    scene: str
    rays: int
    seconds: dict[str, float]
    work: RayWork
    per_axis: float
    nonempty: int
    references: int
    setting: str = ""
    predicted_padding: float = 0.0

    @property
    def stages(self) -> dict[str, float]:
        """Seconds a ray of each stage that has terms; what is left of the total is `rest`."""
        named = [stage for stage in tracer_facts(self.tracer).terms if stage != "rest"]
        found = {stage: self.seconds.get(stage, 0.0) / self.rays for stage in named}
        return {**found, "rest": max(self.seconds["total"] / self.rays - sum(found.values()), 0.0)}


class CostModel(BaseModel):
    """Coefficients of one tracer with one intersector on one device.

    `coefficients`: nanoseconds, by stage and term. `exponents`: of the leaf cells per axis, for each of SCALED.
    `padding`: measured over predicted padding. `idle`: idle lanes' share of lane tests over that of padding among the
    slots of bins, below 1 as few rays are tested a triangle a lane.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    tracer: str
    coefficients: dict[str, dict[str, float]]
    exponents: dict[str, float]
    padding: float = 1.0
    idle: float = 1.0

    def nanoseconds(self, work: RayWork):
        """Predicted time of one ray; of each of several grids where the work's numbers are arrays."""
        return sum(
            value * getattr(work, term) for terms in self.coefficients.values() for term, value in terms.items()
        )

    def scaled(self, work: RayWork, finer) -> RayWork:
        """The work in a grid with `finer` times as many leaf cells per axis; bins are the caller's."""
        factors = {name: getattr(work, name) * finer ** self.exponents[name] for name in ("steps", "pairs", "tests")}
        return replace(work, **factors)

    def factor(self, name: str, finer):
        """How many times as many of `name` there are with `finer` times as many leaf cells per axis."""
        return finer ** self.exponents[name]


def fit(tracer: str, runs: Sequence[TimedRun]) -> CostModel:
    """Fit coefficients, none negative, by least squares of relative errors, stage by stage, and exponents."""
    coefficients = {stage: _fit_stage(stage, terms, runs) for stage, terms in tracer_facts(tracer).terms.items()}
    measured = [r for r in runs if r.predicted_padding > 0]
    ratios = [max(r.work.slots - r.work.pairs, 1e-9) / r.predicted_padding for r in measured]
    padding = float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0
    idle = [
        max(r.work.lane_tests - r.work.tests, 1e-9) * r.work.pairs / (r.work.tests * (r.work.slots - r.work.pairs))
        for r in measured
        if r.work.slots > r.work.pairs and r.work.tests > 0
    ]
    return CostModel(
        tracer=tracer,
        coefficients=coefficients,
        exponents=_exponents(runs),
        padding=padding,
        idle=float(np.exp(np.mean(np.log(idle)))) if idle else 1.0,
    )


def _fit_stage(stage: str, terms: Iterable[str], runs: Sequence[TimedRun]) -> dict[str, float]:
    terms = list(terms)
    # A stage that is a small part of a run may be off by much: what counts is the error of the whole.
    weights = np.array([run.rays / run.seconds["total"] for run in runs])
    matrix = np.array([[getattr(run.work, term) for term in terms] for run in runs])
    seconds = np.array([run.stages[stage] for run in runs])
    scale = np.maximum(np.abs(matrix).max(axis=0), 1e-12)  # terms differ by many powers of ten
    values, _ = nnls(matrix / scale * weights[:, None], seconds * weights)
    return {term: float(1e9 * value) for term, value in zip(terms, values / scale, strict=True)}


def _exponents(runs: Sequence[TimedRun]) -> dict[str, float]:
    """Slopes of log(counts) over log(leaf cells per axis), common to all scenes and settings."""
    slopes = {}
    for name in SCALED:
        over, under = 0.0, 0.0
        for key in {(run.scene, run.setting) for run in runs}:
            same = [run for run in runs if (run.scene, run.setting) == key]
            x = np.log([run.per_axis for run in same])
            y = np.log([max(getattr(run, name, None) or getattr(run.work, name), 1e-9) for run in same])
            x = x - x.mean()
            over, under = over + float(x @ y), under + float(x @ x)
        slopes[name] = over / under if under else 0.0
    return slopes
