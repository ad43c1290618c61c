"""Crytek Sponza: a long atrium between two storeys of columns and arches, with drapes."""

from __future__ import annotations

import numpy as np

from harness.data import View
from scenes import Recipe
from scenes.plants import cloud, leaves
from scenes.shapes import (
    box,
    boxes,
    generator,
    grid,
    join,
    on_lattice,
    quad,
    revolve,
    scatter,
    surface,
    tubes,
)

LOWER, UPPER = np.array([-1921.0, -126.0, -1183.0]), np.array([1800.0, 1429.0, 1105.0])  # of the real scene
ROW = 420.0  # from the middle to a row of columns
STOREYS = (-126.0, 400.0, 900.0)  # floors, and the eaves
BAYS = np.linspace(-1500, 1400, 11)  # where columns stand along x


def column(height: float, radius: float, rings: int, sides: int) -> np.ndarray:
    """A round column with base and carved capital, foot at the origin."""
    y = np.linspace(0, 1, rings + 1)
    swell = 1.0 + 0.5 * np.exp(-((y / 0.06) ** 2)) + 0.9 * np.clip((y - 0.86) / 0.14, 0, 1) ** 2
    ripple = 0.05 * np.sin(60 * np.pi * y) * (y > 0.84)
    return revolve(np.stack([radius * (swell + ripple), height * y], axis=1), sides)


def arch(span: float, rise: float, depth: float, segments: int) -> np.ndarray:
    """A wall over one bay with a round opening below, from -span/2 to span/2 along x, springing at y = 0."""
    angle = np.linspace(np.pi, 0, segments + 1)
    half = 0.42 * span
    inner = np.stack([half * np.cos(angle), half * np.sin(angle)], axis=1)
    outer = np.stack([span / 2 * np.clip(1.3 * np.cos(angle), -1, 1), np.full(segments + 1, rise)], axis=1)
    outer[[0, -1], 1] = 0
    sheets = [
        np.concatenate([points, np.full((segments + 1, 1), z)], axis=1)
        for points, z in ((outer, -depth), (inner, -depth), (inner, depth), (outer, depth))
    ]
    return grid(np.stack(sheets))


def drape(width: float, height: float, folds: float, columns: int, rows: int) -> np.ndarray:
    """Cloth gathered at its top, hanging from y = 0, across x."""

    def cloth(s, t):
        depth = 0.06 * width * np.sin(2 * np.pi * folds * s + 2 * t) * (0.4 + t)
        return width * (s - 0.5) * (1 - 0.25 * np.sin(np.pi * t)), -height * t, depth

    return surface(cloth, rows, columns)


def lion(size: float, rings: int, sides: int) -> np.ndarray:
    """A relief as dense as a carved head: a shield with a bumpy face."""

    def face(s, t):
        angle, radius = 2 * np.pi * s, size * t
        bumps = 0.25 * np.cos(3 * angle) * np.sin(9 * t) + 0.12 * np.sin(11 * angle) * np.cos(17 * t)
        return size * 0.9 * (1 - t**2) + size * 0.3 * bumps * t, radius * np.sin(angle), radius * np.cos(angle)

    return surface(face, rings, sides, wrap_columns=True)


def shell() -> np.ndarray:
    """Floor, outer walls, galleries and roofs, in few and large triangles."""
    x, z = (LOWER[0], UPPER[0]), (LOWER[2], UPPER[2])
    length, width = x[1] - x[0], z[1] - z[0]
    ground = quad((x[0], LOWER[1], z[0]), (0, 0, width), (length, 0, 0), 12, 20)
    walls = [quad((x[0], LOWER[1], side), (length, 0, 0), (0, UPPER[1] - LOWER[1], 0), 16, 6) for side in z]
    ends = [quad((end, LOWER[1], z[0]), (0, 0, width), (0, UPPER[1] - LOWER[1], 0), 10, 6) for end in x]
    galleries = boxes(
        [(x[0], STOREYS[1] - 20, z[0]), (x[0], STOREYS[1] - 20, ROW)],
        [(x[1], STOREYS[1], -ROW), (x[1], STOREYS[1], z[1])],
    )
    tiles = [
        quad(
            (x[0], STOREYS[2] + 120, side * (ROW - 60)),
            (length, 0, 0),
            (0, UPPER[1] - STOREYS[2] - 120, side * (UPPER[2] - ROW)),
            90,
            24,
        )
        for side in (-1, 1)
    ]
    return join(ground, *walls, *ends, galleries, *tiles)


