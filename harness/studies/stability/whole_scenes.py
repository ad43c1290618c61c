"""Families that trace whole scenes: Embree's watertight test, and triangles without area among others."""

from __future__ import annotations

import numpy as np

from harness import tracers
from harness.data import Hits, Rays, Scene
from harness.device.opened import Device
from harness.reference.check import Checker
from harness.reference.exact import zero_area
from harness.spec.intersectors import Intersector
from harness.spec.run_spec import Variant
from harness.spec.stress_suite import METRICS
from harness.spec.structure import Uniform
from harness.studies.stability.closed_meshes import globe
from harness.studies.stability.failures import GROSS_ULP
from harness.tracers.prepared import Prepared

GRID = Uniform(8, 64)
SPHERE_DIVISIONS, PLANE_DIVISIONS = 289, 500  # cells an edge: 500 x 1000 on the sphere of six faces, 500 x 500
SPHERE_RADIUS, PLANE_SIZE, PLANE_DISTANCE = 2.0, 12.0, 3.0


def prepare(device: Device, triangles: np.ndarray) -> Prepared:
    """A scene on the device, with its grid."""
    prepared = Prepared.on_device(Scene("stability", triangles), device)
    return prepared.with_structure(GRID)


def trace(prepared: Prepared, rays: Rays, tracer: str, intersector: Intersector, contraction: str) -> Hits:
    """First hits by one tracer."""
    variant = Variant(tracer=tracer, intersector=intersector.name, options={"contraction": contraction})
    return tracers.open_tracer(prepared, variant).timed(rays)[0]


def verify_inputs(case: dict, count: int, generator: np.random.Generator) -> tuple[np.ndarray, Rays]:
    """Triangles and rays of Embree's WatertightTest; every ray should hit.

    `case`: `model` sphere, random rays from around the centre, or plane, random rays from one point before it;
    `position` of both.
    """
    position = np.array(case["position"])
    turns = 2 * generator.random((count, 3)) - 1
    if case["model"] == "sphere":
        vertices, faces = globe(SPHERE_DIVISIONS)
        triangles = (SPHERE_RADIUS * vertices + position)[faces]
        origins = position + 2 * generator.random((count, 3)) - 1
        directions = turns
    else:
        triangles = _plane(position[0])
        origins = np.broadcast_to([position[0] - PLANE_DISTANCE, 0.0, 0.0], (count, 3))
        directions = np.stack([np.ones(count), turns[:, 1], turns[:, 2]], axis=1)
    limit = np.full(count, np.inf, np.float32)
    rays = Rays(origins.astype(np.float32), directions.astype(np.float32), limit)
    return triangles.astype(np.float32), rays


def _plane(x: float) -> np.ndarray:
    """A square of 12 x 12 about the axis at `x`: float64[t,3,3]."""
    step = PLANE_SIZE / PLANE_DIVISIONS
    i, j = np.divmod(np.arange(PLANE_DIVISIONS**2), PLANE_DIVISIONS)
    corner = np.stack([np.full(len(i), x), i * step - PLANE_SIZE / 2, j * step - PLANE_SIZE / 2], axis=1)
    right, up = np.array([0, step, 0]), np.array([0, 0, step])
    square = [corner, corner + right, corner + right + up, corner + up]
    return np.concatenate([np.stack([square[k] for k in order], axis=1) for order in ((0, 1, 2), (0, 2, 3))])


def judge_verify(hits: Hits) -> dict:
    """Rays that hit nothing."""
    hit = hits.primitive >= 0
    return {
        "rays": len(hits),
        **dict.fromkeys(METRICS),
        "leaks": int((~hit).sum()),
        "nonfinite": int((hit & ~np.isfinite(hits.t)).sum()),
    }


def degenerate_inputs(case: dict, count: int, generator: np.random.Generator) -> tuple[np.ndarray, Rays]:
    """A scene in which every triangle appears four times: itself, a copy, a point and a line of its corners."""
    healthy = generator.random((400, 1, 3)) + 0.3 * (generator.random((400, 3, 3)) - 0.5)
    points = np.repeat(healthy[:, :1], 3, axis=1)
    lines = healthy[:, [0, 1, 1]]
    steps = np.round(healthy * 64) / 64  # corners a, b and 2 b - a, which is exact on a lattice
    lines[::2] = np.stack([steps[:, 0], steps[:, 1], 2 * steps[:, 1] - steps[:, 0]], axis=1)[::2]
    triangles = np.concatenate([healthy, healthy, points, lines]).astype(np.float32)
    origins = generator.random((count, 3)).astype(np.float32)
    corners = triangles[generator.integers(len(triangles), size=count)].astype(np.float64)
    weights = generator.integers(0, 3, (count, 3, 1)) + 1e-3
    targets = (corners * weights).sum(axis=1) / weights.sum(axis=1)
    limit = np.full(count, np.inf, np.float32)
    return triangles, Rays(origins, (targets - origins).astype(np.float32), limit)


def judge_degenerate(triangles: np.ndarray, rays: Rays, hits: Hits) -> dict:
    """Gross: a hit on a triangle without area or on the second of two equal ones, and all that exact arithmetic finds
    missed or wrong beyond rounding.
    """
    hit = hits.primitive >= 0
    flat = zero_area(triangles)
    copy = np.zeros(len(triangles), bool)
    copy[len(triangles) // 4 : len(triangles) // 2] = True
    bad = hit & (flat | copy)[np.maximum(hits.primitive, 0)]
    agreement = Checker(triangles, rays, "embree", ~flat).check(hits)
    wrong = agreement.wrong + agreement.missed + agreement.phantom
    return {
        "rays": len(hits),
        **dict.fromkeys(METRICS),
        "gross": int(bad.sum()) + (wrong if agreement.worst_band_ulp > GROSS_ULP else 0),
        "nonfinite": int((hit & ~np.isfinite(hits.t)).sum()),
    }
