"""The grid walk against its definition (families G1 and G2): no part of a ray's path may be stepped over.

A triangle is referenced in every cell that, grown by the pad of the overlap test, it touches. So a walk loses
nothing exactly if each point of the path lies in a visited cell grown by the pad. Cells are those of the grid's
float32 `lower` and `1 / cell_size` in exact arithmetic. Here they are intersected in float64 with the pad enlarged
by a bound of all rounding: a stretch reported as missed is missed in exact arithmetic too.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness.data import Rays
from harness.device.opened import Device
from harness.device.program import build
from harness.device.runtime import cl
from harness.spec.structure import Uniform
from harness.structures.uniform import UniformGrid, bricks_per_block, pad_cells

FAR = 16  # sizes of the grid; from about 64 on, the rounding of origins exceeds the pad
_CHUNK = 1 << 21  # visited cells on the host at once
# An offset or direction in cells takes 2 roundings, a plane's t 2 more, relative to |origin| + resolution.
_ROUNDING = 2.0**-48
_FAMILY = 3 << 32  # separates these random numbers from those of other ray sets with the same seed


@dataclass(frozen=True, eq=False)
class Coverage:
    """Of each ray: `stretches` int[n] of its path that no visited cell covers, and `longest` float64[n], in cells."""

    stretches: np.ndarray
    longest: np.ndarray


def solid_grid(device: Device, spec: Uniform, lower, cell_size, empty: np.ndarray | None = None) -> UniformGrid:
    """A grid without triangles whose leaf cells all count as non-empty, except in the `empty` top cells bool[top^3].

    All top cells share one block, so that it takes no room at any resolution.
    """
    empty = np.zeros(spec.top**3, bool) if empty is None else empty
    bricks = np.full((bricks_per_block(spec), 2), 0xFFFFFFFF, np.uint32)
    bricks[:, 1] = 32 * np.arange(len(bricks))
    return UniformGrid(
        spec=spec,
        lower=np.array(lower, np.float32),
        cell_size=np.array(cell_size, np.float32),
        top_block=cl.array.to_device(device.queue, np.where(empty, -1, 0).astype(np.int32)),
        leaves=cl.array.to_device(device.queue, bricks.ravel()),
        cell_start=cl.array.zeros(device.queue, 1, np.int32),
        references=cl.array.zeros(device.queue, 1, np.int32),
        blocks=1,
        nonempty=32 * len(bricks),
        build_seconds=0.0,
    )


def most_steps(spec: Uniform) -> int:
    """Steps that a walk may take: one plane after the other along each axis."""
    return 3 * spec.resolution


def walk(device: Device, grid: UniformGrid, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
    """Non-empty leaf cells each ray visits, int32[n,m], -1 beyond its last, and int32[n] its steps.

    Cells are numbered (z * resolution + y) * resolution + x. A walk that takes too many steps is cut off one step
    after the bound.
    """
    count, slots = len(rays), most_steps(grid.spec) + 1
    origins, directions = (
        cl.array.to_device(device.queue, np.ascontiguousarray(values, np.float32).ravel())
        for values in (rays.origins, rays.directions)
    )
    visited = cl.array.empty(device.queue, count * slots, np.int32)
    found, steps = (cl.array.empty(device.queue, count, np.int32) for _ in range(2))
    program = build(device, "studies/walk_cells.cl", structure=grid.header, defines=grid.defines)
    program.launch("walk_cells", count, *(count, origins, directions, *grid.arguments, slots, visited, found, steps))
    cells, found = visited.get().reshape(count, slots), found.get()
    cells = cells[:, : max(int(found.max()), 1)]
    return np.where(np.arange(cells.shape[1]) < found[:, None], cells, -1), steps.get()


def coverage(grid: UniformGrid, rays: Rays, visited: np.ndarray, pad: np.ndarray | None = None) -> Coverage:
    """What of each ray's path the `visited` cells int32[n,m] do not cover when grown by `pad` cells, float[3].

    Without `pad`, that of the padded overlap test. A path starts at the ray's origin; its part within the pad of
    the grid's surface, where no triangle lies, is not asked for. Empty top cells cover what they hold.
    """
    size = grid.spec.resolution
    inverse = (1 / grid.cell_size).astype(np.float64)
    origin = (rays.origins.astype(np.float64) - grid.lower) * inverse
    direction = rays.directions.astype(np.float64) * inverse
    pad = pad_cells(grid.spec, grid.cell_size)[:3].astype(np.float64) if pad is None else np.asarray(pad)
    grown = pad + _ROUNDING * (np.abs(origin) + size)
    first, last = box_interval([np.zeros((len(rays), 1))] * 3, size, origin, direction, -grown)
    first, last = np.maximum(first[:, 0], 0), last[:, 0]
    low = [visited % size, visited // size % size, visited // size**2]
    enter, leave = box_interval(low, 1, origin, direction, grown)
    enter[visited < 0] = leave[visited < 0] = -np.inf
    top, part = grid.spec.top, grid.spec.leaf_per_top
    empty = np.flatnonzero(grid.top_block.get() < 0)
    if len(empty):
        low = [(part * axis)[None] for axis in (empty % top, empty // top % top, empty // top**2)]
        more = box_interval(low, part, origin, direction, grown)
        enter, leave = np.hstack([enter, more[0]]), np.hstack([leave, more[1]])
    speed = np.sqrt((direction * direction).sum(axis=1))
    return uncovered_stretches(enter, leave, first, last, speed)


def box_interval(low, size: int, origin, direction, pad) -> tuple[np.ndarray, np.ndarray]:
    """t at which rays enter and leave boxes [low - pad, low + size + pad], float64[n,m]; -inf, -inf for a miss.

    `low`: three arrays [n,m] or [1,m]; `origin`, `direction`, `pad`: float64[n,3], in cells.
    """
    enter, leave = -np.inf, np.inf
    for axis in range(3):
        o, d, p = (values[:, axis, None] for values in (origin, direction, pad))
        below, above = low[axis] - p - o, low[axis] + size + p - o
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            a, b = below / d, above / d
        inside = (below <= 0) & (above >= 0)
        a = np.where(d == 0, np.where(inside, -np.inf, np.inf), a)
        b = np.where(d == 0, np.where(inside, np.inf, np.inf), b)
        enter, leave = np.maximum(enter, np.minimum(a, b)), np.minimum(leave, np.maximum(a, b))
    missed = ~(enter <= leave) | (enter == np.inf)
    return np.where(missed, -np.inf, enter), np.where(missed, -np.inf, leave)


def uncovered_stretches(enter, leave, first, last, speed) -> Coverage:
    """Stretches of [first, last] outside the union of the intervals [enter, leave]."""
    order = np.argsort(enter, axis=1, kind="stable")
    enter, leave = np.take_along_axis(enter, order, 1), np.take_along_axis(leave, order, 1)
    reach = np.maximum.accumulate(np.hstack([first[:, None], leave]), axis=1)
    start = np.minimum(np.hstack([enter, last[:, None]]), last[:, None])
    with np.errstate(invalid="ignore"):
        gap = np.where(start > reach, start - reach, 0) * speed[:, None]
    return Coverage((gap > 0).sum(axis=1), gap.max(axis=1))


def check_walk(device: Device, grid: UniformGrid, rays: Rays, pad=None) -> dict:
    """Walk all rays and count what is lost: rays, leaks (rays with an uncovered stretch), stretches, worst_chord
    (the longest, in cells), steps_over (rays that take more steps than there are planes)."""
    total = {"rays": len(rays), "leaks": 0, "stretches": 0, "worst_chord": 0.0, "steps_over": 0}
    chunk = max(1, _CHUNK // most_steps(grid.spec))
    for first in range(0, len(rays), chunk):
        part = rays[first : first + chunk]
        visited, steps = walk(device, grid, part)
        found = coverage(grid, part, visited, pad)
        total["leaks"] += int((found.stretches > 0).sum())
        total["stretches"] += int(found.stretches.sum())
        total["worst_chord"] = max(total["worst_chord"], float(found.longest.max()))
        total["steps_over"] += int((steps > most_steps(grid.spec)).sum())
    return total


@dataclass(frozen=True, eq=False)
class Lattice:
    """Where a grid lies: `lower` and `cell_size`, three float32 each; `empty`: the share of empty top cells."""

    spec: Uniform
    lower: tuple
    cell_size: tuple
    empty: float = 0.0

    def grid(self, device: Device, seed: int) -> UniformGrid:
        """The grid on the device, its empty top cells drawn by `seed`."""
        chance = generator(seed, 0).random(self.spec.top**3)
        return solid_grid(device, self.spec, self.lower, self.cell_size, chance < self.empty)

    def world(self, cells: np.ndarray) -> np.ndarray:
        """float64[n,3] from leaf cells to scene units."""
        return np.array(self.lower, np.float32) + cells * np.array(self.cell_size, np.float32).astype(np.float64)


def generator(seed: int, stream: int) -> np.random.Generator:
    """Random numbers of one case; `stream` tells the cases apart."""
    return np.random.Generator(np.random.Philox(key=[seed, _FAMILY + stream]))


def _rays(lattice: Lattice, origins: np.ndarray, directions: np.ndarray) -> Rays:
    """Rays from origins in leaf cells and directions in scene units."""
    count = len(origins)
    return Rays(
        lattice.world(origins).astype(np.float32),
        directions.astype(np.float32),
        np.full(count, np.inf, np.float32),
    )


def towards_edges(lattice: Lattice, random: np.random.Generator, count: int) -> Rays:
    """Half from inside the grid, half from up to half its size outside; half at random points, half at cell edges."""
    size = lattice.spec.resolution
    origins = size * random.random((count, 3))
    origins[::2] = 2 * origins[::2] - size / 2
    targets = size * random.random((count, 3))
    along = random.integers(3, size=count)
    on_edge = (random.random(count) < 0.5)[:, None] & (np.arange(3) != along[:, None])
    targets = np.where(on_edge, np.rint(targets), targets)
    rays = _rays(lattice, origins, np.ones((count, 3)))
    return Rays(rays.origins, (lattice.world(targets) - rays.origins).astype(np.float32), rays.t_max)


def from_afar(lattice: Lattice, random: np.random.Generator, count: int) -> Rays:
    """From up to 16 times the grid's size away, half at random points in it, half at cell edges."""
    size = lattice.spec.resolution
    near = towards_edges(lattice, random, count)
    targets = near.origins.astype(np.float64) + near.directions
    rays = _rays(lattice, size * (0.5 + FAR * (2 * random.random((count, 3)) - 1)), np.ones((count, 3)))
    return Rays(rays.origins, (targets - rays.origins).astype(np.float32), rays.t_max)


