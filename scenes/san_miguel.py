"""San Miguel: a court between two storeys of arcades, with laid tables, potted plants, lanterns and a tree.

Like the original it is clumped: the building is coarse, while chairs, tableware, flowers and leaves are tiny and
very finely tessellated, on places where the original has its own.
"""

from __future__ import annotations

import numpy as np

from harness.data import View
from scenes import Recipe
from scenes.elementary import PI, TURN, between, cos, power, sin, steps
from scenes.plants import branches, cloud, leaf, leaves
from scenes.shapes import (
    box,
    boxes,
    generator,
    grid,
    instances,
    join,
    on_lattice,
    placement,
    quad,
    resampled,
    revolve,
    scatter,
    sphere,
    surface,
    torus,
    tubes,
)

# Published coordinates in metres; built with y up as (x, height, -y), which `stand_in` turns back.
LOWER, UPPER = (-38.0, -0.46, -37.0), (46.8, 14.6, 37.0)
WEST, EAST, NORTH, SOUTH = 6.2, 23.4, 0.0, 13.5  # sides of the open court
BACK_EAST, BACK_NORTH = 27.0, -3.2  # walls behind its arcades
GALLERY, ROOF = 5.0, 10.0  # heights of the upper floor and the roof
BAY = (EAST - WEST) / 5

TABLES = [(x, -1.8) for x in (8.0, 11.2, 14.7, 18.1, 21.5, 24.8)]
TABLES += [(11.2, 2.4), (14.5, 1.8), (17.7, 3.0), (20.8, 3.0), (9.0, 3.8), (12.5, 4.6), (16.1, 5.7), (9.0, 6.9)]
TABLES += [(12.5, 7.5), (18.9, 7.3), (21.4, 6.5), (9.0, 10.1), (21.4, 10.1), (11.5, 11.6), (15.1, 11.7), (18.7, 11.7)]
TABLES += [(x, 0.7) for x in (-19.7, -15.8, -11.3, -7.8)]
PLANTER = (15.1, 3.7)
TREE_LEAVES = 42_000


def placed(points, height: float = 0.0) -> np.ndarray:
    """(x, z) on a floor as float64[k,3]."""
    points = np.asarray(points, np.float64)
    return np.column_stack([points[:, 0], np.full(len(points), height), points[:, 1]])


# ---------------------------------------------------------------- the building, coarse


def column(height: float) -> np.ndarray:
    """A stone column with base and capital, foot at the origin."""
    profile = [(0.3, 0), (0.3, 0.08), (0.22, 0.1), (0.2, 0.13), (0.17, 0.85), (0.21, 0.87), (0.21, 0.89), (0.3, 1)]
    return revolve(np.array(profile) * (1, height), 20)


def arch(span: float, spring: float, top: float) -> np.ndarray:
    """A round arch with the wall above it, along x about the origin."""
    angle = PI * (1 - np.arange(25) / 24)
    inner = np.stack([0.44 * span * cos(angle), spring + 0.44 * span * sin(angle)], axis=1)
    outer = np.stack([span / 2 * np.clip(1.4 * cos(angle), -1, 1), np.full(25, top)], axis=1)
    outer[[0, -1], 1] = spring
    sheets = [(outer, -0.25), (inner, -0.25), (inner, 0.25), (outer, 0.25)]
    return grid(np.stack([np.column_stack([points, np.full(25, z)]) for points, z in sheets]))


def arcade(bays: int) -> np.ndarray:
    """Two storeys of columns and arches along x from the origin, with a balustrade on the upper one."""
    feet = np.column_stack([BAY * np.arange(bays + 1), np.zeros(bays + 1), np.zeros(bays + 1)])
    middle = feet[:-1] + [BAY / 2, 0, 0]
    baluster = revolve(np.array([(0.05, 0), (0.05, 0.1), (0.09, 0.3), (0.04, 0.6), (0.05, 0.8)]), 10)
    step = 0.3 * np.arange(int(bays * BAY / 0.3))
    bars = np.column_stack([step + 0.15, 0 * step + GALLERY + 0.1, 0 * step])
    return join(
        scatter(column(2.7), feet),
        scatter(arch(BAY, 2.7, GALLERY), middle),
        scatter(column(2.6), feet + [0, GALLERY, 0]),
        scatter(arch(BAY, 2.6, ROOF - GALLERY), middle + [0, GALLERY, 0]),
        scatter(baluster, bars),
        box((0, GALLERY + 0.9, -0.12), (bays * BAY, GALLERY + 1.05, 0.12)),
        box((0, GALLERY - 0.1, -0.4), (bays * BAY, GALLERY + 0.1, 0.4)),
    )


