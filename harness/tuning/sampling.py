"""What a few thousand rays of a set meet in a grid, and the work of the whole set that follows from it."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from harness.data import Counters, Rays
from harness.device.opened import Device
from harness.device.runtime import cl
from harness.structures.contract import Structure
from harness.tracers.batch import Batch
from harness.tracers.device_tracer import DeviceTracer

SAMPLE_RAYS = 2048
LINE = 64  # bytes of a cache
CELLS_KEPT = 24  # non-empty cells of a sampled ray that are written down
MOST_WAVES = 32  # beyond, few rays are left
WIDEST_SPREAD = 5.0  # spread of cells' chances
HIDDEN_SHARES = 6  # of the cells that are tried as those that rays meet at all
UNSEEN_POWER = 2 / 3  # power of the part that the sample tells: of more rays some meet cells that it holds for hidden
POINTS, WEIGHTS = np.polynomial.hermite_e.hermegauss(24)  # of a mean over a normal distribution
WEIGHTS = WEIGHTS / WEIGHTS.sum()


@dataclass(frozen=True)
class RayWork:
    """What one ray costs on average. The names are those of the cost model's terms.

    `steps`, `pairs`, `tests`, `lane_tests` as in `Counters`; `slots`: pairs and the padding of their bins; `active`:
    waves that a ray takes part in; `waves`: waves over rays; `cell_waves`: bins to clear and to scan, over rays;
    `far`: the part of the triangles that the device's cache cannot hold; `far_bins`: that of the bins; `far_grid`:
    that of the tables that a walk reads.
    """

    steps: float
    pairs: float
    tests: float
    lane_tests: float = 0.0
    slots: float = 0.0
    active: float = 0.0
    waves: float = 0.0
    cell_waves: float = 0.0
    far: float = 0.0
    far_bins: float = 0.0
    far_grid: float = 0.0
    one: float = 1.0

    @property
    def far_tests(self) -> float:
        """Lane tests of triangles that are not in the cache."""
        return self.far * self.lane_tests

    @property
    def far_steps(self) -> float:
        """Steps into cells that are not in the cache."""
        return self.far_grid * self.steps

    @property
    def far_pairs(self) -> float:
        """Pairs whose bins are not in the cache."""
        return self.far_bins * self.pairs

    @property
    def far_slots(self) -> float:
        """Slots of bins whose triangles are not in the cache."""
        return self.far * self.slots


def counted_work(counters: Counters, rays: int, nonempty: int) -> RayWork:
    """The work of an instrumented run."""
    left = rays - np.cumsum([0, *counters.finished_per_wave[:-1]])
    return RayWork(
        steps=counters.steps / rays,
        pairs=counters.pairs / rays,
        tests=counters.tests / rays,
        lane_tests=counters.lane_tests / rays,
        slots=(counters.pairs + counters.padding) / rays,
        active=float(left.sum()) / rays if counters.waves else 0.0,
        waves=counters.waves / rays,
        cell_waves=nonempty * counters.waves / rays,
    )


@dataclass(frozen=True)
class Chances:
    """How unequally rays meet the cells of a grid: they meet only a `part` of them at all, among which the logarithm
    of a cell's chance is normal with standard deviation `spread`."""

    part: float
    spread: float


def _shares(cells: float, pairs: int, spread: float) -> np.ndarray:
    """Pairs expected in cells of every chance at POINTS, of `pairs` in all."""
    return pairs / cells * np.exp(spread * POINTS - spread**2 / 2)


def _spread(cells: float, pairs: int, seen: int) -> float:
    """The spread with which `pairs` in all lie in `seen` of the `cells`."""

    def surplus(spread: float) -> float:
        return cells * float(WEIGHTS @ -np.expm1(-_shares(cells, pairs, spread))) - seen

    if surplus(0.0) <= 0:
        return 0.0
    return brentq(surplus, 0.0, WIDEST_SPREAD, xtol=1e-2) if surplus(WIDEST_SPREAD) < 0 else WIDEST_SPREAD


def _met_once(cells: float, pairs: int, spread: float) -> float:
    """How many of the cells hold one pair."""
    shares = _shares(cells, pairs, spread)
    return cells * float(WEIGHTS @ (shares * np.exp(-shares)))


