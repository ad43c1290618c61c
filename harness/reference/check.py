"""The check of hits: every ray of a run falls in one class, against Embree and exact arithmetic.

Classes: `same`; `tie`, another primitive at the same t; `t_off`, the right primitive with an inaccurate t;
`wrong`, another primitive at another t; `missed`, no hit where there is one; `phantom`, a hit where there is
none. Distances are in local ulp, 2^-24 * max|vertex - origin|: what float32 resolves of a triangle from
there.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from harness.data import CLASSES, MISS, Hits, Rays
from harness.errors import known
from harness.records.agreement import Agreement, RelativeError
from harness.reference.embree_scene import EmbreeScene
from harness.reference.exact import Measure, measure
from harness.reference.oracle import Oracle, Truth

# The numbers below were chosen with 4 M rays aimed near triangles' edges in Sponza, Conference, Crown and San
# Miguel, half of them grazing at 1e-3, in float32 Moller-Trumbore and ray-space tests.
#
# An honest float32 test errs by up to 1 (ray space) or 520 ulp (Moller-Trumbore, at a sliver's short edge),
# but by no more than 1.7 ulp times the condition: longest edge / (edge * sine of its angle with the ray).
# Likewise its t is off the plane by no more than 4 ulp times the aspect (longest edge squared / twice area).
BAND_ULP = 64.0  # an error of up to so many local ulp is rounding at a silhouette
BAND_CONDITIONED = 16.0  # and so is one of up to so many ulp times condition or aspect: 4 times the worst
TIE_ULP = 16.0  # two primitives are at the same t within so much: two honest t, each off by 8
T_RESIDUAL_ULP = 64.0  # t further off the plane than this is counted as t_off
T_GROSS_RELATIVE = 1e-3  # a t_off beyond BAND_CONDITIONED voids the run when its relative error exceeds this
MOST_DISAGREEING = 1e-4  # rate of wrong, missed and phantom rays that still is rounding, not a fault
MOST_EXACT = 4096  # disputes of a run that are settled exactly; a run with more is broken, not disputed
WORST_BAND = 2.0**40  # stands for any greater distance, a hit on a triangle without area included
_CHUNK = 1 << 16  # rays compared at once by a thread
SAME, TIE, T_OFF, WRONG, MISSED, PHANTOM = range(len(CLASSES))


class _Verdicts:
    """What is known of each ray so far: 12 bytes a ray."""

    def __init__(self, count: int):
        self.classes = np.full(count, SAME, np.uint8)
        self.relative = np.full(count, np.nan, np.float32)  # error of t; NaN: no hit claimed
        self.nonfinite = np.zeros(count, bool)
        self.malformed = np.zeros(count, bool)
        self.disputed = np.zeros(count, bool)
        self.t_off = np.zeros(count, bool)
        self.t_gross = np.zeros(count, bool)
        self.band_gross = np.zeros(count, bool)
        self.worst_band = 0.0
        self.reference_wrong = 0
        self.settled = 0

    def __getitem__(self, rows: slice) -> _Verdicts:
        """Views of some rays' arrays."""
        part = _Verdicts(0)
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                setattr(part, name, value[rows])
        return part