def slab(x: tuple, y: float, z: tuple, columns: int = 4) -> np.ndarray:
    """A floor of a few triangles."""
    return quad((x[0], y, z[0]), (0, 0, z[1] - z[0]), (x[1] - x[0], 0, 0), columns, columns)


def wall(start, end, low: float, high: float, parts: int = 4) -> np.ndarray:
    """An upright wall between two points (x, z)."""
    along = (end[0] - start[0], 0, end[1] - start[1])
    return quad((start[0], low, start[1]), along, (0, high - low, 0), parts, parts)


def building(_: np.random.Generator) -> np.ndarray:
    """Court, arcades, walls and roofs, and the plain blocks of the town about them."""
    length = 4 * BAY
    parts = [
        slab((LOWER[0], UPPER[0]), LOWER[1], (LOWER[2], UPPER[2]), 12),
        slab((WEST, BACK_EAST), 0.0, (BACK_NORTH, SOUTH)),
        slab((WEST, BACK_EAST), GALLERY, (BACK_NORTH, NORTH), 2),
        slab((EAST, BACK_EAST), GALLERY, (NORTH, SOUTH), 2),
        slab((WEST, BACK_EAST), ROOF, (BACK_NORTH, NORTH), 2),
        slab((EAST, BACK_EAST), ROOF, (NORTH, SOUTH), 2),
        wall((WEST, BACK_NORTH), (BACK_EAST, BACK_NORTH), -0.4, ROOF + 0.6, 6),
        wall((BACK_EAST, BACK_NORTH), (BACK_EAST, SOUTH), -0.4, ROOF + 0.6, 6),
        wall((WEST, BACK_NORTH), (WEST, SOUTH), -0.4, ROOF + 0.6, 6),
        wall((WEST, SOUTH), (BACK_EAST, SOUTH), -0.4, ROOF + 0.6, 6),
        instances(arcade(5), placement((WEST, 0, NORTH))),
        instances(arcade(4), placement((EAST, 0, NORTH + (SOUTH - length) / 2 + length), yaw=PI / 2)),
    ]
    bell = instances(arch(BAY, 2.0, 4.4), placement((0, ROOF + 0.2, 0)))
    parts.append(scatter(bell, placed([(WEST + BAY * (k + 0.5), BACK_NORTH) for k in range(5)])))
    stones = [(x, z) for x in steps(WEST, EAST - 0.3, 0.9) for z in steps(0.3, SOUTH - 0.6, 0.9)]
    low = placed(stones, -0.05)
    parts.append(boxes(low, low + [0.86, 0.08, 0.86]))
    return join(*parts, town())


def town() -> np.ndarray:
    """Blocks outside the court: a street wall on every side, a hall to the west, and doors in them."""
    x0, x1, z0, z1 = LOWER[0], UPPER[0], LOWER[2], UPPER[2]
    outer = [wall(a, b, LOWER[1], 7.0, 8) for a, b in (((x0, z0), (x1, z0)), ((x0, z1), (x1, z1)))]
    outer += [wall(a, b, LOWER[1], 7.0, 8) for a, b in (((x0, z0), (x0, z1)), ((x1, z0), (x1, z1)))]
    hall = [wall(a, b, LOWER[1], 6.0) for a, b in (((-24, -9), (WEST, -9)), ((-24, 12), (WEST, 12)))]
    hall.append(wall((-24, -9), (-24, 12), LOWER[1], 6.0))
    doors = [box((x, 0, z - 0.1), (x + 1.5, 2.4, z + 0.1)) for x, z in ((-3, -9), (-20, -9), (-12, 12))]
    return join(*outer, *hall, *doors)


# ---------------------------------------------------------------- furniture and tableware, very fine


