"""Specs of adaptive grids, and scenes that are hard for one: clumps, slivers, walls on the planes of its cells."""

from __future__ import annotations

import numpy as np
from shapes import soup

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