@dataclass(frozen=True, eq=False)
class Sample:
    """Sampled rays in one grid.

    `cells`, `references`, `steps` int32[n, SLOTS]: each non-empty cell of a ray, its references, the steps up to it;
    `found` int32[n] of them are filled. `needed`, `needed_steps`, `needed_tests` int32[n]: up to the hit, or to where
    the ray leaves the grid. `end_steps` int32[n]: up to the end of the walk.
    """

    cells: np.ndarray
    references: np.ndarray
    steps: np.ndarray
    found: np.ndarray
    needed: np.ndarray
    needed_steps: np.ndarray
    needed_tests: np.ndarray
    end_steps: np.ndarray

    def __len__(self) -> int:
        return len(self.needed)

    @cached_property
    def tests(self) -> np.ndarray:
        """References met in the first k cells, int64[n, SLOTS + 1]."""
        filled = np.arange(CELLS_KEPT) < self.found[:, None]
        sums = np.cumsum(np.where(filled, self.references, 0), axis=1)
        return np.concatenate([np.zeros((len(self), 1), np.int64), sums], axis=1)

    @cached_property
    def chances(self) -> Callable[[int], Chances]:
        """`chances(cells)`: how rays meet the grid's `cells` non-empty cells, from how many the sampled rays meet
        before they are through, and how many of those once. Each answer is kept with the sample, as every model asks
        for the same."""
        return functools.cache(self._chances)

    def _chances(self, cells: int) -> Chances:
        met = self.cells[np.arange(CELLS_KEPT) < np.minimum(self.found, self.needed)[:, None]]
        times = np.unique(met, return_counts=True)[1]
        seen, once = len(times), int((times == 1).sum())
        if not seen:
            return Chances(1.0, 0.0)
        parts = np.geomspace(1.0, min(1.05 * seen / cells, 1.0), HIDDEN_SHARES)
        # The smaller the part, the more alike its cells and the fewer of them are met once.
        surplus = np.array(
            [_met_once(part * cells, len(met), _spread(part * cells, len(met), seen)) - once for part in parts]
        )
        part = float(np.exp(np.interp(0.0, surplus[::-1], np.log(parts)[::-1]))) ** UNSEEN_POWER
        return Chances(part, _spread(part * cells, len(met), seen))

    def forward_work(self) -> RayWork:
        """The work of rays that test cell by cell and halt at the hit."""
        return RayWork(self.needed_steps.mean(), self.needed.mean(), self.needed_tests.mean())

    @cached_property
    def deferred_work(self) -> Callable[[int, int, int], tuple[RayWork, np.ndarray]]:
        """`deferred_work(wave, growth, rays)`: the work of that many rays that meet `wave` cells, then `growth` times
        as many, and so on, padding and bins left out, and the pairs of each of the first MOST_WAVES waves, a ray,
        float64[waves]. Each answer is kept with the sample."""
        return functools.cache(self._deferred_work)

    def _deferred_work(self, wave: int, growth: int, rays: int) -> tuple[RayWork, np.ndarray]:
        longest = self._longest(rays)
        ends = wave_ends(wave, growth, longest + 1)
        rows = np.arange(len(self))
        # Out of the grid, or beyond a hit that is not in the last cell met, a ray comes by walking on from there.
        walked_on = self.needed_steps > self.steps[rows, np.clip(self.needed - 1, 0, CELLS_KEPT - 1)]
        which = np.searchsorted(ends, self.needed + walked_on)  # the wave in which a ray finishes
        pairs = np.maximum(np.minimum(ends[which], self.found), self.needed)
        inside = pairs <= CELLS_KEPT
        place = np.minimum(pairs, CELLS_KEPT)
        left = place < ends[which]  # out of the grid before the wave was over
        steps = np.where(left, self.end_steps, self.steps[rows, np.maximum(place - 1, 0)])
        steps = np.where(inside, steps, np.maximum(self.needed_steps, self.end_steps))
        tests = np.where(inside, self.tests[rows, place], np.maximum(self.needed_tests, self.tests[rows, place]))
        filled = int(np.searchsorted(ends, longest)) + 1  # a last wave without a pair does not count
        shown = ends[: min(filled, MOST_WAVES)]
        per_wave = np.diff(np.minimum(pairs[:, None], shown).mean(axis=0), prepend=0.0)
        waves = filled / min(rays, 1e12)
        return RayWork(
            steps.mean(), pairs.mean(), tests.mean(), active=float(which.mean()) + 1, waves=waves
        ), per_wave

    def _longest(self, rays: int) -> int:
        """Cells to the hit of the ray that needs most: of more rays, more, as the number falls off exponentially."""
        growth = math.log(max(rays, 2)) / math.log(max(len(self), 2))
        return max(1, round(int(self.needed.max()) * max(growth, 1.0)))


