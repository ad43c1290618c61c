"""Scenes with rays that decide something, put on a device and traced."""

from __future__ import annotations

import functools

import numpy as np
from shapes import aimed_rays, clumps, icosphere, lattice_walls, random_rays, slivers, soup

from harness import tracers
from harness.data import Hits, Rays, Scene
from harness.device.stopwatch import Stopwatch
from harness.spec.intersectors import INTERSECTORS
from harness.spec.structure import Uniform
from harness.tracers.prepared import Prepared

GRID_TRACERS = [name for name in tracers.names() if tracers.find(name).needs_structure]


def lattice_rays(count: int = 600) -> Rays:
    """Rays between integer points: along edges of `lattice_walls`, through its corners, within its planes."""
    origins = np.random.default_rng(1).integers(0, 9, (count, 3)).astype(np.float32)
    directions = np.random.default_rng(2).integers(-1, 2, (count, 3)).astype(np.float32) + np.float32([0.0, 0.0, 3.0])
    return Rays(origins, directions, np.full(count, np.inf, np.float32))


SCENES = {
    "soup": (soup(), random_rays(3000)),
    "sphere": (icosphere(), aimed_rays(icosphere(), (0.1, 0.05, -0.2), 3000)),
    "walls": (lattice_walls(), aimed_rays(lattice_walls(), (3.3, 4.1, 4.6), 3000)),
    "lattice": (lattice_walls(), lattice_rays()),
}


# Also those that are hard for a grid that follows the scene.
MESHES = {
    **SCENES,
    "clumps": (clumps(), aimed_rays(clumps(), (10.1, 9.7, 11.3), 3000)),
    "slivers": (slivers(), aimed_rays(slivers(), (0.52, 0.47, 0.55), 3000)),
    "afar": (clumps(), aimed_rays(clumps(), (-140.0, 95.0, 60.0), 3000)),
    "displaced": (soup() + np.float32(900), random_rays(3000, low=900.0, high=901.0)),
}


def setting_of(device, triangles, spec=Uniform(4, 32)) -> Prepared:
    """A scene on the device with its grid."""
    prepared = Prepared.on_device(Scene("test", triangles), device)
    return prepared.with_structure(spec)


@functools.cache
def shared_scene_in(device, name: str, spec=Uniform(4, 32)) -> Prepared:
    """Scene `name` of MESHES on the device with its grid, made once for all tests, which must not change it."""
    return setting_of(device, MESHES[name][0], spec)


def hits_of(prepared, rays, tracer, intersector="ray-space", **options):
    """First hits by one variant."""
    made = tracers.find(tracer)(prepared, INTERSECTORS[intersector], options)
    return made.trace(rays, Stopwatch(prepared.device.queue))


@functools.cache
def brute_hits(device, name: str, intersector="ray-space", **options) -> Hits:
    """Brute force's hits of the rays of scene `name`, traced once for all tests, which cannot change them."""
    hits = hits_of(shared_scene_in(device, name), MESHES[name][1], "brute", intersector, **options)
    for array in (hits.t, hits.primitive, hits.u, hits.v):
        array.flags.writeable = False
    return hits