def chair() -> np.ndarray:
    """A wrought-iron chair of rods and scrolls, looking along -z, feet at the origin's height."""
    t = np.arange(49)[:, None] / 48
    legs = [
        np.concatenate([x + 0.03 * sin(PI * t), (0.95 if z > 0 else 0.46) * t, z + 0.06 * t * (z > 0)], axis=1)
        for x in (-0.2, 0.2)
        for z in (-0.2, 0.2)
    ]
    turn = TURN * 2.5 * t
    scrolls = [
        np.concatenate([x + 0.09 * t * cos(turn + x), 0.72 + 0.12 * t * sin(turn + x), 0.24 + 0 * t], axis=1)
        for x in (-0.11, 0.0, 0.11)
    ]
    dish = surface(
        lambda s, u: (0.22 * u * cos(TURN * s), 0.46 + 0.02 * u * u, 0.22 * u * sin(TURN * s)), 36, 96, False, True
    )
    rail = np.concatenate([0.2 * cos(PI * t), 0.93 + 0.06 * sin(PI * t), 0.26 + 0 * t], axis=1)
    return join(
        tubes(np.stack([*legs, rail]), 0.013, 22),
        tubes(np.stack(scrolls), 0.009, 16),
        dish,
        torus(0.22, 0.015, 72, 12) + [0, 0.46, 0],
    )


def cover() -> np.ndarray:
    """Plate, glass and cutlery of one place at a table, towards +z from its middle."""
    dish = [(0, 0), (0.07, 0.002), (0.085, 0.008), (0.125, 0.018), (0.127, 0.021), (0.085, 0.012), (0, 0.006)]
    wine = [(0.035, 0), (0.034, 0.003), (0.004, 0.01), (0.004, 0.08), (0.03, 0.1), (0.038, 0.14), (0.033, 0.18)]
    wine += [(0.031, 0.18), (0.036, 0.14), (0.028, 0.104), (0, 0.09)]
    t = (np.arange(20) / 19 - 0.5)[:, None] * 0.2
    bow = 0.008 + 100 * t * t * t * t
    cutlery = np.stack([np.concatenate([x + 0 * t, bow, t], axis=1) for x in (-0.16, 0.15, 0.18)])
    return join(
        revolve(resampled(dish, 36), 56),
        revolve(resampled(wine, 52), 44) + [0.16, 0, -0.1],
        tubes(cutlery, 0.006, 8),
    ) + [0, 0, 0.36]


def bouquet(random: np.random.Generator) -> np.ndarray:
    """A small vase of very many small flowers: the densest thing on a table."""
    vase = resampled([(0.03, 0), (0.055, 0.03), (0.05, 0.06), (0.025, 0.1), (0.035, 0.12)], 50)

    def petals(s, u):
        return u * cos(TURN * s), 0.3 * u * sin(5 * TURN * s) + 0.4 * u * u, u * sin(TURN * s)

    flower = surface(petals, 6, 20, wrap_columns=True)
    heads = cloud(random, 115, (0, 0.12, 0), (0.09, 0.06, 0.09), 0.3)
    tilt = between(random, -0.8, 0.8, (2, len(heads)))
    blossoms = instances(flower, placement(heads, 0.014, pitch=tilt[0], roll=tilt[1]))
    green = leaves(random, cloud(random, 300, (0, 0.1, 0), (0.08, 0.05, 0.08)), 0.04)
    return join(revolve(vase, 56), blossoms, green)


def dining(random: np.random.Generator) -> np.ndarray:
    """Round tables, each laid for four, with four chairs."""
    top = revolve(np.array([(0, 0.72), (0.62, 0.72), (0.65, 0.735), (0.62, 0.75), (0, 0.75)]), 96)
    stem = [(0.3, 0), (0.28, 0.03), (0.05, 0.06), (0.04, 0.4), (0.06, 0.7), (0.2, 0.72)]
    turns = PI / 2 * np.arange(4)
    around = np.array([(0, 0, 0.85), (0.85, 0, 0), (0, 0, -0.85), (-0.85, 0, 0)])
    seats = instances(chair(), placement(around, yaw=turns))
    laid = instances(cover(), placement((0, 0.75, 0), yaw=turns + 0.4))
    table = join(top, revolve(resampled(stem, 30), 48), laid, seats, bouquet(random) + [0, 0.75, 0])
    return scatter(table, placed(TABLES), 1.0, between(random, 0, TURN, len(TABLES)))


def lanterns(_: np.random.Generator) -> np.ndarray:
    """Filigree lanterns on chains under the arcade's ceiling."""
    t = np.arange(40) / 39
    angle = TURN * np.arange(36)[:, None] / 36
    radius = 0.16 * power(sin(PI * (0.06 + 0.88 * t)), 0.7)
    height = np.broadcast_to(0.5 * t, (36, 40))
    wires = [
        tubes(np.stack([radius * cos(angle + w * t), height, radius * sin(angle + w * t)], axis=-1), 0.004, 6)
        for w in (1.2, -1.2)
    ]
    body = join(*wires, sphere(0.07, 24, 36, (0, 0.25, 0)))
    number = np.arange(24)
    chain = scatter(torus(0.025, 0.006, 16, 8), np.column_stack([0 * number, 0.55 + 0.05 * number, 0 * number]))
    spots = [(WEST + BAY * (k + 0.5), -1.6) for k in range(5)] + [(25.2, z) for z in (1.5, 5.0, 8.5, 12.0)]
    return scatter(join(body, chain), placed(spots, 3.1))


