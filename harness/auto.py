"""`--grid auto`: the density of an adaptive grid and the deferred tracer's wave and batch, by a cost model.

A grid of the default density is built on trial and a sample of the rays walked through it; their work at every other
setting follows, and the model says what it costs. Among settings within TOLERANCE of the best, the smallest is taken.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from harness import tracers
from harness.adaptive import DENSITY, AdaptiveGrid, levels_of
from harness.calibrate import FAST, cost_model
from harness.cost_model import CostModel
from harness.data import ADAPTIVE_LEAF, GridSpec, Rays
from harness.grid import Grid, build_grid
from harness.intersectors import Intersector
from harness.sampling import Sample, Work, padding, sample_rays, some_of
from harness.tracers._base import Setting

TOLERANCE = 0.05
DENSITIES = tuple(DENSITY * 2.0**k for k in range(-3, 4))
WAVES = ((2, 1), (2, 2), (4, 1), (4, 2), (6, 1), (8, 1), (8, 2), (16, 1))  # wave and growth
BATCHES = (1 << 20, 1 << 22)
FEW_RAYS = 1 << 16  # of fewer, tracing takes less time than choosing could save
UNCHOSEN_WAVE = {"wave": "4"}


@dataclass(frozen=True)
class Candidate:
    """A setting with its predicted time of a ray and its grid's predicted size. `wave`, `growth`, `batch` of the
    deferred tracer, 0 for others."""

    density: float
    wave: int
    growth: int
    batch: int
    nanoseconds: float
    bytes: float

    def __str__(self) -> str:
        parts = [f"density {self.density:g}"]
        if self.wave:
            parts.append(f"wave {self.wave}" + (f" growth {self.growth}" if self.growth > 1 else ""))
            parts.append(f"batch {self.batch}")
        return ", ".join(parts)

    @property
    def options(self) -> dict[str, str]:
        """As options of the tracer."""
        if not self.wave:
            return {}
        return {**FAST, "wave": str(self.wave), "growth": str(self.growth), "batch": str(self.batch)}


@dataclass(frozen=True, eq=False)
class Choice:
    """The grid, the options it goes with, and why in one line.

    `seconds`: sampling and predicting, programs compiled beforehand. `trial_seconds`: building the trial grid, 0
    where it is the grid chosen. `candidates`: all that was compared.
    """

    grid: Grid
    options: dict[str, str]
    why: str
    seconds: float
    trial_seconds: float
    candidates: tuple[Candidate, ...] = field(default=(), repr=False)

    def options_for(self, tracer: str, given: dict[str, str]) -> dict[str, str]:
        """Options of a run: those given, and for a deferred tracer what was chosen where nothing was given."""
        if tracer != "deferred":
            return dict(given)
        chosen = dict(self.options)
        if "wave" in given:
            chosen.pop("growth", None)  # it belongs to the wave that was chosen
        return {**chosen, **given}

    def describe(self) -> dict:
        """For the `grid` part of a record."""
        return {"chosen": self.why, "choosing_seconds": self.seconds, "trial_build_seconds": self.trial_seconds}


def choose(
    setting: Setting,
    rays: Rays,
    tracer: str,
    intersector: Intersector,
    given: dict[str, str] | None = None,
    tell: Callable[[str], None] | None = None,
) -> Choice:
    """Choose for `rays` in the scene of `setting` and build the grid.

    `given`: the tracer's options that are settled. `tell` hears that the model is fitted to the device, where it has
    to be. Raises DefrayError where the grid does not fit the device.
    """
    trial = build_grid(setting.device_scene, trial_spec())
    if len(rays) < FEW_RAYS:
        why = f"density {DENSITY:g}, the default: {len(rays):,} rays are too few for choosing to pay"
        return Choice(trial, {**FAST, **UNCHOSEN_WAVE}, why, 0.0, 0.0)
    family = "deferred" if tracer == "deferred" else "forward"
    model = cost_model(setting.device, family, intersector, tell)
    walker = tracers.find(family)(replace(setting, grid=trial), intersector, {})
    sample_rays(walker, some_of(rays, 64))  # compiles
    started = time.perf_counter()
    sample = sample_rays(walker, some_of(rays))
    made = candidates(model, sample, trial, len(rays), walker.lanes, given or {})
    taken = pick(made)
    seconds = time.perf_counter() - started
    grid, trial_seconds = trial, 0.0
    if taken.density != DENSITY:
        grid, trial_seconds = build_grid(setting.device_scene, spec_of(taken)), trial.build_seconds
    return Choice(grid, taken.options, explain(taken, made), seconds, trial_seconds, tuple(made))


def prepare_grid(
    setting: Setting,
    rays: Rays,
    spec: GridSpec,
    tracer: str,
    intersector: Intersector,
    given: dict[str, str] | None = None,
    tell: Callable[[str], None] | None = None,
) -> tuple[Grid, Choice | None]:
    """The grid of a spec, built, and the choice it comes from where the spec is `auto`."""
    if spec.reading != "auto":
        return build_grid(setting.device_scene, spec), None
    choice = choose(setting, rays, tracer, intersector, given, tell)
    return choice.grid, choice


def trial_spec() -> GridSpec:
    """The grid built on trial."""
    return GridSpec(0, ADAPTIVE_LEAF, "adaptive", DENSITY)


def spec_of(candidate: Candidate) -> GridSpec:
    """A candidate's grid."""
    return GridSpec(0, ADAPTIVE_LEAF, "adaptive", candidate.density)


