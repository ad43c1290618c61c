"""San Miguel: a courtyard with arcades, trees of single leaves, tables and tableware."""

from __future__ import annotations

import numpy as np

from harness.data import View
from scenes import Recipe
from scenes.plants import branches, cloud, leaf, leaves
from scenes.shapes import (
    boxes,
    generator,
    grid,
    instances,
    join,
    on_lattice,
    placement,
    quad,
    revolve,
    scatter,
    sphere,
    surface,
    torus,
    tubes,
)

# Built with y up in metres, the courtyard about the origin; `stand_in` turns z up and moves it.
HALF = (22.0, 10.0)  # half the court's length and width
EAVES = 5.4
TREES = np.array([(-9.0, 0.0, 1.5), (8.5, 0.0, -2.0)])
MIDDLE = np.array([9.0, 0.0, 5.0])  # of the court, in the published coordinates
LEAVES_OF_A_TREE = 320_000


def column() -> np.ndarray:
    """A turned stone column, 3.2 m high, foot at the origin."""
    y = np.linspace(0, 1, 57)
    shape = 0.19 + 0.09 * np.exp(-((y / 0.05) ** 2)) + 0.12 * np.clip((y - 0.88) / 0.12, 0, 1) ** 1.5
    return revolve(np.stack([shape + 0.012 * np.sin(70 * y) * (y > 0.85), 3.2 * y], axis=1), 44)


def arch(span: float) -> np.ndarray:
    """A round arch with its wall up to the eaves, along x about the origin, springing at 3.2 m."""
    angle = np.linspace(np.pi, 0, 49)
    inner = np.stack([0.44 * span * np.cos(angle), 3.2 + 0.44 * span * np.sin(angle)], axis=1)
    outer = np.stack([span / 2 * np.clip(1.4 * np.cos(angle), -1, 1), np.full(49, EAVES)], axis=1)
    outer[[0, -1], 1] = 3.2
    sheets = [
        np.column_stack([points, np.full(49, z)])
        for points, z in ((outer, -0.25), (inner, -0.25), (inner, 0.25), (outer, 0.25))
    ]
    return grid(np.stack(sheets))


def sides() -> list[tuple[np.ndarray, float, float]]:
    """The four sides of the court: the middle of each, its length, and the turn about y that faces it."""
    x, z = HALF
    return [
        (np.array([0, 0, -z]), 2 * x, 0.0),
        (np.array([0, 0, z]), 2 * x, np.pi),
        (np.array([-x, 0, 0]), 2 * z, np.pi / 2),
        (np.array([x, 0, 0]), 2 * z, -np.pi / 2),
    ]


def building(random: np.random.Generator) -> np.ndarray:
    """Arcades on four sides, walls behind them, tiled roofs, the ground, and paving stones."""
    parts = [quad((-46, -0.15, -36), (0, 0, 72), (84, 0, 0), 10, 10)]
    tile = surface(lambda s, t: (0.11 * np.cos(np.pi * s), 0.07 * np.sin(np.pi * s), 0.5 * t), 3, 8)
    for middle, length, turn in sides():
        bays = round(length / 3.1)
        span = length / bays
        along = (np.arange(bays + 1) - bays / 2) * span
        row = scatter(column(), np.column_stack([along, 0 * along, 0 * along]))
        arches = scatter(arch(span), np.column_stack([along[:-1] + span / 2, 0 * along[1:], 0 * along[1:]]))
        wall = quad((-length / 2 - 4, -0.15, -4.2), (length + 8, 0, 0), (0, 8.5, 0), 12, 4)
        u, v = np.meshgrid(np.arange(-length / 2 - 3.5, length / 2 + 3.5, 0.24), np.arange(11))
        places = np.stack([u, EAVES + 0.1 + 0.16 * v, 0.3 - 0.45 * v], axis=-1).reshape(-1, 3)
        roof = scatter(tile, places + random.normal(0, 0.008, places.shape))
        parts.append(instances(join(row, arches, wall, roof), placement(middle, yaw=turn)))
    x, z = np.meshgrid(np.arange(-HALF[0], HALF[0], 0.62), np.arange(-HALF[1], HALF[1], 0.62))
    low = np.stack([x, np.full_like(x, -0.1), z], axis=-1).reshape(-1, 3)
    high = low + np.column_stack(
        [np.full(len(low), 0.6), 0.1 + random.uniform(0, 0.02, len(low)), np.full(len(low), 0.6)]
    )
    return join(*parts, boxes(low, high))


