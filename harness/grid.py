"""The two-level grid, built on the device: count, scan, fill."""

from __future__ import annotations

import functools
import math
import time
from dataclasses import dataclass, field

import numpy as np

from harness.data import GridSpec
from harness.device import Device
from harness.errors import DefrayError, known
from harness.exact import zero_area
from harness.intersectors import Intersector
from harness.program import Program, build
from harness.runtime import cl
from harness.scene import check_scale
from harness.spec import check_grid

BRICK = (4, 4, 2)  # leaf cells that share one word of occupancy bits
PAD_ULP = 32  # triangle-box overlap is tested with cells grown by this many float32 ulp of the largest extent
BINNINGS = ("padded", "closed", "open", "box")  # overlap tests; the order is that of kernels/grid_build.cl
MARGIN = 2.0**-8  # the grid is larger than the scene by this part of its largest extent, on every side
FINE = 1024  # leaf cells per axis from which on the size is estimated before building


@dataclass(frozen=True, eq=False)
class DeviceScene:
    """Triangles on the device. `active`: the triangles that have an area, in ascending order.

    `triangles` float32[n*9], `active` int32[m]; `lower`, `upper` float64[3] bound the triangles.
    `stored` keeps the triangles in the form that the latest precomputing intersector wants, float32[n*12].
    """

    device: Device
    triangles: cl.array.Array
    active: cl.array.Array
    active_count: int
    lower: np.ndarray
    upper: np.ndarray
    stored: dict = field(default_factory=dict, repr=False)


@dataclass(frozen=True, eq=False)
class Grid:
    """Two-level grid on the device.

    `top_block` int32[top^3], -1 where a top cell is empty; `leaves` uint32[b,2], occupancy bits of bricks of 4x4x2
    leaf cells and the number of non-empty cells before them; `cell_start` int32[nonempty+1], `references` int32[r]:
    triangles of each non-empty cell in ascending order. `lower`, `cell_size`: float32[3]. `binning`: the
    overlap test that filled it, one of BINNINGS.
    """

    spec: GridSpec
    lower: np.ndarray
    cell_size: np.ndarray
    top_block: cl.array.Array
    leaves: cl.array.Array
    cell_start: cl.array.Array
    references: cl.array.Array
    blocks: int
    nonempty: int
    build_seconds: float
    binning: str = "padded"

    @property
    def arguments(self) -> tuple:
        """The grid as kernel arguments, in the order of GRID_ARGUMENTS."""
        return self.top_block, self.leaves, vector(self.lower), vector(1 / self.cell_size)

    @property
    def defines(self) -> dict[str, int]:
        """Compile-time shape of the walk."""
        return walk_defines(self.spec)

    @property
    def bytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in (self.top_block, self.leaves, self.cell_start, self.references))

    def describe(self) -> dict:
        """The `grid` part of a record."""
        return {
            "top": self.spec.top,
            "leaf": self.spec.leaf,
            "reading": self.spec.reading,
            "cells": self.blocks * self.spec.leaf_per_top**3,
            "nonempty": self.nonempty,
            "references": len(self.references) if self.nonempty else 0,
            "bytes": self.bytes,
            "build_seconds": self.build_seconds,
        }


def vector(values) -> np.ndarray:
    """A float3 kernel argument."""
    return np.array([*values, 0], np.float32)


def walk_defines(spec: GridSpec) -> dict[str, int]:
    """Definitions that fix the walk to one grid resolution."""
    return {"TOP": spec.top, "LEAF_PER_TOP": spec.leaf_per_top}


def auto_spec(triangles: int) -> GridSpec:
    """A total resolution for a scene of that many triangles: the power of two nearest to cbrt(5 N) an axis.

    5 cells a triangle is the density of Kalojanov & Slusallek 2009 for one uniform level.
    """
    leaf = 2 ** max(3, round(math.log2(max(triangles, 1) * 5) / 3))
    return GridSpec(top=8, leaf=min(leaf, 1024), reading="total")