class Checker:
    """Checks runs on the same triangles and rays; references and settled rays are kept between runs.

    `triangles` float32[n,3,3]; `rays` of any direction length and t_max; `mode`: `embree` (Embree on all
    rays, exact arithmetic on the disputed ones), `exact` (exact arithmetic on all: about a millisecond a ray)
    or `none`. `active` bool[n] or None: the triangles that take part; a hit on another one is malformed.
    `embree` and `oracle` (or what makes it at the first dispute), built with the same `active`, may be shared between
    checkers of one scene. Raises DefrayError for an unknown mode.
    """

    def __init__(
        self,
        triangles: np.ndarray,
        rays: Rays,
        mode: str = "embree",
        active: np.ndarray | None = None,
        embree: EmbreeScene | None = None,
        oracle: Oracle | Callable[[], Oracle] | None = None,
    ):
        if mode not in ("embree", "exact", "none"):
            raise known("check", mode, ("embree", "exact", "none"))
        self.triangles, self.rays, self.mode, self.active = triangles, rays, mode, active
        self._embree, self._oracle = embree, oracle
        self._reference: np.ndarray | None = None
        self._truths: dict[int, Truth] = {}

    def check(self, hits: Hits) -> Agreement:
        """Class every ray of a run. Never raises for bad hits: they make the run invalid."""
        agreement = Agreement(reference=self.mode, rays=len(self.rays))
        if self.mode == "none":
            return agreement
        fault = _shape_fault(hits, len(self.rays))
        if fault:
            return agreement.model_copy(update={"wrong": len(self.rays), "reason": fault})
        verdicts = _Verdicts(len(self.rays))
        reference = self.reference if self.mode == "embree" else None
        rows = [slice(first, first + _CHUNK) for first in range(0, len(self.rays), _CHUNK)]
        with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
            list(pool.map(lambda part: self._compare(part, hits[part], verdicts[part], reference), rows))
        unsettled = self._settle_all(hits, verdicts)
        return _summary(agreement, verdicts, unsettled)

    @property
    def reference(self) -> np.ndarray:
        """int32[rays]: the primitives Embree's robust mode hits, -1 = miss; traced at first use."""
        if self._reference is None:
            scene = self._embree or EmbreeScene(self.triangles, robust=True, active=self.active)
            self._embree = None  # a large scene's BVH is not kept for the sake of rays already traced
            self._reference = scene.trace(self.rays).primitive
            self._reference[~_can_hit(self.rays)] = MISS
        return self._reference

    def reference_t(self) -> np.ndarray:
        """float64[rays]: t of the reference's hits on their planes, inf = miss; exact where a ray was settled."""
        t = np.full(len(self.rays), np.inf)
        hit = np.flatnonzero(self.reference != MISS)
        for first in range(0, len(hit), _CHUNK):
            rows = hit[first : first + _CHUNK]
            t[rows] = self._measure(self.rays[rows], self.reference[rows]).t
        for row, truth in self._truths.items():
            t[row] = truth.t
        return t

    @property
    def oracle(self) -> Oracle:
        """The exact oracle, built at the first dispute."""
        if not isinstance(self._oracle, Oracle):
            self._oracle = self._oracle() if self._oracle else Oracle(self.triangles, self.active)
        return self._oracle

    def _compare(self, rows: slice, hits: Hits, verdicts: _Verdicts, reference) -> None:
        """Classes of some rays as far as float64 decides; the others are marked as disputed."""
        rays = self.rays[rows]
        _structure(hits, rays, len(self.triangles), self.active, verdicts)
        sound = ~verdicts.malformed
        claims = np.flatnonzero(sound & (hits.primitive != MISS))
        ours = self._measure(rays[claims], hits.primitive[claims])
        _judge_t(ours, hits.t[claims].astype(np.float64), claims, verdicts)
        verdicts.classes[verdicts.malformed] = WRONG
        if reference is None:
            verdicts.disputed[:] = sound
            return
        differs = sound & (hits.primitive != reference[rows])
        verdicts.disputed[:] = differs
        outside = _gross(-ours.margin, -ours.conditioned)
        verdicts.disputed[claims] |= outside | np.isnan(ours.t) | (hits.t[claims] == 0)
        both = np.flatnonzero(differs[claims] & (reference[rows][claims] != MISS))
        theirs = self._measure(rays[claims[both]], reference[rows][claims[both]])
        separation, _ = _separation(_pick(ours, both), theirs)
        tied = claims[both[(separation <= TIE_ULP) & ~outside[both]]]
        verdicts.classes[tied] = TIE
        verdicts.disputed[tied] = False

    def _settle_all(self, hits: Hits, verdicts: _Verdicts) -> int:
        """Decide disputed rays exactly, evenly spread ones where they are too many; how many are left."""
        disputed = np.flatnonzero(verdicts.disputed)
        left = np.empty(0, np.intp)
        if self.mode == "embree" and len(disputed) > MOST_EXACT:
            chosen = np.linspace(0, len(disputed) - 1, MOST_EXACT).astype(np.intp)
            left, disputed = np.delete(disputed, chosen), disputed[chosen]
            missed, phantom = hits.primitive[left] == MISS, self.reference[left] == MISS
            verdicts.classes[left] = np.where(missed, MISSED, np.where(phantom, PHANTOM, WRONG))
        for row in disputed:
            self._settle(int(row), int(hits.primitive[row]), verdicts)
        verdicts.settled = len(disputed)
        verdicts.classes[verdicts.t_off & (verdicts.classes <= TIE)] = T_OFF
        return len(left)

    def _settle(self, row: int, primitive: int, verdicts: _Verdicts) -> None:
        """Class one ray by its exact truth, and measure how far a wrong answer is from being right."""
        truth = self._truth(row)
        if self._right(row, primitive, truth):
            verdicts.classes[row] = SAME if primitive == truth.primitive else TIE
            if self.mode == "embree" and not self._right(row, int(self.reference[row]), truth):
                verdicts.reference_wrong += 1
            return
        if primitive == MISS:
            verdicts.classes[row] = MISSED
        else:
            verdicts.classes[row] = WRONG if truth.primitives else PHANTOM
        distance, conditioned = self._distance_from_right(row, primitive)
        verdicts.band_gross[row] = _gross(distance, conditioned).any()
        verdicts.worst_band = min(max(verdicts.worst_band, float(distance.max())), WORST_BAND)

    def _truth(self, row: int) -> Truth:
        if row not in self._truths:
            rays = self.rays
            truth = self.oracle.first_hit(rays.origins[row], rays.directions[row], rays.t_max[row])
            self._truths[row] = truth
        return self._truths[row]

    def _right(self, row: int, primitive: int, truth: Truth) -> bool:
        """Whether an answer is the truth, or hits within the band at the truth's t within the tie bound."""
        if primitive == truth.primitive or primitive in truth.primitives:
            return True
        if primitive == MISS or not truth.primitives:
            return False
        pair = self._measure(self.rays[[row, row]], np.array([primitive, truth.primitive]))
        separation, _ = _separation(_pick(pair, [0]), _pick(pair, [1]))
        return bool(separation[0] <= TIE_ULP and not _gross(-pair.margin[:1], -pair.conditioned[:1])[0])

    def _distance_from_right(self, row: int, primitive: int) -> tuple[np.ndarray, np.ndarray]:
        """Local ulp, plain and by condition, by which a wrong answer fails: one for each of its faults.

        Faults are the claimed triangle, as far as the ray passes outside it, and every nearer triangle that
        was skipped, as far as the ray passes inside it and in front of the claimed hit.
        """
        limit, own = self.rays.t_max[row], None
        if primitive != MISS:
            own = self._measure(self.rays[[row]], np.array([primitive]))
            limit = limit if np.isnan(own.t[0]) else np.minimum(limit, own.t[0])
        found = self.oracle.all_hits(self.rays.origins[row], self.rays.directions[row], limit)
        skipped = np.array([other for _, other in found if other != primitive], np.intp)
        through = self._measure(self.rays[np.full(len(skipped), row)], skipped)
        plain, conditioned = through.margin, through.conditioned
        if own is not None:
            separation, by_aspect = _separation(through, own)
            plain = np.append(np.fmin(plain, separation), -own.margin)
            conditioned = np.append(np.fmin(conditioned, by_aspect), -own.conditioned)
        # a true hit has no negative margin but by float64's own rounding
        return np.maximum(np.append(plain, 0), 0), np.maximum(np.append(conditioned, 0), 0)

    def _measure(self, rays: Rays, primitives) -> Measure:
        return measure(self.triangles[primitives], rays.origins, rays.directions, rays.t_max)


