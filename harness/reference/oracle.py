"""The exact oracle: first hits of float32 rays and triangles without any rounding.

Blocks of neighbouring triangles are culled by a conservative float64 slab test, their triangles by a float64
sign test with a proven bound, and what is left is decided in integers (`exact.py` beside this). It shares nothing
with the grid it judges.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from harness.data import MISS
from harness.reference.exact import exact_hit, may_hit

_BLOCK = 32  # triangles in a block
_GROUP = 64  # blocks in a group
_CHUNK = 1 << 18  # triangles gathered at once while building or scanning
_BATCH = (32, 512)  # blocks tested before the first look at the nearest hit, and at most at once later
_SLAB_ERROR = 2.0**-50  # a slab distance takes 3 roundings of 2^-53


@dataclass(frozen=True)
class Truth:
    """The exact first hit of a ray: `t_exact` (None: a miss), `primitives` that tie at it, ascending."""

    t_exact: Fraction | None = None
    primitives: tuple[int, ...] = ()

    @property
    def t(self) -> float:
        """t rounded to float64; inf for a miss."""
        return np.inf if self.t_exact is None else float(self.t_exact)

    @property
    def primitive(self) -> int:
        """The lowest primitive of the tie, -1 for a miss."""
        return self.primitives[0] if self.primitives else MISS


def truth_of(hits: list[tuple[Fraction, int]]) -> Truth:
    """The first of some exact hits `(t, primitive)` of one ray."""
    if not hits:
        return Truth()
    first = min(t for t, _ in hits)
    return Truth(first, tuple(sorted(primitive for t, primitive in hits if t == first)))


def first_hit(triangles, active, origin, direction, t_max) -> Truth:
    """Exact first hit of one ray among all triangles, without acceleration.

    `triangles` float32[n,3,3], `active` bool[n] or None, `origin`, `direction` float32[3], `t_max` float32.
    """
    hits = []
    if not _can_hit(origin, direction, t_max):
        return Truth()
    for first in range(0, len(triangles), _CHUNK):
        rows = np.arange(first, min(first + _CHUNK, len(triangles)))
        if active is not None:
            rows = rows[active[rows]]
        hits += _exact_hits(triangles, rows, origin, direction, t_max)
    return truth_of(hits)


def _can_hit(origin, direction, t_max) -> bool:
    """Whether the ray is finite, has a direction and a positive range."""
    finite = np.isfinite(origin).all() and np.isfinite(direction).all()
    return bool(finite and np.any(direction) and t_max > 0)


def _exact_hits(triangles, rows, origin, direction, t_max) -> list[tuple[Fraction, int]]:
    """Exact `(t, primitive)` of every triangle in `rows` that the ray hits."""
    with np.errstate(invalid="ignore"):
        rows = rows[may_hit(triangles[rows], origin, direction)]
    found = ((exact_hit(triangles[row], origin, direction, t_max), int(row)) for row in rows)
    return [(t, row) for t, row in found if t is not None]


class Oracle:
    """Exact hits of many rays against one mesh: `triangles` float32[n,3,3], `active` bool[n] or None.

    Inactive triangles and those with a non-finite vertex are never hit. Memory: 4 bytes a triangle and 24 a
    block, beside the triangles themselves, which are not copied.
    """

    def __init__(self, triangles: np.ndarray, active: np.ndarray | None = None):
        self.triangles = triangles
        self._order = _spatial_order(triangles, active)
        starts = np.arange(0, len(self._order), _BLOCK)
        self._lower = np.empty((3, len(starts)), np.float32)
        self._upper = np.empty((3, len(starts)), np.float32)
        step = _CHUNK // _BLOCK
        for first in range(0, len(starts), step):
            rows = self._order[first * _BLOCK : (first + step) * _BLOCK]
            part = triangles[rows]
            cuts = np.arange(0, len(rows), _BLOCK)
            blocks = slice(first, first + step)
            self._lower[:, blocks] = np.minimum.reduceat(part.min(axis=1), cuts).T
            self._upper[:, blocks] = np.maximum.reduceat(part.max(axis=1), cuts).T
        groups = np.arange(0, len(starts), _GROUP)
        if len(groups):
            self._group_lower = np.minimum.reduceat(self._lower, groups, axis=1)
            self._group_upper = np.maximum.reduceat(self._upper, groups, axis=1)

    def first_hit(self, origin, direction, t_max) -> Truth:
        """Exact first hit with 0 < t <= t_max; `origin`, `direction` float32[3], `t_max` float32."""
        hits, limit = [], float(t_max)
        for blocks, near in self._batches(origin, direction, t_max):
            if near > limit:
                break
            hits += self._hits_in(blocks, origin, direction, t_max)
            if hits:
                limit = float(min(t for t, _ in hits)) * (1 + _SLAB_ERROR)
        return truth_of(hits)

    def all_hits(self, origin, direction, t_max) -> list[tuple[Fraction, int]]:
        """Every exact hit `(t, primitive)` with 0 < t <= t_max, ascending."""
        hits = []
        for blocks, _ in self._batches(origin, direction, t_max):
            hits += self._hits_in(blocks, origin, direction, t_max)
        return sorted(hits)

    def _batches(self, origin, direction, t_max):
        """Yield (blocks, lower bound of t in them and in all that follow), nearest first."""
        if not len(self._order) or not _can_hit(origin, direction, t_max):
            return
        groups, _ = _slab(self._group_lower, self._group_upper, origin, direction, t_max)
        blocks = (groups[:, None] * _GROUP + np.arange(_GROUP)).ravel()
        blocks = blocks[blocks < self._lower.shape[1]]
        kept, near = _slab(self._lower[:, blocks], self._upper[:, blocks], origin, direction, t_max)
        order = np.argsort(near)
        blocks, near = blocks[kept[order]], near[order]
        first, size = 0, _BATCH[0]
        while first < len(blocks):
            yield blocks[first : first + size], near[first]
            first, size = first + size, min(2 * size, _BATCH[1])

    def _hits_in(self, blocks, origin, direction, t_max) -> list[tuple[Fraction, int]]:
        places = (blocks[:, None] * _BLOCK + np.arange(_BLOCK)).ravel()
        rows = self._order[places[places < len(self._order)]]
        return _exact_hits(self.triangles, rows, origin, direction, t_max)


def _slab(lower, upper, origin, direction, t_max) -> tuple[np.ndarray, np.ndarray]:
    """Boxes float32[3,m] that the ray may touch: their indices, and a lower bound of t in each."""
    near = np.zeros(lower.shape[1])
    far = np.full(lower.shape[1], float(t_max))
    touched = np.ones(lower.shape[1], bool)
    for axis in range(3):
        start, slope = float(origin[axis]), float(direction[axis])
        if slope == 0:
            touched &= (lower[axis] <= start) & (upper[axis] >= start)
            continue
        enter, leave = (lower, upper) if slope > 0 else (upper, lower)
        enter = (enter[axis].astype(np.float64) - start) / slope
        leave = (leave[axis].astype(np.float64) - start) / slope
        np.maximum(near, enter - np.abs(enter) * _SLAB_ERROR, out=near)
        np.minimum(far, leave + np.abs(leave) * _SLAB_ERROR, out=far)
    kept = np.flatnonzero(touched & (near <= far))
    return kept, near[kept]


def _spatial_order(triangles, active) -> np.ndarray:
    """int32: the active finite triangles along a Morton curve of their centres, 10 bits an axis."""
    keep = np.ones(len(triangles), bool) if active is None else np.array(active, bool)
    for first in range(0, len(triangles), _CHUNK):
        keep[first : first + _CHUNK] &= np.isfinite(triangles[first : first + _CHUNK]).all(axis=(1, 2))
    order = np.flatnonzero(keep).astype(np.int32)
    if not len(order):
        return order
    centres = np.empty((len(order), 3), np.float32)
    for first in range(0, len(order), _CHUNK):
        part = triangles[order[first : first + _CHUNK]]
        centres[first : first + _CHUNK] = part.min(axis=1) / 2 + part.max(axis=1) / 2  # no overflow
    lower = centres.min(axis=0)
    extent = np.maximum(centres.max(axis=0).astype(np.float64) - lower, np.finfo(np.float32).tiny)
    keys = np.zeros(len(order), np.uint32)
    for axis in range(3):
        cells = (centres[:, axis].astype(np.float64) - lower[axis]) * (1023 / extent[axis])
        keys |= _spread(cells.astype(np.uint32)) << np.uint32(axis)
    return order[np.argsort(keys, kind="stable")]


def _spread(cells: np.ndarray) -> np.ndarray:
    """Insert two zero bits after each of the 10 low bits of a uint32 array."""
    for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
        cells = (cells | (cells << np.uint32(shift))) & np.uint32(mask)
    return cells
