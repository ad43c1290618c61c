"""`--grid auto`: the density of an adaptive grid and a deferred tracer's waves and batch, by a cost model.

A grid of half the default density is built on trial and a sample of the rays walked through it; their work at every
other setting follows, and the model says what it costs. Of those within TOLERANCE of the best the smallest is taken.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from harness import structures, tracers
from harness.data import Rays
from harness.spec import intersectors
from harness.spec.intersectors import Intersector
from harness.spec.run_spec import Variant
from harness.spec.structure import AUTO, Adaptive, StructureSpec
from harness.spec.tracer_facts import listed_tracers, tracer_facts
from harness.structures.adaptive import DENSITY, AdaptiveGrid, levels_of, table_bytes
from harness.tracers.device_tracer import DeviceTracer
from harness.tracers.prepared import Prepared
from harness.tuning.cost_model import CostModel
from harness.tuning.fit import cost_models
from harness.tuning.sampling import (
    Chances,
    RayWork,
    Sample,
    far_bins,
    far_grid,
    far_triangles,
    sample_rays,
    some_of,
    unused_slots,
)

TOLERANCE = 0.05
DENSITIES = tuple(DENSITY * 2.0**k for k in range(-2, 4))  # much coarser than the trial grid, predictions are off
TRIAL = DENSITY / 2  # of the grid built on trial: in the middle of what is chosen, and so often the one
WAVES = ((2, 1), (2, 2), (3, 2), (4, 1), (4, 2), (8, 2))  # wave and growth
BATCHES = (1 << 20, 1 << 22)
FEW_RAYS = 1 << 16  # of fewer, tracing takes less time than choosing could save
DEFERRED = ("deferred", "streamed")


@dataclass(frozen=True)
class Candidate:
    """A setting of a tracer with its predicted time of a ray and its grid's predicted size. `wave`, `growth`, `batch`
    of the two deferred tracers, 0 for others."""

    tracer: str
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
        chosen = {"wave": str(self.wave), "growth": str(self.growth), "batch": str(self.batch)}
        return {**tracer_facts(self.tracer).fast_options, **chosen}


@dataclass(frozen=True, eq=False)
class Choice:
    """The grid, the options it goes with for each tracer, and why in one line.

    `seconds`: sampling and predicting, programs compiled beforehand. `trial_seconds`: building the trial grid, 0
    where it is the grid chosen. `candidates`: all that was compared.
    """

    grid: AdaptiveGrid
    options: dict[str, dict[str, str]]
    why: str
    seconds: float
    trial_seconds: float
    candidates: tuple[Candidate, ...] = field(default=(), repr=False)

    def options_for(self, tracer: str, given: dict[str, str]) -> dict[str, str]:
        """Options of a run: those given, and what was chosen for its tracer where nothing was given."""
        chosen = dict(self.options.get(tracer, {}))
        if "wave" in given:
            chosen.pop("growth", None)  # it belongs to the wave that was chosen
        return {**chosen, **given}

    def chosen_variant(self, variant: Variant) -> Variant:
        """The variant with what was chosen for its tracer."""
        return variant.model_copy(update={"options": self.options_for(variant.tracer, variant.options)})

    def describe(self) -> dict:
        """For the `grid` part of a record."""
        return {"chosen": self.why, "choosing_seconds": self.seconds, "trial_build_seconds": self.trial_seconds}


def choose(
    prepared: Prepared,
    rays: Rays,
    tracer: str,
    intersector: Intersector,
    given: dict[str, str] | None = None,
    tell: Callable[[str], None] | None = None,
) -> Choice:
    """Choose for `rays` in the scene of `prepared` and build the grid.

    `given`: the tracer's options that are given. `tell` hears that the model is fitted to the device, where it has
    to be. Raises DefrayError where the grid does not fit the device.
    """
    if len(rays) < FEW_RAYS:
        why = f"density {DENSITY:g}, the default: {len(rays):,} rays are too few for choosing to pay"
        grid = structures.build(prepared.device_scene, Adaptive(DENSITY))
        fast = {name: dict(one.facts.fast_options) for name, one in listed_tracers().items()}
        return Choice(grid, fast, why, 0.0, 0.0)
    family, given = tracer if tracer in DEFERRED else "forward", given or {}
    trial = structures.build(prepared.device_scene, Adaptive(TRIAL))
    models = cost_models(prepared.device, family, intersector, tell)
    on_trial = prepared.with_structure(trial)
    walkers = {
        name: tracers.open_tracer(
            on_trial,
            Variant(tracer=name, intersector=intersector.name, options=given if name == tracer else {}),
        )
        for name in models
    }
    sample_rays(walkers[family], some_of(rays, 64))  # compiles
    started = time.perf_counter()
    sample = sample_rays(walkers[family], some_of(rays))
    made = {
        name: candidates(models[name], sample, walker, len(rays), given if name == tracer else {})
        for name, walker in walkers.items()
    }
    taken = pick(made[family])
    seconds = time.perf_counter() - started
    grid, trial_seconds = trial, 0.0
    if taken.density != TRIAL:
        grid, trial_seconds = structures.build(prepared.device_scene, Adaptive(taken.density)), trial.build_seconds
    options = {name: pick([c for c in some if c.density == taken.density]).options for name, some in made.items()}
    return Choice(
        grid, {**options, family: taken.options}, explain(taken, made), seconds, trial_seconds, tuple(made[family])
    )


def in_structure(
    prepared: Prepared,
    rays: Rays,
    spec: StructureSpec,
    variant: Variant,
    tell: Callable[[str], None] | None = None,
) -> tuple[Prepared, Choice | None]:
    """`prepared` in the structure of a spec, built; and the choice it comes from where the spec is `auto`."""
    if spec != AUTO:
        return prepared.with_structure(spec), None
    intersector = intersectors.find(variant.intersector or intersectors.DEFAULT)
    choice = choose(prepared, rays, variant.tracer, intersector, variant.options, tell)
    return prepared.with_structure(choice.grid), choice


def candidates(
    model: CostModel, sample: Sample, walker: DeviceTracer, rays: int, given: dict[str, str]
) -> list[Candidate]:
    """Every density with every wave and batch that the options given allow; `walker` walked `sample`."""
    trial, tracer = walker.structure, model.tracer
    sizes = [_size(model, trial, density, walker.scene.active_count) for density in DENSITIES]
    finer, tables, sizes = (np.array(values) for values in zip(*sizes, strict=True))

    def of(work: RayWork, wave: int, growth: int, batch: int) -> list[Candidate]:
        times = np.broadcast_to(model.nanoseconds(work), sizes.shape)
        return [
            Candidate(tracer, density, wave, growth, batch, float(time), float(size))
            for density, time, size in zip(DENSITIES, times, sizes, strict=True)
        ]

    if tracer not in DEFERRED:
        return of(model.scaled(sample.forward_work(), finer), 0, 0, 0)
    made, chances, beyond = [], sample.chances(trial.nonempty), far_triangles(walker)
    for batch in batches(rays, given):
        at_once = min(rays, batch)
        for wave, growth in waves(given):
            work, per_wave = sample.deferred_work(wave, growth, at_once)
            work = replace(work, far=beyond, far_grid=far_grid(walker.device, tables))
            made += of(_with_bins(model, work, per_wave, walker, finer, at_once, chances), wave, growth, batch)
    return made


def _with_bins(
    model: CostModel,
    work: RayWork,
    per_wave: np.ndarray,
    walker: DeviceTracer,
    finer: np.ndarray,
    rays: int,
    chances: Chances,
) -> RayWork:
    """The work of a setting in grids `finer` float64[n] times as fine, its bins counted in."""
    scaled, cells = model.scaled(work, finer), walker.structure.nonempty * model.factor("nonempty", finer)
    empty = model.padding * unused_slots(walker, cells, per_wave, rays, chances)
    return replace(
        scaled,
        slots=scaled.pairs + empty,
        lane_tests=scaled.tests * (1 + model.idle * empty / np.maximum(scaled.pairs, 1e-9)),
        far_bins=far_bins(walker, cells, chances),
        cell_waves=cells * work.waves,
    )


def _size(model: CostModel, trial: AdaptiveGrid, density: float, triangles: int) -> tuple[float, float, float]:
    """How many times as many leaf cells per axis a density gives as the trial grid has, the bytes of its tables of
    cells, and of all of it.

    Every triangle has one reference, however coarse the grid; what it has beyond that grows with the cells.
    """
    counts, times = trial.counted
    cells = float(times @ 8.0 ** levels_of(counts, density, trial.shape[3]))
    finer = (cells / max(trial.leaf_cells, 1)) ** (1 / 3)
    references = triangles + (len(trial.references) - triangles) * model.factor("references", finer)
    nonempty = trial.nonempty * model.factor("nonempty", finer)
    tables = table_bytes(trial.top_cells.nbytes, cells)
    return finer, tables, tables + 4 * (references + nonempty)


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


def explain(taken: Candidate, made: dict[str, list[Candidate]]) -> str:
    """What was chosen and why, in one line; `made`: the candidates of every tracer compared."""
    own = made[taken.tracer]
    best = min(own, key=lambda c: c.nanoseconds)
    text = f"{taken}: predicted {taken.nanoseconds:.0f} ns a ray and {taken.bytes / 2**20:.1f} MiB"
    if taken is best:
        text = f"{text}, the best of {len(own)} settings"
    else:
        more = taken.nanoseconds / best.nanoseconds - 1
        text += (
            f", the smallest within {TOLERANCE:.0%} of the best of {len(own)} settings "
            f"({best}: {more:.1%} faster, {best.bytes / 2**20:.1f} MiB)"
        )
    for name, others in made.items():
        if name != taken.tracer:
            rival = pick(others)
            than = "faster" if rival.nanoseconds < taken.nanoseconds else "slower"
            text += f"; {name}, with {rival}, is predicted {than}: {rival.nanoseconds:.0f} ns"
    return text
