"""Crytek Sponza: a long atrium between two storeys of columns and arches, with drapes."""

from __future__ import annotations

import numpy as np

from harness.data import View
from scenes import Recipe, shapes
from scenes.elementary import PI, TURN, cos, exp, power, sin

_LOWER, _UPPER = (-1921.0, -126.0, -1183.0), (1800.0, 1429.0, 1105.0)
_MIDDLE = -40.0  # z of the atrium's axis, about which both sides mirror each other
_NAVE, _AISLE, _FAR = 270.0, 620.0, 1110.0  # from the axis to the columns, the aisle's wall, the side rooms' end
_BAY, _BAYS, _START = 240.0, 10, -1200.0  # lower arches along x, and where they start
_LENGTH = _BAY * _BAYS
_SPRING, _FLOOR, _LOFT, _TOP = 310.0, 512.0, 730.0, 1010.0  # lower arches, upper floor, upper arches, roof


def stand_in(seed: int) -> np.ndarray:
    """About 280,000 triangles float32[n,3,3]: shell, arcades, drapes, reliefs, vases and plants."""
    random = shapes.generator(seed)
    sides = []
    for sign in (1.0, -1.0):
        side = shapes.join(_arcade(), _gallery(), _walls(), _drapes(random), _swags(random), _pots(random))
        sides.append(side * (1, 1, sign) + (0, 0, _MIDDLE))
    ends = [_end(x, turn, random) for x, turn in ((-1560.0, 0.0), (1560.0, PI))]
    return shapes.on_lattice(shapes.join(_shell(), *ends, *sides), 4096.0)


def _shell() -> np.ndarray:
    """The outer box and the floor as few big triangles, with borders of stones along the floor."""
    (x0, _, z0), (x1, _, z1) = _LOWER, _UPPER
    floor = shapes.quad((x0, 0, z0), (0, 0, z1 - z0), (x1 - x0, 0, 0), 2, 2)
    stone = shapes.box((0, 0, 0), (30, 6, 12))
    x = _START - 160 + 30 * np.arange(92)
    rows = [np.column_stack([x, np.zeros(92), np.full(92, z)]) for z in (_MIDDLE - 210, _MIDDLE + 198)]
    return shapes.join(shapes.box(_LOWER, _UPPER), floor, shapes.scatter(stone, np.concatenate(rows)))


# ---------------------------------------------------------------- arcades of one side


def _column(height: float, radius: float, rings: int, sides: int) -> np.ndarray:
    """A column on its base with a capital, from y = 0 to `height`."""
    shaft = 0.10 + 0.74 * np.linspace(0, 1, rings)
    profile = [(1.45, 0), (1.45, 0.03), (1.2, 0.035), (1.35, 0.05), (1.35, 0.065), (1.1, 0.075), (1.2, 0.09)]
    profile += [(1 - 0.15 * (y - 0.1) * (y - 0.1), y) for y in shaft]
    profile += [(1.05, 0.85), (0.95, 0.86), (0.95, 0.88), (1.1, 0.92), (1.4, 0.96), (1.5, 0.965)]
    turned = shapes.revolve(np.array(profile) * (radius, height), sides)
    half = 1.6 * radius
    plate = shapes.box((-half, 0.965 * height, -half), (half, height, half))
    return shapes.join(turned, _leaves(height, radius), plate)


def _leaves(height: float, radius: float) -> np.ndarray:
    """Eight curled leaves about the capital."""

    def leaf(s, t):
        across = (s - 0.5) * 0.6 * radius * np.sqrt(sin(PI * (0.15 + 0.85 * t)))
        out = radius * (0.98 + 0.55 * t * t * t - 0.12 * cos(4 * PI * s))
        return across, height * (0.86 + 0.1 * t - 0.05 * power(t, 6)), out

    return shapes.scatter(shapes.surface(leaf, 6, 4), np.zeros((8, 3)), 1.0, np.arange(8) * PI / 4)