def colonnades() -> np.ndarray:
    """Columns and arches of both storeys, on both sides."""
    span = BAYS[1] - BAYS[0]
    low, high = STOREYS[1] - STOREYS[0], STOREYS[2] - STOREYS[1]
    places = np.array([(x, 0, side * ROW) for side in (-1, 1) for x in BAYS])
    between = np.array([(x + span / 2, 0, side * ROW) for side in (-1, 1) for x in BAYS[:-1]])
    thin = np.array([(x + part * span / 2, 0, side * ROW) for side in (-1, 1) for x in BAYS[:-1] for part in (0, 1)])
    return join(
        scatter(column(0.62 * low, 42, 44, 28), places + [0, STOREYS[0], 0]),
        scatter(arch(span, 0.38 * low - 20, 40, 40), between + [0, STOREYS[0] + 0.62 * low, 0]),
        scatter(column(0.6 * high, 24, 26, 16), thin + [0, STOREYS[1], 0]),
        scatter(arch(span / 2, 0.4 * high + 120, 25, 24), thin + [span / 4, STOREYS[1] + 0.6 * high, 0]),
    )


def furnishing(random: np.random.Generator) -> np.ndarray:
    """Drapes, vases with plants, balustrades, lanterns on chains and two lion heads."""
    span = BAYS[1] - BAYS[0]
    bays = np.array([(x + span / 2, 0, side * (ROW - 50)) for side in (-1, 1) for x in BAYS[1:-2]])
    cloth = scatter(drape(0.8 * span, 400, 5, 44, 40), bays + [0, STOREYS[2] - 40, 0])
    urn = np.array([(0, 0), (30, 0), (22, 12), (55, 60), (66, 100), (46, 140), (60, 156), (52, 158), (40, 138)])
    steps = np.interp(np.linspace(0, 8, 41), np.arange(9), np.arange(9))
    profile = np.stack([np.interp(steps, np.arange(9), urn[:, axis]) for axis in (0, 1)], axis=1)
    feet = np.array([(x, STOREYS[0], side * 180) for side in (-1, 1) for x in (-1100, -350, 350, 1100)], float)
    vases = scatter(revolve(profile, 40), feet)
    plants = [leaves(random, cloud(random, 420, foot + [0, 215, 0], (75, 85, 75)), 26) for foot in feet]
    posts = np.array([(x, STOREYS[1], side * ROW) for side in (-1, 1) for x in np.arange(-1480, 1390, 52)], float)
    balusters = scatter(column(70, 7, 8, 8), posts)
    rails = boxes(
        [(-1500, STOREYS[1] + 70, s * ROW - 12) for s in (-1, 1)],
        [(1400, STOREYS[1] + 82, s * ROW + 12) for s in (-1, 1)],
    )
    lanterns = np.array([(x, STOREYS[2] - 300, 0) for x in BAYS[1:-1:2]], float)
    chains = tubes(np.stack([lanterns + [0, 40 * k, 0] for k in range(9)], axis=1), 4, 6)
    heads = join(
        lion(150, 70, 110) + [LOWER[0] + 20, 300, 0], lion(150, 70, 110) * [-1, 1, 1] + [UPPER[0] - 20, 300, 0]
    )
    lamps = scatter(lion(40, 24, 32), lanterns)
    plinths = join(*(box(foot - [70, 0, 70], foot + [70, 8, 70]) for foot in feet))
    return join(cloth, vases, *plants, balusters, rails, chains, heads, lamps, plinths)


def stand_in(seed: int) -> np.ndarray:
    """About 279,000 triangles in the real scene's bounds: float32[n,3,3]."""
    triangles = join(shell(), colonnades(), furnishing(generator(seed)))
    return on_lattice(np.clip(triangles, LOWER, UPPER), 4096.0)


RECIPE = Recipe(
    name="sponza",
    title="Sponza",
    triangles=279_163,
    files=(("sponza.npz", "edc6ab861383bdefa2a2dffbfa335f557449ae1ab25aa3da0640d2db2239d0ed"),),
    real_views=(View((-1150.0, 260.0, -40.0), (900.0, 330.0, -40.0), fov_degrees=65.0, name="atrium"),),
    stand_in_views=(View((-1250.0, 260.0, -60.0), (900.0, 330.0, 0.0), fov_degrees=65.0, name="atrium"),),
    stand_in=stand_in,
    licence="CC BY 3.0",
    credit="Frank Meinl, Crytek, 2010, after Marko Dabrovic",
    paper=True,
)
