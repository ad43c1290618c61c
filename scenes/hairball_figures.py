"""What Hairball's description implies for the figures of its calibration, without a triangle being made.

The model: a ball of radius 1 holds as much hair in every shell of equal thickness, as hairs that run from the
centre outwards do, in random directions. Integral geometry (Santaló 1976, "Integral Geometry and Geometric
Probability": Cauchy's and the principal kinematic formula) gives how often hairs and triangles meet cells; a ray is
followed through the hairs as through a fog of their density.
"""

from __future__ import annotations

import numpy as np

SAMPLES = 60_000
STEP = 1 / 400  # of the march through the fog
WALL = 1 + 1 / 128  # half the edge of the grid, its margin included


def described(
    triangles: int, hairs: int, segments: int, length: float, radius: float, resolutions: tuple[int, ...]
) -> dict[str, float]:
    """The figures named as in `harness.studies.stand_ins.likeness.measure`; `length`, `radius`: means of a hair's."""
    random = np.random.Generator(np.random.Philox(1))
    total = hairs * length
    # A triangle has two long edges and a short one, the side of the tube's cross-section of three corners.
    long, short = length / segments, np.sqrt(3) * radius

    def density(r):
        return total / (4 * np.pi * np.maximum(r, 0.01) ** 2)

    hit, path, spots = _rays(random, lambda r: density(r) * np.pi / 2 * radius * (r < 1))
    figures = {"triangles": float(triangles), "rays that hit, share": float(hit.mean())}
    depth = np.cbrt(random.random(SAMPLES))
    for cells in resolutions:
        edge = 2 * WALL / cells
        # A line of density d meets a cell of surface 6 edge^2 on average d * 6 edge^2 / 4 times.
        met = random.poisson(1.5 * density(depth) * edge**2)
        share = np.pi / 6 / WALL**3 * (met > 0).mean()
        perimeter, area = 2 * long + short, long * short / 2
        references = 1 + 0.75 * perimeter / edge + 1.5 * area / edge**2
        mean = references * triangles / (share * cells**3)
        held = met[met > 0] * mean / met[met > 0].mean()
        occupied = 1 - np.exp(-1.5 * density(spots) * edge**2)
        # A path of length s in any direction crosses 1.5 s / edge planes between cells on average.
        planes = 1.5 * STEP / edge
        here = {
            "non-empty cells, share": share,
            "references a triangle": references,
            "triangles a cell, mean": mean,
            "triangles a cell, 95 %": np.percentile(held, 95),
            "triangles a cell, 99 %": np.percentile(held, 99),
            "cells a ray, non-empty": 1 + planes * np.where(spots < 1, occupied, 0).sum() / len(path),
            "cells a ray, all": 1 + 1.5 * path.mean() / edge,
        }
        figures |= {f"{cells}: {name}": float(value) for name, value in here.items()}
    return figures


def _rays(random: np.random.Generator, fog) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Diffuse rays from where primary rays along -z end in a fog: whether they hit, and their length in the grid.

    Also the distance from the centre of every place they are marched through. `fog`: hits per length, of radius.
    """
    count = SAMPLES // 4
    disc = np.sqrt(random.random(count)), 2 * np.pi * random.random(count)
    eye = np.stack([disc[0] * np.cos(disc[1]), disc[0] * np.sin(disc[1]), np.full(count, 1.0)], axis=1)
    ahead = np.broadcast_to([0.0, 0.0, -1.0], eye.shape)
    reached, origin, _, _ = _march(random, eye, ahead, fog)
    origin = origin[reached]
    # The normal is across a hair of random direction, by the share of it that the eye sees, and faces the eye.
    normal = _unit(np.cross(random.normal(size=(20 * len(origin), 3)), random.normal(size=(20 * len(origin), 3))))
    normal = normal[random.random(len(normal)) < np.abs(normal[:, 2])][: len(origin)]
    normal *= np.sign(normal[:, 2:])
    along = _unit(normal + _unit(random.normal(size=normal.shape)))
    hit, _, path, spots = _march(random, origin, along, fog)
    return hit, path, spots


def _march(random: np.random.Generator, origin: np.ndarray, along: np.ndarray, fog) -> tuple:
    """Until a hit or the wall of the grid: whether hit, where, the length, and distances from the centre passed."""
    position, going = origin.copy(), np.ones(len(origin), bool)
    hit, path, spots = np.zeros(len(origin), bool), np.zeros(len(origin)), []
    while going.any():
        position[going] += STEP * along[going]
        path[going] += STEP
        r = np.sqrt((position * position).sum(axis=1))
        spots.append(r[going])
        struck = going & (random.random(len(r)) < 1 - np.exp(-STEP * fog(r)))
        hit |= struck
        going &= ~struck & (np.abs(position).max(axis=1) < WALL)
    return hit, position, path, np.concatenate(spots)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
