"""Conference room: a table with chairs, wall panels and lamps."""

from __future__ import annotations

import numpy as np

from harness.data import View
from scenes import Recipe
from scenes.plants import cloud, leaves
from scenes.shapes import (
    box,
    boxes,
    fan,
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
    tubes,
)

LOWER, UPPER = np.array([-1020.0, -2.8, -1056.0]), np.array([1686.0, 650.0, 668.0])  # of the real scene
TABLE = np.array([300.0, 0.0, -190.0])  # its middle
TABLE_HALF = (760.0, 230.0)  # half its length and width
TABLE_TOP = 110.0


def cushion(width: float, height: float, depth: float, steps: int) -> np.ndarray:
    """A padded block with rounded edges about the origin: 2*steps*(steps-1)-ish triangles."""

    def skin(s, t):
        latitude, longitude = np.pi * (t - 0.5), 2 * np.pi * s
        round_off = lambda value: np.sign(value) * np.abs(value) ** 0.35  # noqa: E731
        c = round_off(np.cos(latitude))
        return (
            width / 2 * c * round_off(np.cos(longitude)),
            height / 2 * round_off(np.sin(latitude)),
            depth / 2 * c * round_off(np.sin(longitude)),
        )

    return surface(skin, steps, 2 * steps, wrap_columns=True)


def chair() -> np.ndarray:
    """An upholstered chair on a swivel foot, looking along z, foot at the origin."""
    seat = cushion(72, 16, 70, 20) + [0, 62, 0]
    back = instances(cushion(70, 76, 12, 20), placement((0, 112, -36), pitch=-0.16))
    part = np.linspace(0, 1, 15)[:, None]
    arms = []
    for side in (-1, 1):
        bow = np.concatenate([side * (40 + 0 * part), 66 + 34 * np.sin(np.pi * part), -30 + 58 * part], axis=1)
        arms.append(tubes(bow, 3.5, 10))
    angle = 2 * np.pi * np.arange(5) / 5
    reach = np.linspace(0, 38, 9)[:, None, None]
    feet = reach * np.stack([np.cos(angle), np.zeros(5), np.sin(angle)], axis=1)
    feet = np.moveaxis(feet + [0, 6, 0], 0, 1)
    post = tubes(np.array([[0, 6, 0], [0, 30, 0], [0, 54, 0]]), 4, 12)
    casters = scatter(sphere(4.5, 6, 10), feet[:, -1] - [0, 2, 0])
    return join(seat, back, *arms, tubes(feet, 3, 8), post, casters)


def table() -> np.ndarray:
    """A long oval top with a rounded rim on two feet."""
    angle = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    oval = np.stack(
        [
            TABLE_HALF[0] * np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** 0.5,
            0 * angle,
            TABLE_HALF[1] * np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** 0.8,
        ],
        axis=1,
    )
    turn = np.linspace(np.pi / 2, -np.pi / 2, 9)
    rim = [oval * (1 + 0.012 * np.cos(a)) + [0, TABLE_TOP - 6 + 6 * np.sin(a), 0] for a in turn]
    top, under = fan(rim[0]), fan(rim[-1])
    feet = join(*(box((x - 70, 0, -60), (x + 70, TABLE_TOP - 12, 60)) for x in (-430, 430)))
    return join(top, under, grid(np.stack(rim), wrap_columns=True), feet) + TABLE


def room() -> np.ndarray:
    """Floor, ceiling and walls of few triangles, panels, a screen, doors and ceiling beams."""
    size = UPPER - LOWER
    flats = [
        quad(LOWER, (0, 0, size[2]), (size[0], 0, 0)),
        quad((LOWER[0], UPPER[1], LOWER[2]), (size[0], 0, 0), (0, 0, size[2])),
        *(quad((LOWER[0], LOWER[1], z), (size[0], 0, 0), (0, size[1], 0)) for z in (LOWER[2], UPPER[2])),
        *(quad((x, LOWER[1], LOWER[2]), (0, 0, size[2]), (0, size[1], 0)) for x in (LOWER[0], UPPER[0])),
    ]
    places = np.arange(LOWER[0] + 40, UPPER[0] - 220, 240)
    panels = [
        boxes([(x, 60, z) for x in places], [(x + 200, 520, z + 8) for x in places])
        for z in (LOWER[2] + 2, UPPER[2] - 10)
    ]
    beams = boxes([(x, 628, LOWER[2] + 1) for x in places], [(x + 24, 649, UPPER[2] - 1) for x in places])
    screen = box((LOWER[0] + 4, 170, -420), (LOWER[0] + 14, 480, 60))
    doors = boxes([(UPPER[0] - 12, 0, z) for z in (-900, 380)], [(UPPER[0] - 2, 430, z + 180) for z in (-900, 380)])
    return join(*flats, *panels, beams, screen, doors)


