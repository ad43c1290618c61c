"""Hairball: thin curled tubes about a ball, after Samuli Laine's model; only its stand-in exists here."""

from __future__ import annotations

import numpy as np

from harness.data import View
from scenes import Recipe
from scenes.shapes import generator, join, on_lattice, tubes, unit

HAIRS, SEGMENTS, SIDES = 10_000, 48, 3  # 2 * 3 * 48 triangles a hair: 2.88 million
LENGTH, RADIUS = 1.9, 0.0022  # of a hair, in a ball of radius 1
BATCHES = 20  # hairs are swept in batches, which bounds the memory


def directions(random: np.random.Generator, count: int) -> np.ndarray:
    """Uniform directions float64[count,3]."""
    return unit(random.normal(size=(count, 3)))


def curls(random: np.random.Generator, count: int) -> np.ndarray:
    """Paths float64[count, SEGMENTS + 1, 3] from near the centre outwards, inside the unit ball."""
    heading = directions(random, count)
    position = 0.08 * heading * random.random((count, 1))
    axis = directions(random, count)
    rate = random.uniform(0.02, 0.3, (count, 1))
    step = LENGTH / SEGMENTS * random.uniform(0.75, 1.0, (count, 1))
    paths = np.empty((count, SEGMENTS + 1, 3))
    paths[:, 0] = position
    for k in range(1, SEGMENTS + 1):
        # Turn about a slowly wandering axis: a curl; near the surface of the ball, bend back along it.
        heading = unit(heading + rate * np.cross(axis, heading))
        axis = unit(axis + 0.25 * directions(random, count))
        radius = np.linalg.norm(position, axis=1, keepdims=True)
        outward = position / radius
        escape = np.maximum((heading * outward).sum(axis=1, keepdims=True), 0.0)
        heading = unit(heading - np.clip((radius - 0.85) / 0.13, 0.0, 1.0) * escape * outward)
        position = position + step * heading
        position = position / np.maximum(np.linalg.norm(position, axis=1, keepdims=True) / 0.995, 1.0)
        paths[:, k] = position
    return paths


def stand_in(seed: int) -> np.ndarray:
    """Ten thousand curled hairs in a ball of radius 1: float32[2880000,3,3]."""
    taper = RADIUS * np.linspace(1.0, 0.45, SEGMENTS + 1)
    paths = curls(generator(seed), HAIRS)
    return join(*(on_lattice(tubes(part, taper, SIDES), 2.0, 22) for part in np.array_split(paths, BATCHES)))


def smaller(seed: int, size: float) -> np.ndarray:
    """`size` times the triangles, size one of 1/4, 1/16, 1/64: fewer hairs of fewer segments, as much thicker.

    The ball stays as opaque: hairs times their radius is what a ray meets.
    """
    step = round(size**-0.5)  # half of the reduction in hairs, half in segments
    taper = step * RADIUS * np.linspace(1.0, 0.45, SEGMENTS // step + 1)
    paths = curls(generator(seed), HAIRS // step)[:, ::step]
    return join(*(on_lattice(tubes(part, taper, SIDES), 2.0, 22) for part in np.array_split(paths, BATCHES)))


RECIPE = Recipe(
    name="hairball",
    title="Hairball",
    triangles=2 * SIDES * SEGMENTS * HAIRS,
    stand_in_views=(View((0.0, 0.0, 3.2), (0.0, 0.0, 0.0), fov_degrees=38.0, name="front"),),
    stand_in=stand_in,
    smaller=smaller,
    licence="CC BY 3.0 (the original)",
    credit="Samuli Laine",
    paper=True,
)