# ---------------------------------------------------------------- plants


def pot_plants(random: np.random.Generator) -> np.ndarray:
    """Potted plants on the floor and, denser, along the balustrade of the gallery; two are huge."""
    pot = revolve(resampled([(0.16, 0), (0.24, 0.34), (0.27, 0.36), (0.26, 0.41), (0.21, 0.4), (0, 0.36)], 30), 40)
    spots = [(x, 0.05, 0.55) for x in steps(7.0, 23.4, 1.0)] + [(x, 0.05, -2.8) for x in steps(7.0, 26, 1.2)]
    spots += [(x, GALLERY, -0.5) for x in steps(7.0, 23, 0.5)]
    spots += [(EAST + 0.5, GALLERY, z) for z in steps(0.7, 13, 0.7)]
    spots += [(x, 0.05, z) for x in (WEST + 0.5, BACK_EAST - 0.5) for z in steps(1.5, 13, 1.0)]
    spots += [(WEST + 1.5, GALLERY + 0.2, 2.75), (EAST - 0.65, GALLERY + 0.7, -0.5)]
    parts = [scatter(pot, np.array(spots))]
    for number, (x, y, z) in enumerate(spots):
        huge = number >= len(spots) - 2
        count = 32_000 if huge else int(3700 * (0.4 + 1.2 * random.random()))
        where = cloud(random, count, (x, y + 0.75, z), (0.38, 0.42, 0.38), 0.1)
        parts.append(leaves(random, where, 0.05))
    return join(*parts)


def tree(random: np.random.Generator) -> np.ndarray:
    """A planter with a spreading tree: limbs and single leaves in clouds about their ends."""
    foot = np.array([PLANTER[0], 0.4, PLANTER[1]])
    wood, ends = branches(random, foot, 6.0, 11.0, 30, 12)
    clouds = [cloud(random, TREE_LEAVES // 30, end, (1.8, 1.2, 1.8), 0.15) for end in ends]
    crown = [leaves(random, points, 0.13, leaf(2)) for points in clouds]
    basin = [(1.0, 0), (1.05, 0.5), (0.95, 0.55), (0.85, 0.5), (0.85, 0.4), (0, 0.4)]
    return join(revolve(np.array(basin), 64) + (foot - [0, 0.4, 0]), wood, *crown)


def ivy(random: np.random.Generator) -> np.ndarray:
    """Leaves on the south wall and down from the roof's edge."""
    count = 12_000
    along = between(random, WEST, EAST, count)
    hang = random.random(count) * random.random(count) * (3.2 + 1.5 * sin(1.7 * along))
    points = np.column_stack([along, ROOF - 0.2 - hang, SOUTH - 0.05 - 0.15 * random.random(count)])
    return leaves(random, points, 0.12)


def stand_in(seed: int) -> np.ndarray:
    """About 9.4 million triangles, z up in metres: float32[n,3,3]."""
    random = generator(seed)
    turned = []
    for make in (building, lanterns, dining, pot_plants, tree, ivy):
        part = make(random)
        turned.append(on_lattice(np.stack([part[..., 0], -part[..., 2], part[..., 1]], axis=-1), 128.0, 22))
    return join(*turned)


VIEWS = (
    View((6.37319, -5.62511, 1.53861), (7.09618, -4.94254, 1.64532), (0, 0, 1), 84.0, "courtyard"),
    View((27.6255, -2.42353, 1.49616), (26.6582, -2.17012, 1.48803), (0, 0, 1), 84.0, "tables"),
)
RECIPE = Recipe(
    name="san-miguel",
    title="San Miguel",
    triangles=9_388_826,
    files=(
        ("san_miguel_a.npz", "680e30683c3ab3669fd671d426b6de127738f4cb2905f7d01d683cbf186386c0"),
        ("san_miguel_b.npz", "0aec474a6b9137a62c829e92fe0a6f484ace4b54737c104a0e21265dcf365a87"),
    ),
    real_views=VIEWS,
    stand_in_views=VIEWS[:1],
    stand_in=stand_in,
    licence="CC BY 3.0",
    credit="Guillermo M. Leal Llaguno",
    up="z",
    paper=True,
)
