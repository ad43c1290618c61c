"""Embree, the reference tracer: embreex with the rays split over threads."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from harness.data import MISS, Hits, Rays

_PIECE = 1 << 16  # most rays handed to a thread at once, so that threads finish together


class EmbreeScene:
    """Triangles in an Embree BVH.

    `triangles`: float32[n,3,3]. `robust`: Embree's robust mode. `active`: bool[n] or None; triangles that are
    not active are left out, and the others keep their numbers. `build_seconds`: wall time of the build.
    """

    def __init__(self, triangles: np.ndarray, robust: bool = True, active: np.ndarray | None = None):
        self._numbers = None if active is None or active.all() else np.flatnonzero(active).astype(np.int32)
        if self._numbers is not None:
            triangles = triangles[self._numbers]
        self._empty = len(triangles) == 0
        self.robust = robust
        start = time.perf_counter()
        if not self._empty:
            self._scene = rtcore_scene.EmbreeScene(robust=robust)
            self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(triangles, np.float32))
            self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # the first run builds
        self.build_seconds = time.perf_counter() - start

    def trace(self, rays: Rays, threads: int | None = None) -> Hits:
        """First hits with 0 < t <= t_max as Embree sees them; `threads` None means every available core."""
        count = len(rays)
        hits = Hits(
            np.full(count, np.inf, np.float32),
            np.full(count, MISS, np.int32),
            np.zeros(count, np.float32),
            np.zeros(count, np.float32),
        )
        if self._empty or not count:
            return hits
        threads = threads or len(os.sched_getaffinity(0))
        size = max(1, min(_PIECE, -(-count // threads)))
        pieces = [slice(first, min(first + size, count)) for first in range(0, count, size)]
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda piece: self._trace_piece(rays[piece], hits[piece]), pieces))
        return hits

    def _trace_piece(self, rays: Rays, hits: Hits) -> None:
        """Trace in one Embree call and write into `hits`, whose arrays are views."""
        can_hit = rays.t_max > 0  # NaN and negative limits hit nothing
        limit = np.where(can_hit, rays.t_max, 0).astype(np.float32)  # embreex overwrites it with t
        found = self._scene.run(
            np.ascontiguousarray(rays.origins, np.float32),
            np.ascontiguousarray(rays.directions, np.float32),
            limit,
            output=True,
        )
        hit = (found["primID"] != MISS) & can_hit
        hits.t[hit] = found["tfar"][hit]
        hits.u[hit] = found["u"][hit]
        hits.v[hit] = found["v"][hit]
        numbers = found["primID"][hit]
        hits.primitive[hit] = numbers if self._numbers is None else self._numbers[numbers]
