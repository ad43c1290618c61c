"""Small meshes that tests share, each float32[n,3,3]."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from harness.data import Rays
from harness.spec.intersectors import INTERSECTORS

# Tested in every combination; the other intersectors in few, and in all by the slow tests: the default, a plain one,
# one that stores planes, and one in double precision.
REPRESENTATIVE = ("ray-space", "moller-trumbore", "havel-herout", "moller-trumbore-double")


def every_intersector():
    """Names of all intersectors as test parameters; those beside REPRESENTATIVE are slow."""
    slow = pytest.mark.slow
    return [name if name in REPRESENTATIVE else pytest.param(name, marks=slow) for name in INTERSECTORS]


def soup(count: int = 400, seed: int = 5, size: float = 0.3) -> np.ndarray:
    """Random triangles in the unit cube."""
    generator = np.random.default_rng(seed)
    centres = generator.random((count, 1, 3))
    return (centres + size * (generator.random((count, 3, 3)) - 0.5)).astype(np.float32)


def icosphere(divisions: int = 3, radius: float = 1.0, centre=(0.0, 0.0, 0.0)) -> np.ndarray:
    """A closed, nearly round mesh."""
    mesh = trimesh.creation.icosphere(subdivisions=divisions, radius=radius)
    return np.ascontiguousarray(mesh.triangles + np.array(centre), np.float32)


def lattice_walls(cells: int = 8) -> np.ndarray:
    """Axis-parallel squares on the integer planes of a cube, two triangles each: walls on cell planes."""
    quads = []
    for axis in range(3):
        for level in range(cells + 1):
            for a in range(cells):
                corners = np.zeros((4, 3))
                corners[:, axis] = level
                corners[:, (axis + 1) % 3] = [a, a + 1, a + 1, a]
                corners[:, (axis + 2) % 3] = [0, 0, cells, cells]
                quads += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return np.array(quads, np.float32)


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


def random_rays(count: int, seed: int = 11, low=0.0, high=1.0) -> Rays:
    """Origins uniform in a cube, directions normal in each component."""
    generator = np.random.default_rng(seed)
    origins = generator.uniform(low, high, (count, 3)).astype(np.float32)
    directions = generator.normal(size=(count, 3)).astype(np.float32)
    return Rays(origins, directions, np.full(count, np.inf, np.float32), "random", seed)


def aimed_rays(triangles: np.ndarray, origin, count: int, seed: int = 3) -> Rays:
    """Rays from `origin` at random points of random edges: where watertightness is decided."""
    generator = np.random.default_rng(seed)
    chosen = triangles[generator.integers(len(triangles), size=count)].astype(np.float64)
    side = generator.integers(3, size=count)
    a, b = chosen[np.arange(count), side], chosen[np.arange(count), (side + 1) % 3]
    directions = a + generator.random((count, 1)) * (b - a) - np.asarray(origin)
    origins = np.broadcast_to(np.asarray(origin, np.float32), (count, 3)).copy()
    return Rays(origins, directions.astype(np.float32), np.full(count, np.inf, np.float32), "file", seed)


def sampled_cells(triangles: np.ndarray, grid, samples: int = 60) -> set[tuple]:
    """(cell, triangle) pairs that points on the triangles certainly fall into."""
    generator = np.random.default_rng(0)
    u, v = generator.random((2, samples, len(triangles), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    corners = triangles.astype(np.float64)
    points = corners[:, 0] + u * (corners[:, 1] - corners[:, 0]) + v * (corners[:, 2] - corners[:, 0])
    places = np.floor((points - grid.lower.astype(np.float64)) / grid.cell_size.astype(np.float64)).astype(int)
    return {(*place, i) for layer in places for i, place in enumerate(layer.tolist())}