def fountain() -> np.ndarray:
    """Three basins over each other."""
    profile = np.array(
        [
            (1.9, 0),
            (2.1, 0.5),
            (1.9, 0.6),
            (1.8, 0.15),
            (0.4, 0.2),
            (0.25, 0.9),
            (0.9, 1.2),
            (1.0, 1.4),
            (0.9, 1.35),
            (0.2, 1.25),
            (0.15, 1.8),
            (0.45, 2.0),
            (0.5, 2.12),
            (0.1, 2.05),
            (0.0, 2.4),
        ]
    )
    steps = np.linspace(0, len(profile) - 1, 197)
    fine = np.stack([np.interp(steps, np.arange(len(profile)), profile[:, axis]) for axis in (0, 1)], axis=1)
    return revolve(fine, 190)


def chair() -> np.ndarray:
    """A wrought-iron chair: rods and scrolls."""
    t = np.linspace(0, 1, 26)[:, None]
    rods = [
        np.concatenate([x + 0 * t, (0.95 if z < 0 else 0.46) * t, z - 0.06 * t * (z < 0)], axis=1)
        for x in (-0.2, 0.2)
        for z in (-0.2, 0.2)
    ]
    spiral = 2 * np.pi * 2 * t
    scrolls = [
        np.concatenate([x + 0.08 * t * np.cos(spiral), 0.72 + 0.08 * t * np.sin(spiral), -0.24 + 0 * t], axis=1)
        for x in (-0.11, 0.0, 0.11)
    ]
    seat = surface(
        lambda s, u: (0.22 * u * np.cos(2 * np.pi * s), 0.46 + 0.02 * u**2, 0.22 * u * np.sin(2 * np.pi * s)),
        12,
        40,
        wrap_columns=True,
    )
    return join(
        tubes(np.stack(rods), 0.014, 10),
        tubes(np.stack(scrolls), 0.01, 8),
        seat,
        torus(0.22, 0.016, 60, 10) + [0, 0.46, 0],
    )


def setting() -> np.ndarray:
    """Plate, glass and cutlery of one place, towards +z from the origin."""
    dish = np.array(
        [(0, 0), (0.07, 0.002), (0.085, 0.008), (0.125, 0.018), (0.127, 0.021), (0.085, 0.012), (0, 0.006)]
    )
    wine = np.array(
        [
            (0.035, 0),
            (0.034, 0.003),
            (0.004, 0.01),
            (0.004, 0.08),
            (0.03, 0.1),
            (0.038, 0.14),
            (0.033, 0.18),
            (0.031, 0.18),
            (0.036, 0.14),
            (0.028, 0.104),
            (0, 0.09),
        ]
    )
    smooth = lambda p, n: np.stack(  # noqa: E731
        [np.interp(np.linspace(0, len(p) - 1, n), np.arange(len(p)), p[:, axis]) for axis in (0, 1)], axis=1
    )
    t = np.linspace(-0.1, 0.1, 20)[:, None]
    blades = [np.concatenate([x + 0 * t, 0.008 + 0.01 * (10 * t) ** 4, t], axis=1) for x in (-0.16, 0.15, 0.18)]
    return join(
        revolve(smooth(dish, 40), 64),
        revolve(smooth(wine, 60), 48) + [0.16, 0, -0.14],
        tubes(np.stack(blades), 0.006, 8),
    ) + [0, 0, 0.34]


def dining(random: np.random.Generator) -> np.ndarray:
    """Round tables, each laid for four and with four chairs."""
    top = revolve(np.array([(0, 0.72), (0.62, 0.72), (0.65, 0.735), (0.62, 0.75), (0, 0.75)]), 96)
    stem = revolve(np.array([(0.3, 0), (0.28, 0.03), (0.05, 0.06), (0.04, 0.4), (0.06, 0.7), (0.2, 0.72)]), 40)
    turns = np.arange(4) * np.pi / 2
    places = instances(setting(), placement((0, 0.75, 0), yaw=turns))
    around = np.stack([0.85 * np.sin(turns), 0 * turns, 0.85 * np.cos(turns)], axis=1)
    chairs = instances(chair(), placement(around, yaw=turns + np.pi))
    vase = join(
        revolve(np.array([(0.05, 0.75), (0.07, 0.85), (0.03, 0.95), (0.04, 1.0)]), 40),
        leaves(random, cloud(random, 120, (0, 1.08, 0), (0.1, 0.1, 0.1)), 0.06),
    )
    table = join(top, stem, places, chairs, vase)
    x, z = np.meshgrid(np.arange(-19, 20, 4.6), (-7.2, 6.8))
    middle = np.stack([x, 0 * x, z], axis=-1).reshape(-1, 3) + random.normal(0, 0.35, (x.size, 3)) * [1, 0, 1]
    return scatter(table, middle, 1.0, random.uniform(0, 2 * np.pi, len(middle)))