def upload_scene(device: Device, triangles: np.ndarray, active: np.ndarray | None = None) -> DeviceScene:
    """Copy triangles float32[n,3,3] to the device; zero-area ones stay in the numbering but are not active.

    `active`: bool[n], the triangles that have an area, where it is known already.
    """
    active = np.flatnonzero(~zero_area(triangles) if active is None else active).astype(np.int32)
    if not len(active):
        raise DefrayError("the scene has no triangle with an area (corners may coincide once rounded to float32)")
    check_scale(triangles)
    if triangles.nbytes > device.max_allocation_bytes:
        need, most = triangles.nbytes / 2**30, device.max_allocation_bytes / 2**30
        raise DefrayError(f"the triangles need {need:.1f} GiB in one buffer; {device.name} allows {most:.1f}")
    corners = triangles[active]
    return DeviceScene(
        device=device,
        triangles=cl.array.to_device(device.queue, np.ascontiguousarray(triangles, np.float32).ravel()),
        active=cl.array.to_device(device.queue, active),
        active_count=len(active),
        lower=corners.min(axis=(0, 1)).astype(np.float64),
        upper=corners.max(axis=(0, 1)).astype(np.float64),
    )


def stored_triangles(scene: DeviceScene, intersector: Intersector, defines: dict[str, int]) -> cl.array.Array:
    """The triangles as `intersector` stores them: the vertices float32[n*9], or its planes float32[n*12]."""
    if not intersector.precomputes:
        return scene.triangles
    key = (intersector.name, *defines)
    if key not in scene.stored:
        count = scene.triangles.size // 9
        stored = cl.array.empty(scene.device.queue, 12 * count, np.float32)
        program = build(scene.device, "precompute.cl", intersector=intersector.file, defines=defines)
        program.launch("precompute_triangles", count, count, scene.triangles, stored)
        scene.stored.clear()
        scene.stored[key] = stored
    return scene.stored[key]


def padded_bounds(scene: DeviceScene) -> tuple[np.ndarray, np.ndarray]:
    """The scene's bounds and a margin: lower corner float32[3] and, from there, the extent float64[3]."""
    extent = scene.upper - scene.lower
    largest = max(extent.max(), 1e-6 * np.abs(scene.upper).max(), 1e-30)
    # Also along an axis in which the scene is flat: rounding is that of the largest extent.
    margin = largest * MARGIN
    lower = np.nextafter((scene.lower - margin).astype(np.float32), np.float32(-np.inf))
    return lower, scene.upper + margin - lower.astype(np.float64)


