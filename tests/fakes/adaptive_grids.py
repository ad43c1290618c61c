"""Specs of adaptive grids, and scenes that are hard for one: clumps, slivers, walls on the planes of its cells."""

from __future__ import annotations

import numpy as np
from shapes import aimed_rays, random_rays, soup
from traced import SCENES

from harness.spec.structure import GridSpec
from harness.structures import build_grid
from harness.structures.base import upload_scene

SPECS = [
    GridSpec(0, 16, "adaptive", 0.3),
    GridSpec(0, 16, "adaptive", 50.0),
    GridSpec(5, 8, "adaptive", 3.0),
    GridSpec(7, 1, "adaptive"),
    GridSpec(1, 128, "adaptive", 200.0),
]


def clumps(count: int = 600) -> np.ndarray:
    """Small triangles in few places of a large box: mostly empty space, and two densities."""
    generator = np.random.default_rng(8)
    centres = generator.random((5, 3)) * 20
    mesh = soup(count, size=0.2) * np.float32(0.4) + centres[generator.integers(5, size=count), None]
    return np.concatenate([mesh, soup(40, seed=2, size=0.01) * np.float32(0.02) + centres[0]]).astype(np.float32)


def slivers(count: int = 300) -> np.ndarray:
    """Triangles as long as the scene and thin as a few ulp of it."""
    generator = np.random.default_rng(9)
    start, end = generator.random((2, count, 3))
    near = start + generator.normal(size=(count, 3)) * 10.0 ** generator.uniform(-7, -3, (count, 1))
    return np.stack([start, end, near], axis=1).astype(np.float32)


def on_planes(device, spec=SPECS[1], cells=12) -> np.ndarray:
    """Squares that lie exactly on planes between the leaf cells of their own grid."""
    frame = soup(200)
    grid = build_grid(upload_scene(device, frame), spec)
    size = grid.cell_size * 2 ** (grid.shape[3] - 1)
    generator, quads = np.random.default_rng(3), []
    for axis in np.repeat(np.arange(3), cells):
        corners = np.empty((4, 3), np.float32)
        corners[:, axis] = grid.lower[axis] + size[axis] * np.float32(generator.integers(1, 4))
        low, high = np.sort(generator.random((2, 2)) * 0.8 + 0.1, axis=0)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        corners[:, a], corners[:, b] = [low[0], high[0], high[0], low[0]], [low[1], low[1], high[1], high[1]]
        quads += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return np.concatenate([frame, np.array(quads, np.float32)])


MESHES = {
    **SCENES,
    "clumps": (clumps(), aimed_rays(clumps(), (10.1, 9.7, 11.3), 3000)),
    "slivers": (slivers(), aimed_rays(slivers(), (0.52, 0.47, 0.55), 3000)),
    "afar": (clumps(), aimed_rays(clumps(), (-140.0, 95.0, 60.0), 3000)),
    "displaced": (soup() + np.float32(900), random_rays(3000, low=900.0, high=901.0)),
}