def _signs(random: np.random.Generator, count: int) -> np.ndarray:
    return 2.0 * random.integers(0, 2, (count, 3)) - 1


def along_axes(lattice: Lattice, random: np.random.Generator, count: int) -> Rays:
    """Axis-parallel, the other components 0.0 or -0.0; origins on cell planes along none, some or all axes."""
    size = lattice.spec.resolution
    origins, on_plane = size * random.random((count, 3)), random.random((count, 3)) < 0.5
    chosen = np.arange(3) == random.integers(3, size=count)[:, None]
    return _rays(lattice, np.where(on_plane, np.rint(origins), origins), chosen * _signs(random, count))


def in_planes(lattice: Lattice, random: np.random.Generator, count: int) -> Rays:
    """One component 0.0 or -0.0; half of the origins on a cell plane of that axis, so that the ray lies in it."""
    size = lattice.spec.resolution
    origins, on_plane = size * random.random((count, 3)), random.random((count, 3)) < 0.5
    flat = np.arange(3) == random.integers(3, size=count)[:, None]
    directions = np.where(flat, 0.0, random.random((count, 3))) * _signs(random, count)
    return _rays(lattice, np.where(on_plane, np.rint(origins), origins), directions)


def from_planes(lattice: Lattice, random: np.random.Generator, count: int) -> Rays:
    """Origins on cell planes, edges and corners; directions of any kind."""
    size = lattice.spec.resolution
    origins, on_plane = size * random.random((count, 3)), random.random((count, 3)) < 0.7
    directions = random.random((count, 3)) * _signs(random, count)
    return _rays(lattice, np.where(on_plane, np.rint(origins), origins), directions)


