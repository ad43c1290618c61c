"""Leaves and branches: what trees, ivy and potted plants of the stand-ins are made of."""

from __future__ import annotations

import numpy as np

from scenes.elementary import PI, TURN, between, cos, directions, power, sin
from scenes.shapes import grid, join, tubes, unit

_CHUNK = 1 << 17  # leaves placed at once, which bounds the memory


def leaf(segments: int = 2) -> np.ndarray:
    """A bent, pointed leaf along x from the origin, length 1: float64[4*segments,3,3]."""
    along = np.linspace(0, 1, segments + 1)
    width = 0.32 * power(sin(PI * np.clip(along, 0.04, 0.98)), 0.8)
    bend = -0.25 * along**2
    rows = [np.stack([along, bend + 0.12 * abs(side) * width, side * width], axis=1) for side in (-1, 0, 1)]
    return grid(np.stack(rows))


def leaves(random: np.random.Generator, centres: np.ndarray, size: float, template=None, droop=0.3) -> np.ndarray:
    """A leaf at each of float[k,3] centres, turned at random: float32[k*m,3,3]. `size`: mean length."""
    template = leaf() if template is None else template
    parts = []
    for first in range(0, len(centres), _CHUNK):
        middle = centres[first : first + _CHUNK]
        tip = unit(directions(random, len(middle)) - [0, droop, 0])
        side = unit(np.cross(tip, directions(random, len(middle))))
        turn = np.stack([tip, np.cross(side, tip), side], axis=1)
        turn *= (size * between(random, 0.6, 1.4, len(middle)))[:, None, None]
        corners = sum(template.reshape(-1, 3)[:, a, None] * turn[:, None, a] for a in range(3)) + middle[:, None]
        parts.append(corners.reshape(-1, 3, 3).astype(np.float32))
    return join(*parts)


def cloud(random: np.random.Generator, count: int, centre, radii, hollow: float = 0.5) -> np.ndarray:
    """Points float64[count,3] in an ellipsoid, denser towards its hull."""
    shell = hollow + (1 - hollow) * np.sqrt(random.random((count, 1)))
    return np.asarray(centre) + directions(random, count) * shell * np.asarray(radii)


def branches(random: np.random.Generator, foot, spread: float, height: float, count: int, sides=10) -> tuple:
    """A trunk and `count` limbs: triangles float64[n,3,3], and the limbs' ends float64[count,3]."""
    foot = np.asarray(foot, np.float64)
    part = np.linspace(0, 1, 25)[:, None]
    fork = foot + [0, 0.35 * height, 0]
    trunk = foot + (1.06 * part - 0.06) * (fork - foot) + 0.03 * height * sin(5 * part) * [1, 0, 0.6]
    angle = TURN * (np.arange(count) + random.random(count)) / count
    reach = spread * between(random, 0.35, 0.9, count)
    rise = height * between(random, 0.65, 1.0, count)
    ends = foot + np.stack([reach * cos(angle), rise, reach * sin(angle)], axis=1)
    bow = part * (1 - part) * spread * 0.3
    limbs = (
        fork
        + part * (ends[:, None] - fork)
        - bow * np.stack([cos(angle), -0.5 + 0 * angle, sin(angle)], axis=1)[:, None]
    )
    thick = 0.035 * height
    wood = join(
        tubes(trunk, thick * np.linspace(1.2, 0.8, 25), sides), tubes(limbs, thick * np.linspace(0.6, 0.1, 25), sides)
    )
    return wood, ends