def _arch(width: float, spring: float, top: float, depth: float, steps: int) -> np.ndarray:
    """A round arch about z = 0 with a moulded rim and the wall above it up to `top`; x from 0 to `width`."""
    angle = PI * np.linspace(0, 1, steps + 1)
    along = np.stack([-cos(angle), sin(angle)], axis=1)
    radius, half = 0.42 * width, depth / 2

    def ring(grow, z):
        points = (radius + grow) * along + (width / 2, spring)
        return np.column_stack([points, np.full(steps + 1, z)])

    section = ((0, -half), (0, half), (6, half + 6), (14, half + 8), (20, half + 3), (26, half + 5), (26, half))
    rim = shapes.grid(np.stack([ring(*point) for point in section], axis=1))
    back = shapes.grid(np.stack([ring(0, -half), ring(26, -half - 6)], axis=1))
    walls = []
    for z in (-half, half):
        edge = ring(0, z)
        above = np.column_stack([np.linspace(0, width, steps + 1), np.full(steps + 1, top), edge[:, 2]])
        walls.append(shapes.grid(np.stack([edge, above])))
        for x, w in ((0, width / 2 - radius), (width, radius - width / 2)):
            walls.append(shapes.quad((x, spring, z), (w, 0, 0), (0, top - spring, 0)))
    return shapes.join(rim, back, *walls)


def _arcade() -> np.ndarray:
    """Lower columns and arches, every fourth column a square pier, and the ledge above them."""
    x = _START + _BAY * np.arange(_BAYS + 1)
    offsets = np.column_stack([x, np.zeros_like(x), np.full_like(x, _NAVE)])
    square = np.arange(len(x)) % 4 == 0
    head = 0.93 * _SPRING
    pier = shapes.boxes(
        [(-48, 0, -48), (-60, head, -60), (-58, 0, -58)], [(48, head, 48), (60, _SPRING, 60), (58, 22, 58)]
    )
    section = [[0, 470, 235], [0, 480, 222], [0, 492, 222], [0, 500, 210], [0, 512, 210], [0, 512, 320]]
    return shapes.join(
        shapes.scatter(_column(_SPRING, 36.0, 9, 28), offsets[~square]),
        shapes.scatter(pier, offsets[square]),
        shapes.scatter(_arch(_BAY, _SPRING, _FLOOR - 42, 70.0, 28), offsets[:-1]),
        shapes.extrude(np.array(section) + (_START, 0, 0), (_LENGTH, 0, 0), closed=False),
    )


def _gallery() -> np.ndarray:
    """The upper storey: twice as many slender columns, their arches, a rail, beams and the eaves."""
    x = _START + _BAY / 2 * np.arange(2 * _BAYS + 1)
    offsets = np.column_stack([x, np.full_like(x, _FLOOR), np.full_like(x, _NAVE)])
    columns = shapes.scatter(_column(_LOFT - _FLOOR, 19.0, 6, 16), offsets)
    arches = shapes.scatter(_arch(_BAY / 2, _LOFT, 860.0, 44.0, 18), offsets[:-1] * (1, 0, 1))
    eaves = [[0, 860, 292], [0, 860, 240], [0, 880, 225], [0, 892, 225], [0, 905, 205], [0, 925, 205]]
    roof = np.array([*eaves, [0, _TOP, _AISLE]]) + (_START, 0, 0)
    beam = shapes.box((0, 845, 250), (14, 866, _AISLE))
    beams = shapes.scatter(beam, np.column_stack([_START + 60.0 * np.arange(41), np.zeros(41), np.zeros(41)]))
    rail = shapes.box((_START, 556, 246), (_START + _LENGTH, 566, 258))
    return shapes.join(columns, arches, shapes.extrude(roof, (_LENGTH, 0, 0), closed=False), rail, beams)


def _walls() -> np.ndarray:
    """The aisle's wall with doors, the floor of the gallery, the vaults under it, and rooms behind the wall."""

    def vault(s, t):
        rise = 120 * np.sqrt(np.maximum(sin(PI * s), sin(PI * t)))
        return _BAY * s, 340 + rise, _NAVE + 30 + (_AISLE - _NAVE - 30) * t

    starts = np.column_stack([_START + _BAY * np.arange(_BAYS), np.zeros(_BAYS), np.zeros(_BAYS)])
    room = shapes.quad((0, 0, _AISLE), (0, 0, _FAR - _AISLE), (0, _TOP, 0))
    return shapes.join(
        shapes.quad((_START, 500, _NAVE), (0, 0, _FAR - _NAVE), (_LENGTH, 0, 0)),
        shapes.quad((_START, 0, _AISLE), (_LENGTH, 0, 0), (0, _TOP, 0), _BAYS, 2),
        shapes.quad((_START - 300, _TOP, _AISLE), (0, 120, _FAR - _AISLE), (_LENGTH + 600, 0, 0)),
        shapes.quad((_START, 250, _AISLE), (0, 0, _FAR - _AISLE), (_LENGTH, 0, 0)),
        shapes.quad((_START, 760, _AISLE), (0, 0, _FAR - _AISLE), (_LENGTH, 0, 0)),
        shapes.scatter(room, starts),
        shapes.scatter(shapes.surface(vault, 10, 10), starts),
        shapes.scatter(_arch(_BAY, 220.0, 400.0, 24.0, 20) + (0, 0, _AISLE - 16), starts),
    )