def candidates(
    model: CostModel, sample: Sample, trial: AdaptiveGrid, rays: int, lanes: int, given: dict[str, str]
) -> list[Candidate]:
    """Every density with every wave and batch that the options given allow."""
    sizes = [(density, *_size(model, trial, density)) for density in DENSITIES]
    if model.tracer != "deferred":
        work = sample.forward_work()
        return [
            Candidate(density, 0, 0, 0, model.nanoseconds(model.scaled(work, finer)), size)
            for density, finer, size in sizes
        ]
    made = []
    for batch in batches(rays, given):
        at_once = min(rays, batch)
        for wave, growth in waves(given):
            work, per_wave = sample.deferred_work(wave, growth, at_once)
            for density, finer, size in sizes:
                whole = _with_bins(model, work, per_wave, trial, finer, at_once, lanes)
                made.append(Candidate(density, wave, growth, batch, model.nanoseconds(whole), size))
    return made


def _with_bins(
    model: CostModel, work: Work, per_wave: np.ndarray, trial: Grid, finer: float, rays: int,
    lanes: int,
) -> Work:
    """The work of a setting, its bins counted in."""
    scaled, cells = model.scaled(work, finer), model.factor("nonempty", finer)
    empty = model.padding * padding(per_wave * rays, trial.nonempty * cells, lanes) / rays
    return replace(
        scaled,
        slots=scaled.pairs + empty,
        lane_tests=scaled.tests * (1 + model.idle * empty / max(scaled.pairs, 1e-9)),
        cell_waves=trial.nonempty * cells * len(per_wave) / rays,
        waves=len(per_wave) / rays,
    )


def _size(model: CostModel, trial: AdaptiveGrid, density: float) -> tuple[float, float]:
    """How many times as many leaf cells per axis a density gives as the trial grid has, and its bytes."""
    level = levels_of(trial.top_counts, density, trial.shape[3])
    finer = float(((8**level).sum() / max(trial.cells, 1)) ** (1 / 3))
    references = len(trial.references) * model.factor("references", finer)
    nonempty = trial.nonempty * model.factor("nonempty", finer)
    return finer, trial.top_block.nbytes + 8.0 * (8.0**level).sum() + 4 * (references + nonempty)


def waves(given: dict[str, str]) -> list[tuple[int, int]]:
    """Wave and growth of the candidates: a wave that is given is kept, as is a growth."""
    wave, growth = given.get("wave"), given.get("growth")
    if wave == "all":
        return [(1 << 12, 1)]
    made = [(w, g) for w, g in WAVES if wave is None or str(w) == wave]
    made = [(w, g) for w, g in made if growth is None or str(g) == growth]
    return made or [(int(wave or 4), int(growth or 1))]


def batches(rays: int, given: dict[str, str]) -> list[int]:
    """Rays at a time: what is given, else the smallest sizes, up to one that holds all rays."""
    if "batch" in given:
        return [int(given["batch"])]
    return [size for size, below in zip(BATCHES, (0, *BATCHES), strict=False) if rays > below]


def pick(made: list[Candidate]) -> Candidate:
    """Among those within TOLERANCE of the best: the smallest batch, then the smallest grid, then the fastest."""
    best = min(c.nanoseconds for c in made)
    near = [c for c in made if c.nanoseconds <= (1 + TOLERANCE) * best]
    return min(near, key=lambda c: (c.batch, c.bytes, c.nanoseconds))


def explain(taken: Candidate, made: list[Candidate]) -> str:
    """What was chosen and why, in one line."""
    best = min(made, key=lambda c: c.nanoseconds)
    size = f"{taken.bytes / 2**20:.1f} MiB"
    text = f"{taken}: predicted {taken.nanoseconds:.0f} ns a ray and {size}"
    if taken is best:
        return f"{text}, the best of {len(made)} settings"
    more = taken.nanoseconds / best.nanoseconds - 1
    return (
        f"{text}, the smallest within {TOLERANCE:.0%} of the best of {len(made)} settings "
        f"({best}: {more:.1%} faster, {best.bytes / 2**20:.1f} MiB)"
    )
