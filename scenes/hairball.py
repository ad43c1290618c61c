"""Hairball: thin curled tubes about a ball, after Samuli Laine's model; only its stand-in exists here.

There is no file of the original to measure, so the stand-in is held against what its description implies: 2.88
million triangles of thin curled tubes that fill a ball. `hairball_figures` works that out for tubes of the size
chosen here.
"""

from __future__ import annotations

import numpy as np

from harness.data import View
from scenes import Recipe
from scenes.elementary import between, directions
from scenes.hairball_figures import described
from scenes.shapes import generator, join, on_lattice, tubes, unit

HAIRS, SEGMENTS, SIDES = 10_000, 48, 3  # 2 * 3 * 48 triangles a hair: 2.88 million
LENGTH, RADIUS, TIP = 1.9, 0.0042, 0.5  # of a hair, in a ball of radius 1; the tip's radius over the root's
SHORTEST = 0.75  # length of the shortest hair over the longest
BENT, CORE = 0.85, 0.2  # radius of the ball where hairs bend back, and about which they begin
CURL = (0.05, 0.35)  # turn of a hair from one segment to the next, least and most, in radians
BATCHES = 20  # hairs are swept in batches, which bounds the memory


def length(vectors: np.ndarray) -> np.ndarray:
    """float64[n,1] of float64[n,3]."""
    return np.sqrt((vectors * vectors).sum(axis=1, keepdims=True))


def curls(random: np.random.Generator, count: int) -> np.ndarray:
    """Paths float64[count, SEGMENTS + 1, 3] from near the centre outwards, inside the unit ball."""
    heading = directions(random, count)
    position = CORE * heading * random.random((count, 1))
    axis = directions(random, count)
    rate = between(random, *CURL, (count, 1))
    step = LENGTH / SEGMENTS * between(random, SHORTEST, 1.0, (count, 1))
    paths = np.empty((count, SEGMENTS + 1, 3))
    paths[:, 0] = position
    for k in range(1, SEGMENTS + 1):
        # Turn about a slowly wandering axis: a curl; near the surface of the ball, bend back along it.
        heading = unit(heading + rate * np.cross(axis, heading))
        axis = unit(axis + 0.25 * directions(random, count))
        radius = length(position)
        outward = position / radius
        escape = np.maximum((heading * outward).sum(axis=1, keepdims=True), 0.0)
        heading = unit(heading - np.clip((radius - BENT) / 0.13, 0.0, 1.0) * escape * outward)
        position = position + step * heading
        position = position / np.maximum(length(position) / 0.995, 1.0)
        paths[:, k] = position
    return paths


def stand_in(seed: int) -> np.ndarray:
    """Ten thousand curled hairs in a ball of radius 1: float32[2880000,3,3]."""
    taper = RADIUS * np.linspace(1.0, TIP, SEGMENTS + 1)
    paths = curls(generator(seed), HAIRS)
    return join(*(on_lattice(tubes(part, taper, SIDES), 2.0, 22) for part in np.array_split(paths, BATCHES)))


def smaller(seed: int, size: float) -> np.ndarray:
    """`size` times the triangles, size one of 1/4, 1/16, 1/64: fewer hairs of fewer segments, as much thicker.

    The ball stays as opaque: hairs times their radius is what a ray meets.
    """
    step = round(size**-0.5)  # half of the reduction in hairs, half in segments
    taper = step * RADIUS * np.linspace(1.0, TIP, SEGMENTS // step + 1)
    paths = curls(generator(seed), HAIRS // step)[:, ::step]
    return join(*(on_lattice(tubes(part, taper, SIDES), 2.0, 22) for part in np.array_split(paths, BATCHES)))


def figures(resolutions: tuple[int, ...]) -> dict[str, float]:
    """What the description implies, for hairs of the mean size here."""
    mean_length, mean_radius = LENGTH * (SHORTEST + 1) / 2, RADIUS * (1 + TIP) / 2
    return described(2 * SIDES * SEGMENTS * HAIRS, HAIRS, SEGMENTS, mean_length, mean_radius, resolutions)


RECIPE = Recipe(
    name="hairball",
    title="Hairball",
    triangles=2 * SIDES * SEGMENTS * HAIRS,
    stand_in_views=(View((0.0, 0.0, 3.2), (0.0, 0.0, 0.0), fov_degrees=38.0, name="front"),),
    stand_in=stand_in,
    smaller=smaller,
    described=figures,
    licence="CC BY 3.0 (the original)",
    credit="Samuli Laine",
    paper=True,
)
