"""Imperial crown: a jewelled crown of dense small geometry on a wide ground."""

from __future__ import annotations

import numpy as np

from harness.data import View
from scenes import Recipe
from scenes.elementary import PI, TURN, between, cos, power, sin
from scenes.shapes import (
    extrude,
    fan,
    generator,
    grid,
    instances,
    join,
    on_lattice,
    placement,
    proper,
    revolve,
    scatter,
    sphere,
    surface,
    torus,
    tubes,
)

RADIUS = 6.3  # of the band
FOOT, CROSS = 0.4, 18.7  # height of the band's lower rim, of the tip of the cross
GROUND = -0.6
ARCHES = 8


def arch_path(count: int) -> np.ndarray:
    """From the band's rim, bulging outwards, up and in to the orb: (radius, height) float64[count,2]."""
    t = np.linspace(0, 1, count)
    radius = RADIUS * (1 + 0.16 * sin(PI * t)) * np.sqrt(np.clip(1 - power(t, 3.2), 0, 1))
    height = FOOT + 3.6 + 9.4 * sin(PI / 2 * t) - 1.1 * power(t, 6)
    return np.stack([radius, height], axis=1)


def around(points: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """(radius, height, sideways) float64[m,3] turned about y by each of float64[k]: float64[k,m,3]."""
    c, s = cos(angles)[:, None], sin(angles)[:, None]
    radius, height, side = points.T
    return np.stack([radius * c - side * s, height + 0 * c, radius * s + side * c], axis=-1)


def pearl(rings: int = 24, sides: int = 34) -> np.ndarray:
    """A finely tessellated unit sphere."""
    return sphere(1.0, rings, sides)


def pearls() -> np.ndarray:
    """Strings of pearls along the rims and both sides of every arch."""
    rims = []
    for height, count, size in ((FOOT, 120, 0.145), (FOOT + 3.3, 120, 0.145)):
        angle = TURN * np.arange(count) / count
        rims += [
            (x, height, z, size) for x, z in zip(RADIUS * 1.02 * cos(angle), RADIUS * 1.02 * sin(angle), strict=True)
        ]
    count = len(rims)
    path = arch_path(36)[:-2]
    for side in (-0.62, 0.62):
        along = around(
            np.column_stack([path * [1.03, 1], np.full(len(path), side)]), TURN * np.arange(ARCHES) / ARCHES
        )
        rims += [(*point, 0.16) for point in along.reshape(-1, 3)]
    placed = np.array(rims)
    fine, coarse = placed[:count], placed[count:]
    return join(scatter(pearl(34, 48), fine[:, :3], fine[:, 3]), scatter(pearl(14, 20), coarse[:, :3], coarse[:, 3]))


def gem(facets: int, table: float = 0.55) -> np.ndarray:
    """A cut stone of radius 1 looking along y."""
    angle = TURN * np.arange(facets) / facets
    ring = lambda r, y, turn=0.0: np.stack(  # noqa: E731
        [r * cos(angle + turn), np.full(facets, y), r * sin(angle + turn)], axis=1
    )
    rings = np.stack([ring(table, 0.45), ring(0.85, 0.25, PI / facets), ring(1.0, 0.0), ring(0.55, -0.5)])
    return join(grid(rings, wrap_columns=True), fan(rings[0]))


def settings() -> np.ndarray:
    """Stones in claw settings about the band and up the arches."""
    claws = join(
        *(
            tubes(
                np.array(
                    [
                        [cos(a), -0.3, sin(a)],
                        [1.05 * cos(a), 0.2, 1.05 * sin(a)],
                        [0.8 * cos(a), 0.42, 0.8 * sin(a)],
                    ]
                ),
                0.08,
                10,
            )
            for a in TURN * np.arange(6) / 6
        )
    )
    mount = join(gem(24), claws, torus(1.05, 0.13, 48, 14))
    placed = []
    for row, (height, count, size) in enumerate(
        ((FOOT + 1.65, 16, 0.75), (FOOT + 0.75, 48, 0.22), (FOOT + 2.6, 48, 0.22))
    ):
        angle = TURN * (np.arange(count) + 0.5 * (row > 0)) / count
        out = np.stack([RADIUS * 1.04 * cos(angle), np.full(count, height), RADIUS * 1.04 * sin(angle)], axis=1)
        placed.append(instances(mount, placement(out, size, yaw=PI / 2 - angle, pitch=PI / 2)))
    path = arch_path(22)[2:-3]
    for a in TURN * np.arange(ARCHES) / ARCHES:
        out = around(np.column_stack([path * [1.05, 1.01], np.zeros(len(path))]), np.array([a]))[0]
        tilt = np.linspace(PI / 2, 0.1, len(path))
        placed.append(instances(mount, placement(out, 0.27, yaw=PI / 2 - a, pitch=tilt)))
    return join(*placed)


def filigree(random: np.random.Generator, count: int) -> np.ndarray:
    """Spirals of fine wire on the band and the arches."""
    t = np.linspace(0, 1, 70)
    turns = np.where(random.random(count) < 0.5, -1.0, 1.0) * between(random, 1.5, 3.0, count)
    size = between(random, 0.12, 0.34, count)
    spin = TURN * turns[:, None] * t + between(random, 0, TURN, (count, 1))
    side, up = (size[:, None] * (0.08 + t) * trig(spin) for trig in (cos, sin))
    on_arch = np.arange(count) % 5 < 2  # the band is the densest part
    path = arch_path(400)
    rows = path[random.integers(10, 220, count)]
    height = np.where(on_arch, rows[:, 1], between(random, FOOT + 0.4, FOOT + 2.9, count))[:, None] + up
    radius = np.where(on_arch, 1.02 * rows[:, 0], 1.03 * RADIUS)[:, None] + 0.03 * sin(9 * spin)
    arch = TURN * random.integers(0, ARCHES, count) / ARCHES
    where = np.where(on_arch, arch + between(random, -0.4, 0.4, count) / rows[:, 0], between(random, 0, TURN, count))
    turn = where[:, None] + side / radius
    return tubes(np.stack([radius * cos(turn), height, radius * sin(turn)], axis=-1), 0.022, 7)


def metal() -> np.ndarray:
    """The band, its rims, the arches' plates and eight fleurons on the rim."""
    band = revolve(np.array([(RADIUS, FOOT), (1.02 * RADIUS, FOOT + 1.6), (RADIUS, FOOT + 3.3)]), 400)
    rims = [torus(RADIUS * 1.01, 0.16, 600, 16) + [0, y, 0] for y in (FOOT, FOOT + 3.3)]
    path = arch_path(120)
    plates = []
    for a in TURN * np.arange(ARCHES) / ARCHES:
        across = [around(np.column_stack([path, np.full(len(path), s)]), np.array([a]))[0] for s in (-0.5, 0, 0.5)]
        plates.append(grid(np.stack(across)))
    t = np.linspace(0, TURN, 72, endpoint=False)
    petal = np.stack(
        [0.9 * sin(t) * (1 + 0.55 * cos(3 * t)), 1.3 - 1.3 * cos(t) * (1 + 0.2 * cos(2 * t)), 0 * t],
        axis=1,
    )
    fleuron = join(
        fan(petal) + [0, 0, 0.12],
        fan(petal[::-1]),
        extrude(petal, (0, 0, 0.12)),
        scatter(pearl(16, 22), [[0, 3.1, 0.06]], 0.3),
        scatter(pearl(20, 30), petal[::3] * [0.8, 0.8, 1] + [0, 0.26, 0.14], 0.12),
        instances(gem(24), placement((0, 1.1, 0.15), 0.4, pitch=PI / 2)),
    )
    angle = TURN * (np.arange(ARCHES) + 0.5) / ARCHES
    places = np.stack([RADIUS * cos(angle), np.full(ARCHES, FOOT + 3.3), RADIUS * sin(angle)], axis=1)
    return join(band, *rims, *plates, instances(fleuron, placement(places, 1.0, yaw=PI / 2 - angle)))


def top() -> np.ndarray:
    """The orb with its bands, and a cross set with pearls."""
    orb = sphere(0.95, 60, 110) + [0, 13.4, 0]
    bands = join(
        torus(0.96, 0.08, 160, 12) + [0, 13.4, 0],
        instances(torus(0.96, 0.08, 160, 12), placement((0, 13.4, 0), pitch=PI / 2)),
    )
    upright = np.stack([np.zeros(11), np.linspace(14.4, CROSS - 0.25, 11), np.zeros(11)], axis=1)
    arm = np.stack([np.linspace(-1.5, 1.5, 9), np.full(9, 16.6), np.zeros(9)], axis=1)
    return join(orb, bands, scatter(pearl(), np.concatenate([upright, arm]), 0.24))


def cloth() -> np.ndarray:
    """The quilted velvet cap inside the arches."""

    def cap(s, t):
        angle, rise = TURN * s, PI / 2 * t
        puff = 1 + 0.05 * np.abs(sin(4 * angle)) * sin(2 * rise) + 0.004 * sin(150 * angle) * sin(90 * rise)
        radius = 0.93 * RADIUS * puff * cos(rise)
        return radius * cos(angle), FOOT + 3.0 + 7.6 * sin(rise), radius * sin(angle)

    return proper(surface(cap, 120, 480, wrap_columns=True))


def ground() -> np.ndarray:
    """A cushion's top under the crown that falls away to a wide floor."""

    def height(s, t):
        x, z = -38.1 + 76.2 * s, -37.2 + 76.3 * t
        away = np.sqrt(x * x + z * z)
        return x, GROUND - 5.3 * np.clip((away - 7.5) / 6, 0, 1), z

    return surface(height, 64, 64)


def stand_in(seed: int) -> np.ndarray:
    """About 3.5 million triangles, the crown in the middle of a wide ground: float32[n,3,3]."""
    parts = (ground(), metal(), pearls(), settings(), filigree(generator(seed), 1680), top(), cloth())
    return join(*(on_lattice(part, 64.0, 22) for part in parts))


RECIPE = Recipe(
    name="crown",
    title="Crown",
    triangles=3_532_946,
    files=(("crown.npz", "eb7bb2e9086c1475fff85aba523260809739818ce68751f8adfd076aa439fb6b"),),
    real_views=(View((0.0, 5.5, 24.0), (0.0, 11.0, -10.0), fov_degrees=47.0, name="front"),),
    stand_in_views=(View((0.0, 5.5, 24.0), (0.0, 11.0, -10.0), fov_degrees=47.0, name="front"),),
    stand_in=stand_in,
    licence="see the author",
    credit="Martin Lubich",
    paper=True,
)
