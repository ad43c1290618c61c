"""Conference room: a table with chairs, wall panels and lamps.

Like the original it is clumped: nearly two thirds of the triangles are one object on the floor of a corner, here a
coil of braided cable; the rest of the room is coarse.
"""

from __future__ import annotations

import numpy as np

from harness.data import View
from scenes import Recipe
from scenes.elementary import PI, TURN, cos, power, sin, steps
from scenes.shapes import (
    box,
    boxes,
    fan,
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
        latitude, longitude = PI * (t - 0.5), TURN * s
        round_off = lambda value: np.sign(value) * power(np.abs(value), 0.35)  # noqa: E731
        c = round_off(cos(latitude))
        return (
            width / 2 * c * round_off(cos(longitude)),
            height / 2 * round_off(sin(latitude)),
            depth / 2 * c * round_off(sin(longitude)),
        )

    return surface(skin, steps, 2 * steps, wrap_columns=True)


def chair() -> np.ndarray:
    """An upholstered chair on a swivel foot, looking along z, foot at the origin."""
    seat = cushion(72, 16, 70, 9) + [0, 62, 0]
    back = instances(cushion(70, 76, 12, 9), placement((0, 112, -36), pitch=-0.16))
    part = np.linspace(0, 1, 10)[:, None]
    arms = []
    for side in (-1, 1):
        bow = np.concatenate([side * (40 + 0 * part), 66 + 34 * sin(PI * part), -30 + 58 * part], axis=1)
        arms.append(tubes(bow, 3.5, 7))
    angle = TURN * np.arange(5) / 5
    reach = np.linspace(0, 38, 5)[:, None, None]
    feet = reach * np.stack([cos(angle), np.zeros(5), sin(angle)], axis=1)
    feet = np.moveaxis(feet + [0, 6, 0], 0, 1)
    post = tubes(np.array([[0, 6, 0], [0, 30, 0], [0, 54, 0]]), 4, 12)
    casters = scatter(sphere(4.5, 5, 8), feet[:, -1] - [0, 2, 0])
    # Like the original's, the chairs have one small part that is far finer than the rest.
    button = instances(sphere(5, 11, 20), placement((0, 118, -29), scale=(1, 1, 0.4), pitch=-0.16))
    return join(seat, back, button, *arms, tubes(feet, 3, 6), post, casters)


def table() -> np.ndarray:
    """A long oval top with a rounded rim on two feet."""
    angle = np.linspace(0, TURN, 160, endpoint=False)
    oval = np.stack(
        [
            TABLE_HALF[0] * np.sign(cos(angle)) * np.sqrt(np.abs(cos(angle))),
            0 * angle,
            TABLE_HALF[1] * np.sign(sin(angle)) * power(np.abs(sin(angle)), 0.8),
        ],
        axis=1,
    )
    turn = np.linspace(PI / 2, -PI / 2, 9)
    rim = [oval * (1 + 0.012 * cos(a)) + [0, TABLE_TOP - 6 + 6 * sin(a), 0] for a in turn]
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
    places = steps(LOWER[0] + 40, UPPER[0] - 220, 240)
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
            yaws.append(0.0 if side < 0 else PI)
        offsets.append(TABLE + [side * (TABLE_HALF[0] + 60), 0, 0])
        yaws.append(-side * PI / 2)
        for x in np.linspace(-620, 1250, 14):
            offsets.append([x, 0, -980.0] if side < 0 else [x, 0, 590.0])
            yaws.append(0.0 if side < 0 else PI)
    return scatter(chair(), np.array(offsets), 1.0, np.array(yaws))


def lamps() -> np.ndarray:
    """Spotlights under the ceiling."""
    shade = revolve(np.array([(46, 0), (44, 12), (34, 30), (20, 38), (6, 40), (6, 60)], float), 28)
    bulb = sphere(16, 10, 18) + [0, 10, 0]
    places = [(x, 585, z) for x in np.linspace(-800, 1450, 7) for z in (-760, -190, 400)]
    return scatter(join(shade, bulb), np.array(places, float))


def cable() -> np.ndarray:
    """A coil of braided cable on the floor of a corner, some 40 wide: 208,000 triangles, in four cells of 128^3."""
    t = np.linspace(0, 1, 1301)
    angle, radius = TURN * 5 * t, 5 + 13 * t
    strands = []
    for phase in (0.0, TURN / 4, TURN / 2, 3 * TURN / 4):
        twist = 400 * t + phase
        out = radius + 0.75 * cos(twist)
        strands.append(np.stack([out * cos(angle), 0.75 * sin(twist), out * sin(angle)], axis=1))
    return tubes(np.stack(strands), 0.55, 20) + [1632, -0.4, -1005]


def small_things() -> np.ndarray:
    """A telephone conference on the table, glasses, and a plant in a corner."""
    phones = scatter(
        join(cushion(30, 8, 26, 12), sphere(4, 12, 20) + [0, 6, 0]),
        TABLE + np.array([(-420, TABLE_TOP + 4, 60), (360, TABLE_TOP + 4, -40)]),
    )
    glass = revolve(np.array([(0, 0), (4, 0), (4.2, 10), (4.4, 12), (4.0, 12), (3.7, 1), (0, 1)], float), 12)
    spots = [(x, TABLE_TOP, z) for x in np.linspace(-600, 600, 10) for z in (-150, 150)]
    return join(phones, scatter(glass, TABLE + np.array(spots)))


def stand_in(seed: int) -> np.ndarray:
    """About 331,000 triangles in the real scene's bounds: float32[n,3,3]."""
    del seed  # nothing here is random
    triangles = join(room(), table(), seats(), lamps(), cable(), small_things())
    return on_lattice(np.clip(triangles, LOWER, UPPER), 4096.0, 21)


RECIPE = Recipe(
    name="conference",
    title="Conference",
    triangles=331_179,
    files=(("conference.npz", "51dc8144abca976101cb411a430b56e4e55fe241ba8663d43f22ecf417a4fcfa"),),
    real_views=(View((1300.0, 420.0, -560.0), (-200.0, 60.0, 60.0), fov_degrees=65.0, name="room"),),
    stand_in_views=(View((1300.0, 420.0, -560.0), (-200.0, 60.0, 60.0), fov_degrees=65.0, name="room"),),
    stand_in=stand_in,
    licence="unknown",
    credit="Anat Grynberg and Greg Ward, recreated by Kenzie Lamar",
    paper=True,
)