def _can_hit(rays: Rays) -> np.ndarray:
    """bool[rays]: finite, with a direction and a positive range."""
    result = np.isfinite(rays.origins).all(axis=1) & np.isfinite(rays.directions).all(axis=1)
    return result & rays.directions.any(axis=1) & (rays.t_max > 0)


def _shape_fault(hits: Hits, count: int) -> str:
    """What is wrong with the arrays of the hits as a whole, or nothing."""
    for name, dtype in (("t", np.float32), ("primitive", np.int32), ("u", np.float32), ("v", np.float32)):
        array = getattr(hits, name)
        if not isinstance(array, np.ndarray) or array.dtype != dtype or array.shape != (count,):
            found = f"{getattr(array, 'dtype', type(array).__name__)}{list(np.shape(array))}"
            return f"{name} is {found}, not {np.dtype(dtype)}[{count}]"
    return ""


def _structure(hits: Hits, rays: Rays, triangles: int, active, verdicts: _Verdicts) -> None:
    """Mark rays whose fields contradict each other or leave their range.

    t = 0 on a ray that starts on a triangle is rounding, not a contradiction: it is disputed, and settled.
    """
    claimed = hits.primitive != MISS
    verdicts.nonfinite[:] = np.isnan(hits.t) | ~np.isfinite(hits.u) | ~np.isfinite(hits.v)
    verdicts.nonfinite[:] |= claimed & ~np.isfinite(hits.t)
    known_primitive = (hits.primitive >= MISS) & (hits.primitive < triangles)
    if active is not None:
        rows = np.flatnonzero(known_primitive & claimed)
        known_primitive[rows] = active[hits.primitive[rows]]
    with np.errstate(invalid="ignore", over="ignore"):
        limit = rays.t_max * np.float32(1 + 2.0**-21)
        in_range = np.where(claimed, (hits.t >= 0) & (hits.t <= limit), hits.t == np.inf)
    verdicts.malformed[:] = verdicts.nonfinite | ~known_primitive | ~in_range


