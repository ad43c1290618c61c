"""Families S: rays spawned from hits must not hit where they start, nor skip what is near.

Mitsuba 3's configurations (src/render/tests/test_ray_offset.py) for a rectangle, a cube and a sphere of triangles;
the hit itself comes from the intersector under test.
"""

from __future__ import annotations

import numpy as np

from harness.data import Rays
from harness.device.opened import Device
from harness.inputs.rays import offset_origin
from harness.spec.intersectors import Intersector
from harness.spec.stress_suite import METRICS
from harness.studies.stability.closed_meshes import icosphere, lattice_box, random_units, unit
from harness.studies.stability.pairs import Pairs, PairTester

SELF_HIT = 1e-3  # a hit nearer than this part of the shape's size is one on the surface the ray starts on
TUNNEL = 1e-3  # an origin moved by more than this part of the shape's size may skip what is near
INSIDE = 0.8  # rays are aimed at points within this part of the shape's size
_GAMMA = 7 * 2.0**-24 / (1 - 7 * 2.0**-24)  # pbrt's bound of a point interpolated between three vertices


def offset_inputs(case: dict, count: int, generator: np.random.Generator) -> list[tuple[np.ndarray, Rays]]:
    """For each shape, triangles float32[t,3,3] and rays at it from `distance` sizes away.

    `case`: `shift` of the shape along every axis, `scale`, its size, and `distance`.
    """
    centre, scale = np.full(3, case["shift"]), case["scale"]
    inputs = []
    for triangles in (_rectangle(), _cube(), _sphere(generator)):
        rays = count // 3
        outward = random_units(rays, generator)
        origins = centre + case["distance"] * scale * outward
        targets = centre + INSIDE * scale * generator.random((rays, 1)) * random_units(rays, generator)
        origins = origins.astype(np.float32)
        directions = unit(targets - origins.astype(np.float64)).astype(np.float32)
        limit = np.full(rays, np.inf, np.float32)
        inputs.append(((triangles * scale + centre).astype(np.float32), Rays(origins, directions, limit)))
    return inputs


def _rectangle() -> np.ndarray:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float64)
    return corners[[[0, 1, 2], [0, 2, 3]]]


def _cube() -> np.ndarray:
    vertices, faces = lattice_box(1)
    return (2 * vertices - 1)[faces]


def _sphere(generator) -> np.ndarray:
    vertices, faces = icosphere(2, generator, jitter=0.0)
    return vertices[faces]


def judge_offsets(
    device: Device, case: dict, inputs, intersector: Intersector, contraction: str, generator: np.random.Generator
) -> dict:
    """Spawn a ray from every hit, over the hemisphere of the normal that faces where the hit was seen from.

    All shapes are convex or flat, so that no spawned ray should hit its shape again nearby.
    """
    result = {"rays": 0, **dict.fromkeys(METRICS), "self_hits": 0, "tunnels": 0, "nonfinite": 0}
    for triangles, rays in inputs:
        first = _first_hits(device, triangles, rays, intersector, contraction)
        primitive, u, v = first
        hit = np.flatnonzero(primitive >= 0)
        corners, u, v = triangles[primitive[hit]], u[hit], v[hit]
        result["nonfinite"] += int((~np.isfinite(u) | ~np.isfinite(v)).sum())
        normal = unit(np.cross(*(corners[:, k].astype(np.float64) - corners[:, 0] for k in (1, 2))))
        normal *= -np.sign((normal * rays.directions[hit]).sum(axis=1))[:, None]
        point, bound = _interpolated(corners, u, v)
        origins = OFFSETS[case["method"]](point, bound, normal)
        directions = random_units(len(hit), generator)
        directions *= np.where((directions * normal).sum(axis=1) < 0, -1.0, 1.0)[:, None]  # over the hemisphere
        limit = np.full(len(hit), np.inf, np.float32)
        spawned = Rays(origins, directions.astype(np.float32), limit)
        again = _all_hits(device, triangles, spawned, intersector, contraction, SELF_HIT * case["scale"])
        moved = np.sqrt(((origins.astype(np.float64) - point) ** 2).sum(axis=1))
        result["rays"] += len(hit)
        result["self_hits"] += int(again.sum())
        result["tunnels"] += int((moved > TUNNEL * case["scale"]).sum())
    return result


def _first_hits(device, triangles, rays, intersector, contraction):
    """Primitive int32[n] (-1 = miss) and float32 u, v of the first hit."""
    count, size = len(rays), len(triangles)
    tester = PairTester(device, _all_pairs(rays, triangles))
    answers = tester.run(intersector, contraction)
    t = np.where(answers.accepted, answers.t, np.inf).reshape(count, size)
    primitive = t.argmin(axis=1).astype(np.int32)
    row = np.arange(count)
    u, v = (values.reshape(count, size)[row, primitive] for values in (answers.u, answers.v))
    return np.where(np.isfinite(t[row, primitive]), primitive, -1).astype(np.int32), u, v


def _all_hits(device, triangles, rays, intersector, contraction, reach: float) -> np.ndarray:
    """bool[n]: whether a ray hits any triangle nearer than `reach`."""
    answers = PairTester(device, _all_pairs(rays, triangles)).run(intersector, contraction)
    near = answers.accepted & (answers.t < reach)
    return near.reshape(len(rays), len(triangles)).any(axis=1)


def _all_pairs(rays: Rays, triangles: np.ndarray) -> Pairs:
    ray, triangle = np.divmod(np.arange(len(rays) * len(triangles), dtype=np.int64), len(triangles))
    return Pairs(rays, triangles, ray.astype(np.int32), triangle.astype(np.int32))


def _interpolated(corners: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hit points float32[n,3] from barycentric coordinates, and float32 bounds of their rounding error."""
    weights = np.stack([1 - u - v, u, v], axis=1).astype(np.float32)[:, :, None]
    parts = weights * corners
    return parts.sum(axis=1, dtype=np.float32), np.float32(_GAMMA) * np.abs(parts).sum(axis=1, dtype=np.float32)


def by_error_bound(point: np.ndarray, bound: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Move points off the surface by the bound of their error: Pharr, Jakob & Humphreys 2023, section 6.8.6."""
    distance = (np.abs(normal) * bound).sum(axis=1, keepdims=True)
    moved = (point + distance * normal).astype(np.float32)
    away = np.where(normal > 0, np.float32(np.inf), np.float32(-np.inf)).astype(np.float32)
    return np.where(normal == 0, moved, np.nextafter(moved, away)).astype(np.float32)


def by_waechter_binder(point: np.ndarray, bound: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The offset of defray's own rays, which knows no bound."""
    return offset_origin(point, normal.astype(np.float32))


def not_at_all(point: np.ndarray, bound: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """For the tests: what happens without an offset."""
    return point


OFFSETS = {"error-bound": by_error_bound, "waechter-binder": by_waechter_binder, "none": not_at_all}