def through_corners(lattice: Lattice, random: np.random.Generator, count: int) -> Rays:
    """Diagonals of cells and of their faces, from corner to corner."""
    size = lattice.spec.resolution
    origins = random.integers(0, size + 1, (count, 3)).astype(np.float64)
    used = random.random((count, 3)) < 0.75
    used[~used.any(axis=1)] = True
    return _rays(lattice, origins, used * _signs(random, count) * np.array(lattice.cell_size))


def with_denormals(lattice: Lattice, random: np.random.Generator, count: int) -> Rays:
    """One or two components too small for a normal float32, the others ordinary."""
    size = lattice.spec.resolution
    origins, on_plane = size * random.random((count, 3)), random.random((count, 3)) < 0.5
    ordinary = np.arange(3) == random.integers(3, size=count)[:, None]
    ordinary |= random.random((count, 3)) < 0.25
    tiny = 2.0**-149 * random.integers(1, 1 << 22, (count, 3))
    directions = np.where(ordinary, random.random((count, 3)) + 0.01, tiny) * _signs(random, count)
    return _rays(lattice, np.where(on_plane, np.rint(origins), origins), directions)


_SIZES = (0.0137, 0.0171, 0.0093)  # no power of two, and different along each axis
_EVEN = Lattice(Uniform(8, 128), (-1, -1, -1), (2.0**-6,) * 3)
_UNEVEN = Lattice(Uniform(8, 128), (-0.37, 0.11, -2.3), _SIZES)
_SHIFTED = Lattice(Uniform(8, 128), (1000.1, -1000.2, 1000.3), _SIZES)
_FINE = Lattice(Uniform(8, 1024), (-0.37, 0.11, -2.3), _SIZES)
Maker = Callable[[Lattice, np.random.Generator, int], Rays]
G1: dict[str, tuple[Lattice, Maker]] = {
    "128, power-of-two cells": (_EVEN, towards_edges),
    "128": (_UNEVEN, towards_edges),
    "128, shifted by 1e3": (_SHIFTED, towards_edges),
    "128, from 16 sizes away": (_UNEVEN, from_afar),
    "128, half of the top cells empty": (
        Lattice(_UNEVEN.spec, _UNEVEN.lower, _UNEVEN.cell_size, 0.5),
        towards_edges,
    ),
    "1024": (_FINE, towards_edges),
    "1024, half of the top cells empty": (Lattice(_FINE.spec, _FINE.lower, _FINE.cell_size, 0.5), towards_edges),
}
G2: dict[str, tuple[Lattice, Maker]] = {
    f"{name}, {cells} cells": (lattice, maker)
    for cells, lattice in (("power-of-two", _EVEN), ("uneven", _UNEVEN))
    for name, maker in (
        ("signed zeros along an axis", along_axes),
        ("signed zeros in a plane", in_planes),
        ("origins on planes", from_planes),
        ("corner diagonals", through_corners),
        ("denormal components", with_denormals),
    )
}
FAMILIES = {"G1": G1, "G2": G2}