# ---------------------------------------------------------------- cloth


def _drapes(random: np.random.Generator) -> np.ndarray:
    """Curtains in the lower arches: folds that hang from rings on a rod, drawn to one side."""
    ring = shapes.instances(shapes.torus(6.0, 1.2, 10, 5), shapes.placement(roll=1.5))
    parts = []
    for bay in range(_BAYS):
        a = random.random(8)
        x0, drawn, folds = _START + _BAY * bay + 40, 0.15 * a[0], 6 + int(4 * a[1])

        def cloth(s, t, a=a, x0=x0, drawn=drawn, folds=folds):
            wave = sin(TURN * (folds * s + a[2])) + 0.35 * sin(TURN * (2.3 * folds * s + a[3] + t))
            sway = 10 * sin(PI * t) * sin(TURN * (s + a[4]))
            x = x0 + 160 * (s * (1 - drawn * sin(PI * t)) + 0.02 * wave * (1 - t))
            return x, 12 + 258 * t, _NAVE + 12 + (11 - 5 * t) * wave + sway

        rod = shapes.tubes(np.array([[x0 - 10, 272, _NAVE + 12], [x0 + 170, 272, _NAVE + 12]]), 3.0, 10)
        hung = x0 + 160 * (np.arange(folds) + 0.5) / folds
        rings = shapes.scatter(ring, np.column_stack([hung, np.full(folds, 270), np.full(folds, _NAVE + 12)]))
        parts += [shapes.surface(cloth, 18, 60), rod, rings]
    return shapes.join(*parts)


def _swags(random: np.random.Generator) -> np.ndarray:
    """Cloth slung from the upper floor over every other arch."""
    parts = []
    for bay in range(0, _BAYS, 2):
        a = random.random(6)
        x0 = _START + _BAY * (bay + 0.55)

        def cloth(s, t, a=a, x0=x0):
            sag = (0.3 + 0.7 * (1 - (2 * s - 1) ** 2)) * t
            fold = sin(TURN * (4 * t + a[0])) * sin(PI * s)
            crease = sin(TURN * (5 * s + a[1])) * exp(-4 * t)
            out = 24 + (16 + 8 * a[2]) * sin(PI * t) * sin(PI * s) + 6 * fold * t + 5 * crease
            return x0 + 216 * s, 540 - 230 * sag, 212 - out

        parts.append(shapes.surface(cloth, 30, 40))
    return shapes.join(*parts)


# ---------------------------------------------------------------- dense objects


def _vase() -> np.ndarray:
    lower = [(0, 0), (17, 0), (17, 5), (8, 9), (6, 18), (10, 24), (20, 32), (25, 44), (26, 54), (22, 60)]
    return shapes.revolve(np.array(lower + [(27, 64), (27, 67), (20, 67), (16, 56), (0, 54)], float), 30)


def _lamp() -> np.ndarray:
    """A dish on a chain, from y = 160 up to the arch."""
    link = shapes.instances(shapes.torus(4.4, 1.1, 10, 5), shapes.placement(scale=(1, 1, 1.5), pitch=PI / 2))
    number = np.arange(18)
    heights = np.column_stack([0 * number, 190 + 7.3 * number, 0 * number])
    dish = [(0, 160), (14, 162), (24, 170), (26, 180), (22, 186), (6, 188), (0, 190)]
    chain = shapes.scatter(link, heights, 1.0, PI / 2 * (number % 2))
    return shapes.join(chain, shapes.revolve(np.array(dish, float), 24))


