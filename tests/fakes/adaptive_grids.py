"""Specs of adaptive grids, and scenes that are hard for one: clumps, slivers, walls on the planes of its cells."""

from __future__ import annotations

import numpy as np
from shapes import soup

from harness import structures
from harness.spec.structure import Adaptive
from harness.structures.device_scene import upload_scene

SPECS = [
    Adaptive(0.3),
    Adaptive(50.0),
    Adaptive(3.0, top=5, leaf=8),
    Adaptive(top=7, leaf=1),
    Adaptive(200.0, top=1, leaf=128),
]


def on_planes(device, spec=SPECS[1], cells=12) -> np.ndarray:
    """Squares that lie exactly on planes between the leaf cells of their own grid."""
    frame = soup(200)
    grid = structures.build(upload_scene(device, frame), spec)
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
