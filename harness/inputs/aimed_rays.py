"""Rays aimed at the shared edges and closed vertices of a scene, where a tracer that is not watertight leaks.

Each origin is that of a diffuse ray (in a convex body, of a random one), and the target lies on an edge or a vertex
of the triangle that this ray hits first. The triangles around the target face the ray and leave no gap, so something
must be hit at t <= 1: a tracer that answers more than `MOST_T` has let the ray through.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.data import Hits, Rays, Scene
from harness.errors import DefrayError
from harness.inputs.rays import make_rays
from harness.reference.embree_scene import EmbreeScene

MOST_T = 1 + 1e-3  # of a ray that was stopped; the target is at t = 1
LEAST_SINE = 0.05  # of the angle between the ray and every triangle around the target
MARGIN = 16 * 2.0**-24  # over the target's distance: how far inside the fan the target lies, beyond rounding
PASS = 1 << 18  # origins tried at once
PASSES = 2  # of diffuse rays, and then of random ones, before the yield is judged
POOR_PASSES = 8  # passes that together yield less than LEAST_YIELD: the scene is given up
LEAST_YIELD = 1e-3  # usable targets an origin; at this rate a million rays take about an hour
_CHUNK = 1 << 20  # triangles scanned at once
_FLAGS = 27  # bits of a hash that the first filter looks at


@dataclass(frozen=True, eq=False)
class AimedRays:
    """`rays`, their directions not normalised; `at_vertex` bool[n]: at a vertex, else at a point of an edge."""

    rays: Rays
    at_vertex: np.ndarray

    def __len__(self) -> int:
        return len(self.rays)

    def __getitem__(self, rows) -> AimedRays:
        return AimedRays(self.rays[rows], self.at_vertex[rows])


def leaked(hits: Hits) -> np.ndarray:
    """bool[n]: aimed rays that were let through, a t that is no number among them."""
    return ~(hits.t <= np.float32(MOST_T))


def aimed_rays(scene: Scene, count: int, seed: int = 1, embree: EmbreeScene | None = None) -> AimedRays:
    """`count` rays aimed where methods leak: about half at points of edges, half at vertices where the scene allows.

    The same seed gives the same rays. `embree` saves building the hierarchy. Raises DefrayError for a scene whose
    triangles share no edges, or hardly any, and for one without a view.
    """
    embree = embree or EmbreeScene(scene.triangles)
    index, parts, found, turn, kind = CornerIndex(scene.triangles), [], 0, 0, "diffuse"
    tried = 0
    while found < count:
        if turn >= 2 * PASSES and not found:
            raise DefrayError(f"no triangles of scene {scene.name} that rays hit share an edge: nothing to aim at")
        if turn >= POOR_PASSES and found < LEAST_YIELD * tried:
            raise DefrayError(
                f"too few triangles of scene {scene.name} that rays hit share an edge: {tried:,} tries "
                f"gave {found:,} of {count:,} aimed rays"
            )
        size = min(PASS, max(4096, 4 * (count - found)))
        # A convex body sends hardly a ray back to itself: there the origins lie anywhere in the scene's bounds.
        rich = found and found >= LEAST_YIELD * tried
        kind = "diffuse" if turn < PASSES or (kind == "diffuse" and rich) else "random"
        start = make_rays(scene, kind, size, seed=1000 * seed + turn, embree=embree)
        parts.append(_one_pass(scene, index, embree, start, _vertex_share(parts), turn))
        found, tried, turn = found + len(parts[-1]), tried + size, turn + 1
    # In random order, so that a part of the rays is like the whole.
    order = np.random.Generator(np.random.Philox(key=[seed, 5 << 32])).permutation(count)
    origins, directions, at_vertex = (
        np.concatenate(columns)[order]
        for columns in zip(*((p.rays.origins, p.rays.directions, p.at_vertex) for p in parts), strict=True)
    )
    return AimedRays(Rays(origins, directions, np.full(count, np.inf, np.float32), "aimed", seed), at_vertex)


def _vertex_share(parts: list[AimedRays]) -> float:
    """Share of the next origins that aim at vertices, so that about half of what is kept does."""
    at_vertex = sum(int(part.at_vertex.sum()) for part in parts)
    at_edge = sum(len(part) for part in parts) - at_vertex
    return min(max(at_edge / max(at_vertex + at_edge, 1), 0.25), 0.75) if parts else 0.5


def _one_pass(
    scene: Scene, index: CornerIndex, embree: EmbreeScene, start: Rays, share: float, turn: int
) -> AimedRays:
    """Aim once from each origin of `start`; what is kept has a closed fan that faces it and nothing in front."""
    size, seed = len(start), start.seed
    primitive = embree.trace(start).primitive
    hit = np.flatnonzero(primitive >= 0)
    generator = np.random.Generator(np.random.Philox(key=[seed, (4 << 32) + turn]))
    corner, along, at_vertex = (
        values[hit]
        for values in (generator.integers(3, size=size), generator.random((size, 1)), generator.random(size) < share)
    )
    origins, primitive = start.origins[hit], primitive[hit]
    first = scene.triangles[primitive, corner]
    second = np.where(at_vertex[:, None], first, scene.triangles[primitive, (corner + 1) % 3])
    target = first.astype(np.float64) + along * (second.astype(np.float64) - first)
    directions = (target - origins).astype(np.float32)
    closed = closed_fans(index, first, second, target, origins, at_vertex)
    rays = Rays(origins, directions, np.full(len(hit), np.inf, np.float32), "aimed", seed)
    rays, at_vertex = rays[closed], at_vertex[closed]
    # Behind something nearer, a leak would not be seen. What Embree lets through stays: it is judged like the rest.
    seen = ~(embree.trace(rays).t < 2 - MOST_T)
    return AimedRays(rays[seen], at_vertex[seen])


class CornerIndex:
    """Finds the triangles that have a given position among their corners; `triangles` float32[n,3,3].

    Positions are the same when their coordinates are equal, so -0 is 0. Keeps 12 bytes a triangle.
    """

    def __init__(self, triangles: np.ndarray):
        self.triangles = triangles
        self._hashes = np.empty(3 * len(triangles), np.uint32)
        for first in range(0, len(triangles), _CHUNK):
            part = triangles[first : first + _CHUNK].reshape(-1, 3)
            self._hashes[3 * first : 3 * first + len(part)] = hash_positions(part) >> np.uint64(32)

    def around(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Every corner at one of m distinct positions float32[m,3]: (int64 position, int64 corner 3 i + k).

        Sorted by position. Hashes only narrow the search; what counts is that all three coordinates are equal.
        """
        keys = _bits(positions)
        flags = np.zeros(1 << _FLAGS, bool)
        shift = np.uint32(32 - _FLAGS)
        flags[(hash_positions(positions) >> np.uint64(32)).astype(np.uint32) >> shift] = True
        corners = np.concatenate(
            [
                first + np.flatnonzero(flags[self._hashes[first : first + 3 * _CHUNK] >> shift])
                for first in range(0, len(self._hashes), 3 * _CHUNK)
            ]
        )
        order = np.argsort(keys)
        points = _bits(self.triangles.reshape(-1, 3)[corners])
        place = np.minimum(np.searchsorted(keys, points, sorter=order), len(keys) - 1)
        position = order[place]
        equal = keys[position] == points
        position, corners = position[equal], corners[equal]
        by_position = np.argsort(position, kind="stable")
        return position[by_position], corners[by_position]