def _pots(random: np.random.Generator) -> np.ndarray:
    """Vases along the columns, with plants in some, and lamps that hang from the arches on chains."""
    vase, lamp, parts = _vase(), _lamp(), []
    for bay in range(_BAYS):
        x = _START + _BAY * (bay + 1)
        parts.append(vase + (x - 30 + 60 * random.random(), 0, _NAVE - 72))
        if bay % 2 == 0:
            parts.append(lamp + (x - _BAY / 2, 0, _NAVE - 50))
        if bay % 3 == 1:
            parts.append(_plant(random, 170) + (x, 60, _NAVE - 72))
    return shapes.join(*parts)


def _plant(random: np.random.Generator, leaves: int) -> np.ndarray:
    """A bush of bent leaves about the origin, some 60 high."""

    def blade(s, t):
        return (s - 0.5) * 0.5 * sin(PI * (0.08 + 0.9 * t)), 0.3 * t - 0.5 * t**2 + 0.1 * np.abs(s - 0.5), t

    turn, lift = TURN * random.random(leaves), -1.3 * random.random(leaves)
    size, reach = 12 + 16 * random.random(leaves), 18 * random.random(leaves)
    where = np.stack([reach * sin(turn), 38 * random.random(leaves) - 6, reach * cos(turn)], axis=1)
    return shapes.instances(shapes.surface(blade, 5, 2), shapes.placement(where, size[:, None], turn, lift))


def _end(x: float, turn: float, random: np.random.Generator) -> np.ndarray:
    """An end wall across the atrium: a gate on columns about a lion's head in a round frame."""
    quarter = PI / 2
    gate = _arch(420.0, 330.0, 900.0, 60.0, 40) - (210, 0, 0)
    whole = shapes.join(
        shapes.quad((0, 0, -_AISLE), (0, 0, 2 * _AISLE), (0, _TOP, 0), 2, 1),
        shapes.instances(gate, shapes.placement((30, 0, 0), yaw=quarter)),
        shapes.instances(_lion(random), shapes.placement((66, 230, 0), (110.0, 110.0, 85.0), quarter)),
        shapes.instances(shapes.torus(140.0, 12.0, 64, 12), shapes.placement((66, 230, 0), roll=quarter)),
        shapes.boxes([(20, 0, -345), (20, 0, 255)], [(110, 900, -255), (110, 900, 345)]),
        shapes.scatter(_column(480.0, 40.0, 9, 28), [[130, 0, -205], [130, 0, 205]]),
    )
    return shapes.instances(whole, shapes.placement((x, 0, _MIDDLE), yaw=turn))


def _lion(random: np.random.Generator) -> np.ndarray:
    """A lion's head in relief, about radius 1, facing +z: brow, eyes, muzzle and a mane of locks."""
    locks = random.random(3)

    def face(s, t):
        angle, r = TURN * s, 1.15 * t
        x, y = r * cos(angle), r * sin(angle)

        def bump(cx, cy, wide, high):
            return exp(-(((np.abs(x) - cx) / wide) ** 2 + ((y - cy) / high) ** 2))

        z = 0.75 * exp(-power(r / 0.75, 4)) + 0.35 * bump(0, -0.15, 0.2, 0.3) + 0.14 * bump(0.17, -0.3, 0.14, 0.12)
        z = z + 0.16 * bump(0.27, 0.3, 0.17, 0.08) - 0.18 * bump(0.25, 0.14, 0.09, 0.06)
        mane = sin(13 * angle + 7 * r + 6 * locks[0]) + 0.5 * sin(31 * angle - 9 * r + 6 * locks[1])
        return x, y, z - 0.3 * bump(0, -0.52, 0.2, 0.07) + 0.11 * mane * np.clip((r - 0.5) / 0.2, 0, 1) + 0.05

    return shapes.surface(face, 52, 150, wrap_columns=True)


RECIPE = Recipe(
    name="sponza",
    title="Sponza",
    triangles=279_163,
    files=(("sponza.npz", "edc6ab861383bdefa2a2dffbfa335f557449ae1ab25aa3da0640d2db2239d0ed"),),
    real_views=(View((-1150.0, 260.0, -40.0), (900.0, 330.0, -40.0), fov_degrees=65.0, name="atrium"),),
    stand_in_views=(View((-1150.0, 260.0, -40.0), (900.0, 330.0, -40.0), fov_degrees=65.0, name="atrium"),),
    stand_in=stand_in,
    licence="CC BY 3.0",
    credit="Frank Meinl, Crytek, 2010, after Marko Dabrovic",
    paper=True,
)