def case_rays(family: str, name: str, count: int, seed: int) -> Rays:
    """The rays of one case; the same bits everywhere."""
    lattice, maker = FAMILIES[family][name]
    return maker(lattice, generator(seed, 1 + list(FAMILIES[family]).index(name)), count)


def walk_cases(name: str, rays: int) -> dict[str, int]:
    """Rays of each case of family `name`, about `rays` together: fewer where cells are finer."""
    weights = {case: 1 / lattice.spec.resolution for case, (lattice, _) in FAMILIES[name].items()}
    total = sum(weights.values())
    return {case: max(1, round(rays * weight / total)) for case, weight in weights.items()}


def walk_family(device: Device, name: str, rays: int, seed: int) -> dict:
    """Check the walk on about `rays` rays of family `name`, "G1" or "G2".

    Returns {"rays", "leaks": rays with a stretch of path that no visited cell covers, "worst_chord": the longest
    such stretch in cells, "steps_over": rays with more than 3 steps per cell along an axis, "cases"}, the last by
    name of the case.
    """
    found = {}
    for case, count in walk_cases(name, rays).items():
        grid = FAMILIES[name][case][0].grid(device, seed)
        found[case] = check_walk(device, grid, case_rays(name, case, count, seed))
    sums = {key: sum(case[key] for case in found.values()) for key in ("rays", "leaks", "steps_over")}
    return {**sums, "worst_chord": max(case["worst_chord"] for case in found.values()), "cases": found}


def walk_digest(name: str, rays: int, seed: int) -> str:
    """SHA-256 of the rays of `walk_family`."""
    hashed = hashlib.sha256()
    for case, count in walk_cases(name, rays).items():
        part = case_rays(name, case, count, seed)
        for array in (part.origins, part.directions, part.t_max):
            hashed.update(np.ascontiguousarray(array).tobytes())
    return hashed.hexdigest()
