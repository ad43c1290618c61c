"""Whole grids against brute force (family G3): what the overlap test and the exit rule lose of a scene's hits.

Walls lie exactly on cell planes, where a grid has nothing to spare: a triangle that is not referenced on both sides
of its plane is lost to rays that rounding takes to the other side.
"""

from __future__ import annotations

import hashlib
from types import SimpleNamespace

import numpy as np

from harness import tracers
from harness.data import Hits, Rays, Scene
from harness.device.opened import Device
from harness.spec.intersectors import Intersector
from harness.spec.run_spec import Variant
from harness.spec.structure import Uniform
from harness.structures.uniform import grid_box
from harness.tracers.prepared import Prepared

SPEC = Uniform(4, 32)
TRACERS = {"forward": {"exit": "keep"}, "deferred": {}}
_STREAM = 4 << 32  # separates these random numbers from those of other ray sets with the same seed
_ANCHOR = 1 / 64  # size of the two triangles that fix the bounds of the scenes with walls


def walls_triangles(_: np.random.Generator, fraction: float = 0.0, ulp: int = 0) -> np.ndarray:
    """Walls that cross each other on every fourth cell plane, `fraction` of a cell above it; float32[n,3,3].

    `ulp`: moves them by that many float32, up and down in turn.
    """
    corners = [_squares(axis, level, range(2, 31, 14)) for axis in range(3) for level in range(2, 31, 4)]
    return _on_planes(np.concatenate(corners), fraction, ulp)


def near_walls_triangles(_: np.random.Generator) -> np.ndarray:
    """The same one float32 off their planes, as rounding leaves walls in practice; float32[n,3,3]."""
    return walls_triangles(_, ulp=1)


def box_triangles(_: np.random.Generator, fraction: float = 0.0) -> np.ndarray:
    """A closed box whose walls lie on cell planes, `fraction` of a cell above them; float32[n,3,3]."""
    corners = [_squares(axis, level, range(4, 29, 4)) for axis in range(3) for level in (4, 28)]
    return _on_planes(np.concatenate(corners), fraction)


def sphere_triangles(_: np.random.Generator) -> np.ndarray:
    """A closed sphere of radius 1, a subdivided cube blown up; float32[n,3,3]."""
    corners = np.concatenate([_squares(axis, level, range(-3, 4)) for axis in range(3) for level in (-3, 3)])
    x, y, z = np.moveaxis(corners.astype(np.float64), -1, 0)
    return (corners / np.sqrt(x * x + y * y + z * z)[..., None]).astype(np.float32)


def sliver_triangles(random: np.random.Generator) -> np.ndarray:
    """Long triangles of any direction, 2^-7 to 2^-16 thin; float32[n,3,3]."""
    start, along, across = 2 * random.random((3, 300, 3)) - 1
    thin = np.ldexp(1.0, -random.integers(7, 17, (300, 1)))
    return np.stack([start, start + along, start + along * 0.5 + thin * across], axis=1).astype(np.float32)


SCENES = {
    "walls": walls_triangles,
    "walls, one ulp off": near_walls_triangles,
    "box": box_triangles,
    "sphere": sphere_triangles,
    "slivers": sliver_triangles,
}


def _squares(axis: int, level: int, marks: range) -> np.ndarray:
    """Squares between the marks of the other two axes, two triangles each: int[n,3,3], in marks."""
    low = np.array([(a, b) for a in marks[:-1] for b in marks[:-1]])
    step = marks.step
    around = np.array([(0, 0), (step, 0), (step, step), (0, step)])
    corners = np.full((len(low), 4, 3), level)
    corners[:, :, (axis + 1) % 3] = low[:, None, 0] + around[:, 0]
    corners[:, :, (axis + 2) % 3] = low[:, None, 1] + around[:, 1]
    return np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])