def _judge_t(ours: Measure, t: np.ndarray, claims: np.ndarray, verdicts: _Verdicts) -> None:
    """Errors of the claimed t against the planes of the claimed triangles."""
    with np.errstate(all="ignore"):
        residual = ours.residual(t)
        relative = np.abs(t - ours.t) / np.abs(ours.t)
        gross = _gross(residual, residual / ours.aspect) & ~(relative <= T_GROSS_RELATIVE)
    verdicts.relative[claims] = np.where(np.isfinite(relative), relative, np.nan)
    verdicts.t_off[claims] = ~(residual <= T_RESIDUAL_ULP)
    verdicts.t_gross[claims] = gross


def _gross(plain: np.ndarray, conditioned: np.ndarray) -> np.ndarray:
    """bool[m]: distances in local ulp too large to be float32 rounding."""
    return ~(plain <= BAND_ULP) & ~(conditioned <= BAND_CONDITIONED)


def _separation(a: Measure, b: Measure) -> tuple[np.ndarray, np.ndarray]:
    """How far apart two planes' hits on a ray are, in local ulp and by aspect: what rounding must bridge."""
    with np.errstate(all="ignore"):
        apart = np.abs(a.t - b.t) * np.minimum(a.sine, b.sine) / np.maximum(a.ulp, b.ulp)
        return apart, apart / np.maximum(a.aspect, b.aspect)


def _pick(measures: Measure, rows) -> Measure:
    return Measure(**{name: value[rows] for name, value in vars(measures).items()})


def _summary(agreement: Agreement, verdicts: _Verdicts, unsettled: int) -> Agreement:
    """Counts, percentiles and the verdict."""
    counts = np.bincount(verdicts.classes, minlength=len(CLASSES))
    for name, count in zip(CLASSES, counts, strict=True):
        setattr(agreement, name, int(count))
    agreement.reference_wrong, agreement.settled = verdicts.reference_wrong, verdicts.settled
    agreement.nonfinite = int(verdicts.nonfinite.sum())
    agreement.worst_band_ulp = verdicts.worst_band
    errors = verdicts.relative[(verdicts.classes <= T_OFF) & ~np.isnan(verdicts.relative)]
    if len(errors):
        p50, p99, largest = map(float, np.percentile(errors, (50, 99, 100)))
        agreement.t_relative_error = RelativeError(p50=p50, p99=p99, max=largest)
    agreement.reason = "; ".join(_faults(verdicts, unsettled))
    agreement.valid = not agreement.reason
    return agreement


def _faults(verdicts: _Verdicts, unsettled: int) -> list[str]:
    """One phrase for each rule that the run breaks, with the first ray that breaks it."""
    faults = []
    rules = (
        (verdicts.nonfinite, "with a non-finite field"),
        (verdicts.malformed & ~verdicts.nonfinite, "with t, t_max and primitive in contradiction"),
        (verdicts.t_gross, "with t far off the plane"),
        (verdicts.band_gross, "wrong beyond rounding"),
    )
    for broken, what in rules:
        if broken.any():
            faults.append(f"{broken.sum()} rays {what}, first ray {broken.argmax()}")
    bad = verdicts.classes >= WRONG
    if bad.sum() > MOST_DISAGREEING * len(bad):
        faults.append(f"{bad.sum()} of {len(bad)} rays wrong, missed or phantom, first ray {bad.argmax()}")
    if unsettled:
        faults.append(f"{unsettled} more disputes than are settled exactly")
    return faults