def wave_ends(wave: int, growth: int, longest: int) -> np.ndarray:
    """Cells a ray has met at the end of each wave, int64[waves], until `longest` are."""
    ends, length = [wave], wave
    while ends[-1] < longest:
        length *= growth
        ends.append(ends[-1] + length)
    return np.array(ends)


def padding(pairs: np.ndarray, cells: float | np.ndarray, lanes: int, spread: float = 0.0) -> float | np.ndarray:
    """Unused slots of bins that hold whole chunks of `lanes`, the pairs[waves] of each wave over `cells` whose
    chances have that `spread` (`Chances`); of each of several numbers of cells float64[n]."""
    means, unused = _unused_slots(lanes)
    cells = np.asarray(cells, np.float64)[..., None]
    found = np.log(np.maximum(pairs / np.maximum(cells, 1e-9), 1e-12))[..., None] + spread * POINTS - spread**2 / 2
    return (cells * (np.interp(found, means, unused) @ WEIGHTS)).sum(axis=-1)


@functools.cache
def _unused_slots(lanes: int) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms of mean pairs in a bin, float64[m], and the unused slots expected there, by Poisson's law."""
    means = np.linspace(math.log(1e-6), math.log(1e3), 1000)
    held = np.arange(4 * lanes)
    factorials = np.array([math.lgamma(count + 1.0) for count in held])
    chance = np.exp(held * means[:, None] - np.exp(means)[:, None] - factorials)
    rest = np.maximum(1.0 - chance.sum(axis=1), 0.0)  # of bins with more: any remainder is as likely
    return means, chance @ (-held % lanes) + rest * (lanes - 1) / 2


def unused_slots(tracer: DeviceTracer, cells, per_wave: np.ndarray, rays: int, chances: Chances):
    """Unused slots a ray in the bins of a tracer, of as many numbers of cells as are given."""
    sets = bin_sets(tracer)
    met = chances.part * np.asarray(cells)
    return padding(per_wave * rays / sets, met, tracer.lanes, chances.spread) * sets / rays


def bin_sets(tracer: DeviceTracer) -> int:
    """How many sets of bins a tracer has: each stream its own."""
    return (tracer.options.streams or tracer.device.compute_units) if tracer.name == "streamed" else 1


def far_triangles(tracer: DeviceTracer) -> float:
    """The part of the triangles that the device's largest cache cannot hold."""
    return max(0.0, 1 - tracer.device.handle.global_mem_cache_size / max(tracer.triangles.nbytes, 1))


def far_bins(tracer: DeviceTracer, cells, chances: Chances):
    """The part of the bins that rays meet, a line of each being written, that the cache cannot hold beside all else
    it holds."""
    need = LINE * chances.part * cells * bin_sets(tracer)
    return need / (need + tracer.device.handle.global_mem_cache_size)


def far_grid(device: Device, table_bytes):
    """The part of a grid's tables of cells that the cache cannot hold beside all else it holds."""
    return table_bytes / (table_bytes + device.handle.global_mem_cache_size)


def some_of(rays: Rays, count: int = SAMPLE_RAYS) -> Rays:
    """At most `count` rays, evenly spread over the set."""
    return rays if len(rays) <= count else rays[np.linspace(0, len(rays) - 1, count).astype(np.int64)]


def sample_rays(tracer: DeviceTracer, rays: Rays) -> Sample:
    """Walk `rays` through the tracer's grid, with its intersector, on its device."""
    queue, batch = tracer.device.queue, Batch(tracer.device, rays)
    tracer.start(batch)
    grid: Structure = tracer.structure
    lists = [cl.array.empty(queue, batch.count * CELLS_KEPT, np.int32) for _ in range(3)]
    numbers = [cl.array.empty(queue, batch.count, np.int32) for _ in range(5)]
    program = tracer.program("studies/sample.cl", walks=True)
    program.launch(
        "sample_rays",
        batch.count,
        *(batch.count, batch.rays, batch.keys, *grid.arguments, grid.cell_start, grid.references),
        *(tracer.triangles, batch.positions, CELLS_KEPT, *lists, *numbers),
    )
    return Sample(*(array.get().reshape(-1, CELLS_KEPT) for array in lists), *(array.get() for array in numbers))
