"""How far hits lie from where they should be."""

from __future__ import annotations

import numpy as np

from harness.data import MISS, Hits, Rays
from harness.reference.exact import measure

_CHUNK = 1 << 18  # hits measured at once


def diagonal_of(triangles: np.ndarray) -> float:
    """Length of the diagonal of the bounds of float32[n,3,3]."""
    corners = triangles.reshape(-1, 3)
    return float(np.linalg.norm(corners.max(axis=0).astype(np.float64) - corners.min(axis=0)))


def distance_rmse(rays: Rays, t: np.ndarray, reference: np.ndarray, diagonal: float) -> float:
    """Root mean square error of the hit distance, over the diagonal.

    `t` float32[n] and `reference` float64[n], inf = miss. Distances end at the diagonal: there lies a miss, and
    whatever is no distance at all.
    """
    speed = np.linalg.norm(rays.directions.astype(np.float64), axis=1)

    def distance(values: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            lengths = values.astype(np.float64) * speed
            return np.where((lengths >= 0) & (lengths < diagonal), lengths, diagonal)

    return float(np.sqrt(np.mean((distance(t) - distance(reference)) ** 2)) / diagonal)


def residual_p99(triangles: np.ndarray, rays: Rays, hits: Hits) -> float | None:
    """99th percentile of the hits' distance from the planes of their triangles, in local ulp; None without a hit."""
    claims = np.flatnonzero((hits.primitive != MISS) & np.isfinite(hits.t))
    found = [np.empty(0)]
    for first in range(0, len(claims), _CHUNK):
        rows = claims[first : first + _CHUNK]
        part = rays[rows]
        ours = measure(triangles[hits.primitive[rows]], part.origins, part.directions, part.t_max)
        found.append(ours.residual(hits.t[rows].astype(np.float64)))
    values = np.concatenate(found)
    values = values[np.isfinite(values)]
    return float(np.percentile(values, 99)) if len(values) else None
