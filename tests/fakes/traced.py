"""Scenes with rays that decide something, put on a device and traced."""

from __future__ import annotations

import dataclasses

import numpy as np
from shapes import aimed_rays, icosphere, lattice_walls, random_rays, soup

from harness import tracers
from harness.data import Rays, Scene
from harness.device.stopwatch import Stopwatch
from harness.spec.intersectors import INTERSECTORS
from harness.spec.structure import GridSpec
from harness.structures import build_grid
from harness.tracers.prepared import Prepared

GRID_TRACERS = ("deferred", "streamed", "forward", "work-optimal")


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


def setting_of(device, triangles, spec=GridSpec(4, 32)) -> Prepared:
    """A scene on the device with its grid."""
    setting = Prepared.on_device(Scene("test", triangles), device)
    return dataclasses.replace(setting, grid=build_grid(setting.device_scene, spec))


def hits_of(setting, rays, tracer, intersector="ray-space", **options):
    """First hits by one variant."""
    made = tracers.find(tracer)(setting, INTERSECTORS[intersector], options)
    return made.trace(rays, Stopwatch(setting.device.queue))