def pots(random: np.random.Generator) -> np.ndarray:
    """Potted plants along the arcades."""
    pot = revolve(np.array([(0.2, 0), (0.3, 0.4), (0.34, 0.42), (0.33, 0.48), (0.27, 0.46), (0, 0.4)]), 48)
    x = np.concatenate([np.arange(-20, 21, 4.0)] * 2)
    feet = np.column_stack([x, 0 * x, np.repeat([-9.2, 9.2], len(x) // 2)])
    bushes = [leaves(random, cloud(random, 5200, foot + [0, 0.95, 0], (0.55, 0.6, 0.55), 0.2), 0.09) for foot in feet]
    return join(scatter(pot, feet), *bushes)


def tree(random: np.random.Generator, foot: np.ndarray) -> np.ndarray:
    """A spreading tree: limbs, twigs and leaves of eight triangles in clouds about their ends."""
    wood, ends = branches(random, foot, 8.0, 10.5, 46, 16)
    each = LEAVES_OF_A_TREE // len(ends)
    crown = [leaves(random, cloud(random, each, end, (1.9, 1.2, 1.9), 0.15), 0.13, leaf(2)) for end in ends]
    twigs = [cloud(random, 40, end, (1.8, 1.1, 1.8)) for end in ends]
    lines = [
        np.stack([np.broadcast_to(end, tips.shape), (2 * end + tips) / 3 + 0.1, tips], axis=1)
        for end, tips in zip(ends, twigs, strict=True)
    ]
    return join(on_lattice(wood, 128.0, 22), on_lattice(tubes(np.concatenate(lines), 0.015, 5), 128.0, 22), *crown)


def ivy(random: np.random.Generator) -> np.ndarray:
    """Leaves on the walls and down from the eaves."""
    parts = []
    for middle, length, turn in sides()[:3]:
        count = int(1300 * length)
        s = random.uniform(-0.5, 0.5, count) * length
        hang = random.random(count) ** 2 * (1.2 + 0.8 * np.sin(1.7 * s) + 0.5 * np.sin(4.1 * s))
        points = np.column_stack([s, EAVES - 0.1 - hang, 0.3 + 0.15 * random.random(count)])
        parts.append(leaves(random, instances(points[:, None].repeat(3, 1), placement(middle, yaw=turn))[:, 0], 0.1))
    return join(*parts)


def lights() -> np.ndarray:
    """Lanterns under the arches."""
    x = np.arange(-20, 21, 3.1)
    places = np.column_stack([np.tile(x, 2), np.full(2 * len(x), 2.9), np.repeat([-8.4, 8.4], len(x))])
    return scatter(join(sphere(0.16, 40, 64), torus(0.17, 0.02, 64, 12)), places)


def stand_in(seed: int) -> np.ndarray:
    """About 9.4 million triangles, z up in metres: float32[n,3,3]."""
    random = generator(seed)
    parts = [building(random), fountain() + [0.0, 0, 0], dining(random), pots(random), ivy(random), lights()]
    parts += [tree(random, foot) for foot in TREES]
    turned = []
    while parts:
        part = parts.pop(0) + MIDDLE.astype(np.float32)
        turned.append(on_lattice(np.stack([part[..., 0], -part[..., 2], part[..., 1]], axis=-1), 128.0, 22))
    return join(*turned)


RECIPE = Recipe(
    name="san-miguel",
    title="San Miguel",
    triangles=9_388_826,
    files=(
        ("san_miguel_a.npz", "680e30683c3ab3669fd671d426b6de127738f4cb2905f7d01d683cbf186386c0"),
        ("san_miguel_b.npz", "0aec474a6b9137a62c829e92fe0a6f484ace4b54737c104a0e21265dcf365a87"),
    ),
    real_views=(
        View((6.37319, -5.62511, 1.53861), (7.09618, -4.94254, 1.64532), (0, 0, 1), 84.0, "courtyard"),
        View((27.6255, -2.42353, 1.49616), (26.6582, -2.17012, 1.48803), (0, 0, 1), 84.0, "tables"),
    ),
    stand_in_views=(View((-9.5, -11.5, 2.6), (9.0, -3.0, 2.2), (0, 0, 1), 62.0, "courtyard"),),
    stand_in=stand_in,
    licence="CC BY 3.0",
    credit="Guillermo M. Leal Llaguno",
    up="z",
    paper=True,
)