def seats() -> np.ndarray:
    """Chairs about the table and in rows along two walls."""
    offsets, yaws = [], []
    for side in (-1, 1):
        for x in np.linspace(-640, 640, 12):
            offsets.append(TABLE + [x, 0, side * (TABLE_HALF[1] + 40)])
            yaws.append(0.0 if side < 0 else np.pi)
        offsets.append(TABLE + [side * (TABLE_HALF[0] + 60), 0, 0])
        yaws.append(-side * np.pi / 2)
        for x in np.linspace(-620, 1250, 14):
            offsets.append([x, 0, -980.0] if side < 0 else [x, 0, 590.0])
            yaws.append(0.0 if side < 0 else np.pi)
    return scatter(chair(), np.array(offsets), 1.0, np.array(yaws))


def lamps() -> np.ndarray:
    """Spotlights under the ceiling."""
    shade = revolve(np.array([(46, 0), (44, 12), (34, 30), (20, 38), (6, 40), (6, 60)], float), 28)
    bulb = sphere(16, 10, 18) + [0, 10, 0]
    places = [(x, 585, z) for x in np.linspace(-800, 1450, 7) for z in (-760, -190, 400)]
    return scatter(join(shade, bulb), np.array(places, float))


def small_things(random: np.random.Generator) -> np.ndarray:
    """Objects of very many triangles in very little room: telephones, glasses, a plant in a corner."""
    phones = scatter(
        join(cushion(30, 8, 26, 24), sphere(4, 24, 40) + [0, 6, 0]),
        TABLE + np.array([(-420, TABLE_TOP + 4, 60), (360, TABLE_TOP + 4, -40)]),
    )
    glass = revolve(np.array([(0, 0), (4, 0), (4.2, 10), (4.4, 12), (4.0, 12), (3.7, 1), (0, 1)], float), 24)
    spots = [(x, TABLE_TOP, z) for x in np.linspace(-600, 600, 10) for z in (-150, 150)]
    glasses = scatter(glass, TABLE + np.array(spots))
    corner = np.array([1560.0, 0.0, -930.0])
    pot = revolve(np.array([(40, 0), (52, 70), (48, 70), (0, 60)], float), 32) + corner
    foliage = leaves(random, cloud(random, 1500, corner + [0, 170, 0], (70, 100, 70)), 34)
    knot = surface(
        lambda s, t: (
            (8 + 3 * np.cos(2 * np.pi * t)) * np.cos(2 * np.pi * s),
            3 * np.sin(2 * np.pi * t),
            (8 + 3 * np.cos(2 * np.pi * t)) * np.sin(2 * np.pi * s),
        ),
        80,
        180,
        True,
        True,
    )
    return join(phones, glasses, pot, foliage, knot + TABLE + [0, TABLE_TOP + 4, 0])


def stand_in(seed: int) -> np.ndarray:
    """About 331,000 triangles in the real scene's bounds: float32[n,3,3]."""
    triangles = join(room(), table(), seats(), lamps(), small_things(generator(seed)))
    return on_lattice(np.clip(triangles, LOWER, UPPER), 4096.0, 21)


RECIPE = Recipe(
    name="conference",
    title="Conference",
    triangles=331_179,
    files=(("conference.npz", "51dc8144abca976101cb411a430b56e4e55fe241ba8663d43f22ecf417a4fcfa"),),
    real_views=(View((1300.0, 420.0, -560.0), (-200.0, 60.0, 60.0), fov_degrees=65.0, name="room"),),
    stand_in_views=(View((1380.0, 420.0, -620.0), (-100.0, 60.0, -60.0), fov_degrees=65.0, name="room"),),
    stand_in=stand_in,
    licence="unknown",
    credit="Anat Grynberg and Greg Ward, recreated by Kenzie Lamar",
    paper=True,
)
