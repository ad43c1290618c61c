"""Exact hits of many ray-triangle pairs at once: filtered in float64, then in 64-bit integers, then in Python's.

Every predicate is a sum of products of float32 differences. Float64 with a proven bound decides nearly all of them;
what is left are mostly rays aimed exactly at edges of meshes on a lattice, whose coordinates are small integers times
a power of two; the rest is decided in integers of any size. Nothing is left undecided.
"""

from __future__ import annotations

import numpy as np

from harness.reference.exact import exact_hit

_BOUND = 2.0**-47  # of an edge function or volume: 42 roundings of 2^-53, rounded up generously
_CHUNK = 1 << 17  # pairs at once, to stay in cache
_DIFFERENCE_BITS, _DIRECTION_BITS = 18, 20  # products of these widths fit 64-bit integers
_UNDECIDED = 2


def exact_pairs(triangles: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """bool[m]: whether ray i hits closed triangle i at some t > 0, exactly.

    `triangles` float32[m,3,3], `origins`, `directions` float32[m,3]. A coplanar ray hits nothing, nor does any ray
    hit a triangle without area or one that is not finite.
    """
    result = np.empty(len(triangles), bool)
    for first in range(0, len(triangles), _CHUNK):
        part = slice(first, first + _CHUNK)
        result[part] = _chunk(triangles[part], origins[part], directions[part])
    return result


def _chunk(triangles, origins, directions) -> np.ndarray:
    verdict = _by_floats(triangles, origins, directions)
    rows = np.flatnonzero(verdict == _UNDECIDED)
    if len(rows):
        verdict[rows] = _by_integers(triangles[rows], origins[rows], directions[rows])
    for row in np.flatnonzero(verdict == _UNDECIDED):
        hit = exact_hit(triangles[row], origins[row], directions[row], np.float32(np.inf))
        verdict[row] = hit is not None
    return verdict == 1


def _by_floats(triangles, origins, directions) -> np.ndarray:
    """int8[m]: 1 a hit, 0 a miss, 2 undecided."""
    with np.errstate(all="ignore"):
        corners = np.ascontiguousarray(triangles.transpose(1, 2, 0), np.float64)
        corners -= np.ascontiguousarray(origins.T, np.float64)
        ray = np.ascontiguousarray(directions.T, np.float64)
        size, speed = np.abs(corners).max(axis=1), np.abs(ray).max(axis=0)
        a, b, c = corners
        edges = [_triple(ray, b, c), _triple(ray, c, a), _triple(ray, a, b)]
        bounds = [_BOUND * speed * size[i] * size[j] for i, j in ((1, 2), (2, 0), (0, 1))]
        signs = [(e > k).astype(np.int8) - (e < -k) for e, k in zip(edges, bounds, strict=True)]
        volume, most = _triple(a, b, c), _BOUND * size[0] * size[1] * size[2]
        depth = (volume > most).astype(np.int8) - (volume < -most)
        least, largest = np.minimum.reduce(signs), np.maximum.reduce(signs)
        sure = np.minimum.reduce([np.abs(s) for s in signs]) == 1
        verdict = np.full(len(triangles), _UNDECIDED, np.int8)
        verdict[(least < 0) & (largest > 0)] = 0  # two edge functions certainly differ in sign
        inside = sure & (least == largest)
        verdict[inside & (depth * largest > 0)] = 1
        verdict[inside & (depth * largest < 0)] = 0
        finite = np.isfinite(corners).all(axis=(0, 1)) & np.isfinite(ray).all(axis=0)
        verdict[~finite] = 0
    return verdict


def _by_integers(triangles, origins, directions) -> np.ndarray:
    """The same in int64, where all coordinates of a pair are small integers times one power of two."""
    points = np.concatenate([triangles.reshape(-1, 9), origins], axis=1).astype(np.float64)
    points, point_bits = _as_integers(points)
    ray, ray_bits = _as_integers(directions.astype(np.float64))
    corners = points[:, :9].reshape(-1, 3, 3) - points[:, None, 9:]
    with np.errstate(over="ignore"):
        small = (point_bits < 52) & (ray_bits <= _DIRECTION_BITS)
        small &= np.abs(corners).max(axis=(1, 2)) < 2.0**_DIFFERENCE_BITS
    whole = np.where(small[:, None, None], corners, 0).astype(np.int64).transpose(1, 2, 0)
    ray = np.where(small[:, None], ray, 0).astype(np.int64).T
    a, b, c = whole
    signs = [np.sign(e) for e in (_triple(ray, b, c), _triple(ray, c, a), _triple(ray, a, b))]
    least, largest = np.minimum.reduce(signs), np.maximum.reduce(signs)
    facing = np.where(largest > 0, 1, np.where(least < 0, -1, 0))  # of the determinant, where no signs differ
    hit = ~((least < 0) & (largest > 0)) & (facing != 0) & (np.sign(_triple(a, b, c)) * facing > 0)
    return np.where(small, hit, _UNDECIDED).astype(np.int8)


def _as_integers(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of float32 values in float64 as integers times a power of two each: the integers, and their bits."""
    mantissa, exponent = np.frexp(values)
    whole = (mantissa * 2.0**24).astype(np.int64)
    lowest = np.where(whole == 0, 1 << 20, exponent - 24 + _trailing_zeros(whole))
    shift = lowest.min(axis=1)
    shift = np.where(shift == 1 << 20, 0, shift)
    scaled = np.ldexp(values, -shift[:, None])
    bits = np.frexp(np.abs(scaled).max(axis=1))[1]
    return scaled, bits


def _trailing_zeros(whole: np.ndarray) -> np.ndarray:
    lowest_bit = whole & -whole
    return np.frexp(lowest_bit.astype(np.float64))[1] - 1


def _triple(a, b, c):
    """a . (b x c) of vectors [3,m]."""
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
