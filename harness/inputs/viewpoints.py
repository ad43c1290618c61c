"""Views for a mesh that states none: inside for rooms, outside for objects, decided by measurement.

Rays are traced with Embree from points all over the bounding box. A point is *enclosed* where most directions meet
front faces some way off: the air of a room is, that inside a solid (back faces only), between the hairs of a ball
(everything near) or above an object (nothing there) is not. A scene with enough enclosed points is a room.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.data import Rays, View
from harness.reference.embree_scene import EmbreeScene

POINTS, DIRECTIONS = 512, 256  # how many eyes are tried, and how many rays are traced from each
ENCLOSED_HITS = 0.7  # least fraction of directions that hit; Sponza's and Sibenik's air lies above it
FRONT_FACES = 0.4  # least fraction of hits on front faces; not all rooms are wound one way
FREE_DISTANCE = 0.08  # least median distance to a hit, over the diagonal of the bounds
ROOM_SHARE = 0.07  # least share of enclosed points: rooms reach 0.10 and more, a ball of hair 0.03
HEADINGS = 16  # directions of view tried in a room
AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Found:
    """Views and why: `room` tells rooms from objects, `reason` says by what measurement, for people."""

    views: tuple[View, ...]
    room: bool
    reason: str


def find_views(triangles: np.ndarray, up: str = "y") -> Found:
    """Views of float32[n,3,3], the better one first: from inside for a room, else from outside.

    `up` is an axis, maybe with a minus sign: `y`, `-z`.
    """
    lower, upper = triangles.min(axis=(0, 1)).astype(float), triangles.max(axis=(0, 1)).astype(float)
    away, middle = outside_view(lower, upper, up), (lower + upper) / 2
    diagonal = float(np.linalg.norm(upper - lower))
    if diagonal == 0:
        return Found((away, _inside(middle, None, up, 1.0)), False, "outside: the scene is a single point")
    eyes = lower + (upper - lower) * np.random.default_rng(0).uniform(0.05, 0.95, (POINTS, 3))
    distance, front = _look_around(EmbreeScene(triangles, robust=False), triangles, eyes)
    hit = np.isfinite(distance)
    median = np.median(distance, axis=1) / diagonal
    facing = front.sum(axis=1) / np.maximum(hit.sum(axis=1), 1)
    enclosed = (hit.mean(axis=1) >= ENCLOSED_HITS) & (facing >= FRONT_FACES) & (median >= FREE_DISTANCE)
    share = float(enclosed.mean())
    says = f"{share:.0%} of {POINTS} points in its bounds are enclosed by surfaces, {ROOM_SHARE:.0%} make a room"
    if share < ROOM_SHARE:
        return Found((away, _inside(middle, None, up, diagonal)), False, f"outside, an object: {says}")
    best = int(np.argmax(np.where(enclosed, np.where(np.isfinite(median), median, 0), -1)))
    return Found((_inside(eyes[best], distance[best], up, diagonal), away), True, f"inside, a room: {says}")


def _look_around(embree, triangles: np.ndarray, eyes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances float32[eyes, DIRECTIONS] (inf = miss) and whether each hit lies on a front face."""
    around = sphere_directions(DIRECTIONS)
    origins = np.repeat(eyes.astype(np.float32), DIRECTIONS, axis=0)
    directions = np.tile(around, (len(eyes), 1))
    hits = embree.trace(Rays(origins, directions, np.full(len(origins), np.inf, np.float32)))
    a, b, c = triangles[hits.primitive].astype(np.float64).transpose(1, 0, 2)
    against = (np.cross(b - a, c - a) * directions).sum(axis=1) < 0
    shape = (len(eyes), DIRECTIONS)
    distance = np.where(hits.primitive >= 0, hits.t, np.inf)
    return distance.reshape(shape), (against & (hits.primitive >= 0)).reshape(shape)


def sphere_directions(count: int) -> np.ndarray:
    """Evenly spread unit vectors float32[count,3]: a Fibonacci lattice (Gonzalez 2010)."""
    number = np.arange(count) + 0.5
    height = 1 - 2 * number / count
    turn, radius = np.pi * (1 + 5**0.5) * number, np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1).astype(np.float32)


def up_vector(up: str) -> np.ndarray:
    """float64[3] of an axis' name."""
    vector = np.zeros(3)
    vector[AXES[up[-1]]] = -1.0 if up.startswith("-") else 1.0
    return vector


def _frame(up: str) -> np.ndarray:
    """Rows: right, up, towards the viewer; the identity where `up` is y."""
    vertical = up_vector(up)
    right = np.array([0.0, 1.0, 0.0]) if up[-1] == "x" else np.array([1.0, 0.0, 0.0])
    return np.stack([right, vertical, np.cross(right, vertical)])


def _triple(vector: np.ndarray) -> tuple[float, float, float]:
    return tuple(vector.tolist())


def outside_view(lower: np.ndarray, upper: np.ndarray, up: str = "y") -> View:
    """A three-quarter view from outside that holds the whole bounds."""
    centre, radius = (lower + upper) / 2, max(float(np.linalg.norm(upper - lower)) / 2, 1e-6)
    towards = np.array([0.6, 0.45, 1.0]) / np.linalg.norm([0.6, 0.45, 1.0])
    eye = centre + towards @ _frame(up) * radius * 2.7
    return View(_triple(eye), _triple(centre), _triple(up_vector(up)), fov_degrees=45.0, name="outside")


def _inside(eye: np.ndarray, distance: np.ndarray | None, up: str, diagonal: float) -> View:
    """A wide view from `eye`, level, towards the farthest walls; where none were measured, to the right."""
    right, vertical, back = _frame(up)

    def towards(heading: np.ndarray) -> View:
        target = _triple(eye + heading * diagonal / 4)
        return View(_triple(eye), target, _triple(vertical), fov_degrees=75.0, name="inside")

    if distance is None:
        return towards(right)
    turns = 2 * np.pi * np.arange(HEADINGS) / HEADINGS
    headings = np.outer(np.cos(turns), right) + np.outer(np.sin(turns), back)
    seen = headings @ sphere_directions(len(distance)).T.astype(float) > np.cos(np.pi / 6)
    reach = np.minimum(np.where(np.isfinite(distance), distance, 0), diagonal)  # what misses shows nothing
    means = [reach[cone].mean() for cone in seen]
    return towards(headings[int(np.argmax(means))])
