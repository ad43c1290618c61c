"""Families A and D: one ray and one triangle a pair, where float32 loses digits or the input is degenerate."""

from __future__ import annotations

import numpy as np

from harness.data import Rays
from harness.studies.stability.closed_meshes import random_units, unit
from harness.studies.stability.pairs import Pairs

BROKEN = (np.nan, np.inf, -np.inf)


def single_pairs(case: dict, count: int, generator: np.random.Generator) -> Pairs:
    """`count` pairs; a quarter each aimed inside, near an edge, at an edge, and around the triangle.

    `case` has one of: `sliver`, longest edge over height; `shift`, distance from the world's origin; `far`, distance
    of the ray's origin in triangle sizes; `graze`, sine of the angle with the plane; `scale`, exponent of two of all
    coordinates; `length`, exponent of two of the direction's length; `coplanar`, `axis` or `oblique`; `broken`.
    """
    triangles = _triangles(count, generator, case)
    targets = _targets(triangles, generator)
    origins = _origins(triangles, targets, generator, case)
    if "coplanar" in case:
        triangles, origins, targets = _coplanar(count, generator, case["coplanar"] == "axis")
    shift = case.get("shift", 0.0)
    triangles, origins, targets = (values + shift for values in (triangles, origins, targets))
    scale = 2.0 ** case.get("scale", 0)
    triangles, origins = ((values * scale).astype(np.float32) for values in (triangles, origins))
    directions = targets * scale - origins.astype(np.float64)
    if "length" in case:
        x, y, z = directions.T
        directions = directions / np.sqrt(x * x + y * y + z * z)[:, None] * 2.0 ** case["length"]
    directions = directions.astype(np.float32)
    if case.get("broken"):
        _break(triangles, origins, directions, generator)
    limit = np.full(count, np.inf, np.float32)
    number = np.arange(count, dtype=np.int32)
    return Pairs(Rays(origins, directions, limit), triangles, number, number)


def _triangles(count: int, generator, case: dict) -> np.ndarray:
    """float64[count,3,3] near the unit cube's centre, of size about 1 and the case's shape."""
    along = random_units(count, generator)
    across = unit(np.cross(along, random_units(count, generator)))
    height = 1 / case["sliver"] if "sliver" in case else 0.5 + 0.5 * generator.random((count, 1))
    foot = generator.random((count, 1))
    corners = [-0.5 * along, 0.5 * along, (foot - 0.5) * along + height * across]
    turned = np.stack(corners, axis=1)
    turn = generator.integers(3, size=count)[:, None]
    return turned[np.arange(count)[:, None], (np.arange(3) + turn) % 3]


def _targets(triangles: np.ndarray, generator) -> np.ndarray:
    """Points of the triangles' planes: inside, within 2^-3 to 2^-30 of an edge, on an edge, and all around."""
    count = len(triangles)
    u, v = generator.random((2, count))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    kind = np.arange(count) % 4
    tiny = (1 + generator.random(count)) * 2.0 ** -generator.integers(3, 31, count)
    tiny *= generator.choice([-1.0, 1.0], count)
    v = np.where(kind == 1, tiny, np.where(kind == 2, 0.0, v))
    u = np.where((kind == 1) | (kind == 2), generator.random(count), u)
    u, v = (np.where(kind == 3, 3 * w - 1, w)[:, None] for w in (u, v))
    return triangles[:, 0] + u * (triangles[:, 1] - triangles[:, 0]) + v * (triangles[:, 2] - triangles[:, 0])


def _origins(triangles: np.ndarray, targets: np.ndarray, generator, case: dict) -> np.ndarray:
    """Points from which the targets are seen at the case's distance and angle."""
    count = len(triangles)
    distance = case.get("far", 1.0) * (1 + generator.random((count, 1)))
    if "graze" not in case:
        return targets + distance * random_units(count, generator)
    along = unit(triangles[:, 1] - triangles[:, 0])
    normal = unit(np.cross(along, unit(triangles[:, 2] - triangles[:, 0])))
    mixed = 2 * generator.random((count, 2)) - 1
    within = unit(mixed[:, :1] * along + mixed[:, 1:] * np.cross(along, normal) + 1e-9)
    side = generator.choice([-1.0, 1.0], count)[:, None]
    return targets + distance * (within + side * case["graze"] * normal)


def _coplanar(count: int, generator, axis: bool):
    """Rays exactly in the planes of integer triangles: planes z = const, or x + y + z = const."""
    first, second = np.array([[1, 0, 0], [0, 1, 0]] if axis else [[1, -1, 0], [0, 1, -1]])
    base = generator.integers(-8, 9, (count, 1, 3)).astype(np.float64)

    def in_plane(shape):
        steps = generator.integers(-16, 17, (*shape, 2))
        return base + steps[..., :1] * first + steps[..., 1:] * second

    triangles, ends = in_plane((count, 3)), in_plane((count, 2))
    origins, targets = ends[:, 0], ends[:, 1]
    targets = np.where((origins == targets).all(axis=1)[:, None], targets + first, targets)
    return triangles, origins, targets


def _break(triangles, origins, directions, generator) -> None:
    """A NaN or an infinity in one component of the origin, the direction or a vertex, in turn."""
    count = len(origins)
    rows = np.arange(count)
    axis, value = generator.integers(3, size=count), np.float32(BROKEN)[generator.integers(3, size=count)]
    vectors = (origins, directions, triangles[:, 0], triangles[:, 1], triangles[:, 2])
    for number, vector in enumerate(vectors):
        chosen = rows[rows % len(vectors) == number]
        vector[chosen, axis[chosen]] = value[chosen]