def _on_planes(planes: np.ndarray, fraction: float, ulp: int = 0) -> np.ndarray:
    """Triangles int[n,3,3] with corners on cell planes of SPEC, and two that make the scene's bounds [0, 1]."""
    bounds = SimpleNamespace(lower=np.zeros(3), upper=np.ones(3))
    lower, cell_size = grid_box(bounds, SPEC)
    marks = np.arange(SPEC.resolution + 1)
    place = np.array([_coordinate(lower[0], cell_size[0], k, fraction) for k in marks])
    place += np.where(marks // 4 % 2, ulp, -ulp).astype(np.float32) * np.spacing(place)
    anchor = np.array([[0, 0, 0], [_ANCHOR, _ANCHOR, 0], [0, _ANCHOR, _ANCHOR]], np.float32)
    return np.concatenate([place[planes], anchor[None], (1 - anchor)[None]])


def _coordinate(lower: np.float32, cell_size: np.float32, plane: int, fraction: float) -> np.float32:
    """The float32 that the build of the grid takes to `plane` + `fraction`; with these bounds there is one."""
    near = np.float32(float(lower) + (plane + fraction) * float(cell_size))
    tried = near + np.arange(-8, 9, dtype=np.float32) * np.spacing(near)
    cells = (tried - lower) * (np.float32(1) / cell_size)
    return tried[np.argmin(np.abs(cells.astype(np.float64) - plane - fraction))]


def aimed_rays(triangles: np.ndarray, count: int, random: np.random.Generator) -> Rays:
    """Half aimed into triangles, a quarter at edges and a quarter at vertices; every eighth parallel to an axis.

    Origins lie in the scene's bounds or a box twice as large.
    """
    lower, upper = (bound.astype(np.float64) for bound in (triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))))
    chosen = triangles[random.integers(len(triangles), size=count)].astype(np.float64)
    u, v = random.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    kind = np.arange(count)[:, None] % 4
    u, v = np.where(kind == 3, 0, u), np.where(kind >= 2, 0, v)
    target = chosen[:, 0] + u * (chosen[:, 1] - chosen[:, 0]) + v * (chosen[:, 2] - chosen[:, 0])
    target = target.astype(np.float32)
    reach = (random.random((count, 3)) - 0.5) * np.where(random.random((count, 1)) < 0.5, 1, 2)
    origin = (lower + upper) / 2 + reach * (upper - lower)
    free = np.arange(3) == random.integers(3, size=count)[:, None]
    parallel = (random.random(count) < 1 / 8)[:, None]
    origin = np.where(parallel & ~free, target, origin).astype(np.float32)
    directions = (target.astype(np.float64) - origin).astype(np.float32)
    directions[~directions.any(axis=1)] = 1
    return Rays(origin, directions, np.full(count, np.inf, np.float32))


def grid_inputs(name: str, count: int, seed: int) -> tuple[np.ndarray, Rays]:
    """Triangles float32[n,3,3] and rays of one of SCENES; the same bits everywhere."""
    random = np.random.Generator(np.random.Philox(key=[seed, _STREAM + list(SCENES).index(name)]))
    triangles = SCENES[name](random)
    return triangles, aimed_rays(triangles, count, random)


def trace(prepared: Prepared, rays: Rays, tracer: str, intersector: Intersector, options: dict) -> Hits:
    """First hits by one tracer."""
    variant = Variant(tracer=tracer, intersector=intersector.name, options=options)
    return tracers.open_tracer(prepared, variant).timed(rays)[0]


def changed(hits: Hits, expected: Hits) -> np.ndarray:
    """bool[n]: the expected hit is lost, or its t or primitive differs in a bit."""
    return (hits.t.view(np.int32) != expected.t.view(np.int32)) | (hits.primitive != expected.primitive)


def grid_family(device: Device, intersector: Intersector, contraction: str, rays: int, seed: int) -> dict:
    """Forward and deferred tracing of `rays` rays, split over SCENES, against brute force by the same intersector.

    Returns {"rays", "leaks": rays for which a tracer loses a hit or differs in a bit of t or primitive, "cases"},
    the last by scene with its leaks by tracer. Raises DefrayError where the device cannot run the intersector.
    """
    found, count = {}, max(1, rays // len(SCENES))
    for name in SCENES:
        triangles, aimed = grid_inputs(name, count, seed)
        prepared = Prepared.on_device(Scene(name, triangles), device).with_structure(SPEC, "padded")
        mode = {"contraction": contraction}
        expected = trace(prepared, aimed, "brute", intersector, mode)
        lost = {
            tracer: changed(trace(prepared, aimed, tracer, intersector, mode | options), expected)
            for tracer, options in TRACERS.items()
        }
        found[name] = {
            "rays": count,
            "hits": int((expected.primitive >= 0).sum()),
            "leaks": int(np.logical_or.reduce(list(lost.values())).sum()),
            **{tracer: int(which.sum()) for tracer, which in lost.items()},
        }
    sums = {key: sum(case[key] for case in found.values()) for key in ("rays", "leaks")}
    return {**sums, "cases": found}


def grid_digest(rays: int, seed: int) -> str:
    """SHA-256 of the inputs of `grid_family`."""
    hashed = hashlib.sha256()
    for name in SCENES:
        triangles, aimed = grid_inputs(name, max(1, rays // len(SCENES)), seed)
        for array in (triangles, aimed.origins, aimed.directions, aimed.t_max):
            hashed.update(np.ascontiguousarray(array).tobytes())
    return hashed.hexdigest()