def _words(points: np.ndarray) -> np.ndarray:
    """uint32[n,3]: the coordinates' bits, with -0 as 0."""
    return (np.ascontiguousarray(points, np.float32) + np.float32(0)).view(np.uint32)


def hash_positions(points: np.ndarray) -> np.ndarray:
    """uint64[n] of float32[n,3]: the three words mixed by odd multipliers (SplitMix64's constants)."""
    words = _words(points).astype(np.uint64)
    mixed = words[:, 0] * np.uint64(0x9E3779B97F4A7C15)
    for axis, factor in ((1, 0xBF58476D1CE4E5B9), (2, 0x94D049BB133111EB)):
        mixed = (mixed ^ (mixed >> np.uint64(29)) ^ words[:, axis]) * np.uint64(factor)
    return mixed ^ (mixed >> np.uint64(31)) ^ (mixed << np.uint64(32))


def _bits(points: np.ndarray) -> np.ndarray:
    """complex128[n]: each position as one sortable number that holds all 96 bits."""
    words = _words(points).astype(np.float64)
    # x and y share a part: 2^53 holds no 64 bits, so y is split between the two.
    high, low = np.divmod(words[:, 1], 65536.0)
    return (words[:, 0] * 65536.0 + high) + 1j * (low * 2.0**32 + words[:, 2])