def divided_bounds(scene: DeviceScene, cells: int | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower corner and cell size, float32[3] each, for that many cells along each axis."""
    lower, extent = padded_bounds(scene)
    return lower, np.nextafter((extent / cells).astype(np.float32), np.float32(np.inf))


def grid_box(scene: DeviceScene, spec: GridSpec) -> tuple[np.ndarray, np.ndarray]:
    """Lower corner and cell size, float32[3] each: the scene's bounds and a margin."""
    return divided_bounds(scene, spec.resolution)


def pad_of(extent: float, cell_size: np.ndarray) -> np.ndarray:
    """By how many cells of `cell_size` float32[3] the padded overlap test grows one on every side; a float3.

    `extent`: the grid's largest, in scene units.
    """
    return vector(PAD_ULP * 2.0**-24 * extent / cell_size)


def pad_cells(spec: GridSpec, cell_size: np.ndarray) -> np.ndarray:
    """`pad_of` a grid of one leaf resolution."""
    return pad_of(spec.resolution * float(cell_size.max()), cell_size)


def memory_limit(device: Device) -> int:
    """Bytes a grid and its building may take."""
    return min(device.memory_bytes, 16 * 2**30)


def check_size(scene: DeviceScene, spec: GridSpec) -> None:
    """Refuse a fine grid that cannot fit, before the work of finding out; raises DefrayError with a remedy.

    Lower bounds: a triangle overlaps at least as many cells as its projection along an axis covers squares, and a
    top cell that holds a corner of a triangle holds a block.
    """
    if spec.resolution < FINE:
        return
    lower, size = (values.astype(np.float64) for values in grid_box(scene, spec))
    triangles, references, used = scene.triangles.get().reshape(-1, 3, 3), 0.0, np.zeros(spec.top**3, bool)
    for first in range(0, len(triangles), 1 << 20):
        corners = (triangles[first : first + (1 << 20)] - lower) / size
        area = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).max(axis=1) / 2
        references += np.maximum(area, 1).sum()
        top = np.clip(corners.reshape(-1, 3) / spec.leaf_per_top, 0, spec.top - 1).astype(np.int64)
        used[(top[:, 2] * spec.top + top[:, 1]) * spec.top + top[:, 0]] = True
    blocks = 12.0 * used.sum() * bricks_per_block(spec)
    need, limit = 12 * references + blocks, memory_limit(scene.device)
    if need > limit:
        share = min(math.sqrt(limit / (24 * references)), math.cbrt(limit / (2 * blocks)))
        fits = max(int(spec.leaf * share) // spec.top, 1) * spec.top
        raise DefrayError(
            f"grid {spec} needs at least {need / 2**30:.1f} GiB; the limit here is {limit / 2**30:.1f} GiB, "
            f"which a leaf of about {fits} would meet"
        )


def build_grid(scene: DeviceScene, spec: GridSpec, binning: str = "padded") -> Grid:
    """Build the grid; raises DefrayError for a bad resolution or one that needs too much memory.

    `binning`: "padded", the default, is a closed separating-axis test with cells grown by PAD_ULP; "closed" the
    same without, "open" with strict inequalities, "box" the bounding box rounded down. Only the first loses no ray.
    """
    if binning not in BINNINGS:
        raise known("binning", binning, BINNINGS)
    check_grid(spec)
    if spec.reading == "adaptive":
        from harness.adaptive import build_adaptive

        return build_adaptive(scene, spec, binning)
    check_size(scene, spec)
    started = time.perf_counter()
    builder = _Builder(scene, spec, binning)
    top_block = builder.count_references()
    bricks, nonempty = builder.emit_references(top_block)
    entries = builder.entry_cell, builder.entry_primitive
    cell_start, references = fill_cells(scene, builder.program, entries, builder.references, bricks, nonempty)
    scene.device.queue.finish()
    return Grid(
        spec=spec,
        lower=builder.lower,
        cell_size=builder.cell_size,
        top_block=top_block,
        leaves=bricks,
        cell_start=cell_start,
        references=references,
        blocks=builder.blocks,
        nonempty=nonempty,
        build_seconds=time.perf_counter() - started,
        binning=binning,
    )


class _Builder:
    """Arrays that live from one step of the build to the next."""

    def __init__(self, scene: DeviceScene, spec: GridSpec, binning: str):
        self.scene, self.spec, self.device = scene, spec, scene.device
        self.queue = scene.device.queue
        self.lower, self.cell_size = grid_box(scene, spec)
        defines, self.pad = walk_defines(spec), pad_cells(spec, self.cell_size)
        if binning != "padded":
            defines["BINNING"], self.pad = BINNINGS.index(binning), vector(np.zeros(3))
        self.program: Program = build(scene.device, "grid_build.cl", "grid_cells.cl", defines=defines)
        self.blocks = 0
        self.references = 0

    def _triangle_arguments(self) -> tuple:
        scene, inverse = self.scene, vector(1 / self.cell_size)
        return scene.active_count, scene.active, scene.triangles, vector(self.lower), inverse, self.pad

    def count_references(self) -> cl.array.Array:
        """First pass: references of every triangle; numbers the top cells that hold any."""
        scene, queue = self.scene, self.queue
        self.reference_start = cl.array.zeros(queue, scene.active_count, np.uint32)
        top_used = cl.array.zeros(queue, self.spec.top**3, np.int32)
        self.program.launch(
            "count_references", scene.active_count, *self._triangle_arguments(), self.reference_start, top_used
        )
        self.references = int(cl.array.sum(self.reference_start, dtype=np.int64).get())
        exclusive_scan(self.device)(self.reference_start)
        used = top_used.get() > 0
        self.blocks = int(used.sum())
        self._check_memory()
        block = np.where(used, np.cumsum(used) - 1, -1).astype(np.int32)
        return cl.array.to_device(queue, block)

    def _check_memory(self) -> None:
        """Say in advance what the grid needs, and refuse what the device cannot hold."""
        bricks = self.blocks * bricks_per_block(self.spec)
        brick_bytes, entry_bytes = 12 * bricks, 12 * self.references
        need = brick_bytes + entry_bytes
        largest = max(8 * bricks, 4 * self.references)
        limit = memory_limit(self.device)
        if bricks >= 2**27 or self.references >= 2**31 or need > limit or largest > self.device.max_allocation_bytes:
            raise DefrayError(
                f"grid {self.spec} needs {need / 2**30:.1f} GiB ({self.references:,} references, "
                f"{bricks * 32:,} leaf cells); the limit here is {limit / 2**30:.1f} GiB"
            )

    def emit_references(self, top_block: cl.array.Array) -> tuple[cl.array.Array, int]:
        """Second pass: one entry a reference and the occupancy bits; returns bricks and non-empty cells."""
        queue = self.queue
        bricks = self.blocks * bricks_per_block(self.spec)
        occupancy = cl.array.zeros(queue, max(bricks, 1), np.uint32)
        self.entry_cell = cl.array.empty(queue, max(self.references, 1), np.uint32)
        self.entry_primitive = cl.array.empty(queue, max(self.references, 1), np.int32)
        self.program.launch(
            "emit_references",
            self.scene.active_count,
            *self._triangle_arguments(),
            self.reference_start,
            top_block,
            occupancy,
            self.entry_cell,
            self.entry_primitive,
        )
        del self.reference_start
        return rank_bricks(self.device, occupancy)


def rank_bricks(device: Device, occupancy: cl.array.Array) -> tuple[cl.array.Array, int]:
    """Bricks, uint32[b,2], of occupancy words uint32[b], and the number of non-empty cells."""
    bricks = cl.array.empty(device.queue, 2 * len(occupancy), np.uint32)
    total = cl.array.zeros(device.queue, 1, np.uint32)
    rank_scan(device)(occupancy, bricks, total)
    return bricks, int(total.get()[0])


def fill_cells(
    scene: DeviceScene, program: Program, entries: tuple, count: int, leaves: cl.array.Array, nonempty: int
) -> tuple[cl.array.Array, cl.array.Array]:
    """Cell starts int32[nonempty+1] and references int32[count], ascending in each cell, by counting sort.

    `entries`: leaf cell of each reference (of a brick, brick * 32 + bit), uint32[count], overwritten, and its
    triangle, int32[count]. `leaves`: what tells a leaf cell's number.
    """
    queue, (cell, primitive) = scene.device.queue, entries
    cell_start = cl.array.zeros(queue, nonempty + 1, np.int32)
    program.launch("count_cells", count, np.uint32(count), leaves, cell, cell_start)
    exclusive_scan(scene.device)(cell_start)
    cursor, references = cell_start.copy(), cl.array.empty(queue, max(count, 1), np.int32)
    program.launch("fill_cells", count, np.uint32(count), cell, primitive, cursor, references)
    program.launch("sort_cells", nonempty, nonempty, cell_start, references)
    return cell_start, references


def bricks_per_block(spec: GridSpec) -> int:
    """Words of occupancy of one block."""
    per_axis = [-(-spec.leaf_per_top // size) for size in BRICK]
    return per_axis[0] * per_axis[1] * per_axis[2]


@functools.cache
def exclusive_scan(device: Device):
    """In-place exclusive prefix sum of a 32-bit array."""
    from pyopencl.scan import ExclusiveScanKernel

    kernels = {
        np.dtype(dtype): ExclusiveScanKernel(device.context, dtype, "a+b", neutral="0")
        for dtype in (np.int32, np.uint32)
    }
    return lambda array: kernels[array.dtype](array)


@functools.cache
def rank_scan(device: Device):
    """Occupancy words to (occupancy, non-empty cells before) pairs, and the total."""
    from pyopencl.scan import GenericScanKernel

    kernel = GenericScanKernel(
        device.context,
        np.uint32,
        arguments="__global uint *occupancy, __global uint *bricks, __global uint *total",
        input_expr="popcount(occupancy[i])",
        scan_expr="a+b",
        neutral="0",
        output_statement="""
            bricks[2 * i] = occupancy[i];
            bricks[2 * i + 1] = item - popcount(occupancy[i]);
            if (i == N - 1) total[0] = item;
        """,
    )
    return kernel