def closed_fans(index: CornerIndex, first, second, target, origins, at_vertex) -> np.ndarray:
    """bool[m]: targets whose triangles leave no gap, face the origin and are larger than rounding.

    `first`, `second` float32[m,3], the ends of the edge (equal for a vertex); `target` float64[m,3]; `origins`
    float32[m,3]; `at_vertex` bool[m]. Around an edge there must be exactly two triangles, which run through it in
    opposite directions; around a vertex every neighbour must begin one triangle and end another. As all of them
    also face the ray on the same side, their projections wind around the target: no gap.
    """
    count, (whose, corner) = len(first), _incident(index, first)
    triangle, slot = np.divmod(corner, 3)
    following = index.triangles[triangle, (slot + 1) % 3]
    preceding = index.triangles[triangle, (slot + 2) % 3]
    begins = ~at_vertex[whose] & (following == second[whose]).all(axis=1)
    ends = ~at_vertex[whose] & (preceding == second[whose]).all(axis=1)
    taking_part = np.flatnonzero(at_vertex[whose] | begins | ends)
    whose, begins, ends = whose[taking_part], begins[taking_part], ends[taking_part]
    following, preceding = following[taking_part], preceding[taking_part]
    side = _side(first[whose], following, preceding, target[whose], origins[whose], begins, ends)

    def number(which: np.ndarray) -> np.ndarray:
        return np.bincount(whose[which], minlength=count)

    pair = (number(begins) == 1) & (number(ends) == 1)
    closed = np.where(at_vertex, _neighbours_match(whose, following, preceding, count), pair)
    all_of_them = np.bincount(whose, minlength=count)
    return closed & ((number(side == 1) == all_of_them) | (number(side == -1) == all_of_them))


def _incident(index: CornerIndex, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every corner at each of m positions float32[m,3], which may repeat: (int64 row, int64 corner 3 i + k)."""
    _, example, number = np.unique(_bits(positions), return_index=True, return_inverse=True)
    which, corner = index.around(positions[example])
    counts = np.bincount(which, minlength=len(example))
    starts = np.cumsum(counts) - counts
    repeats = counts[number]
    whose = np.repeat(np.arange(len(positions)), repeats)
    within = np.arange(len(whose)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    return whose, corner[starts[number][whose] + within]


def _neighbours_match(whose, following, preceding, count: int) -> np.ndarray:
    """bool[count]: around each vertex, every neighbour follows it in one triangle and precedes it in another."""
    ids = np.unique(_bits(np.concatenate([following, preceding])), return_inverse=True)[1].reshape(2, -1)
    # Each triangle brings one of either kind, so place i of both sorted lists belongs to the same vertex.
    begin, end = np.sort(whose * (ids.max(initial=0) + 1) + ids, axis=1)
    wrong = begin != end
    wrong[1:] |= begin[1:] == begin[:-1]
    return np.bincount(whose[wrong], minlength=count) == 0


def _side(corner, following, preceding, target, origins, begins, ends) -> np.ndarray:
    """int8[m]: which side of a triangle its ray sees, 1 or -1; 0 where it grazes it or nearly leaves the fan."""
    origins = origins.astype(np.float64)
    a, b, c = (points - origins for points in (corner, following, preceding))
    aim = target - origins
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = np.einsum("ij,ij->i", normal, aim) / (_length(normal) * _length(aim))
        outside = _line_distance(aim, b, c)
        outside = np.fmin(outside, np.where(begins, _line_distance(aim, c, a), np.inf))
        outside = np.fmin(outside, np.where(ends, _line_distance(aim, a, b), np.inf))
        inside = outside > MARGIN * np.max([_length(points) for points in (a, b, c)], axis=0)
        return np.where((np.abs(sine) > LEAST_SINE) & inside, np.sign(sine), 0).astype(np.int8)


def _line_distance(aim, start, end) -> np.ndarray:
    """Distance between the ray along `aim` from 0 and the line through `start` and `end`, all float64[m,3]."""
    across = np.cross(aim, end - start)
    return np.abs(np.einsum("ij,ij->i", start, across)) / _length(across)


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
