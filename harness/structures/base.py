"""What structures share: the scene on the device, its padded bounds, lists of triangles by cell."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from harness.data import check_scale
from harness.device.opened import Device
from harness.device.primitives import exclusive_scan
from harness.device.program import Program, build
from harness.device.runtime import cl
from harness.errors import DefrayError
from harness.reference.exact import zero_area
from harness.spec.intersectors import Intersector
from harness.spec.structure import GridSpec

PAD_ULP = 32  # triangle-box overlap is tested with cells grown by this many float32 ulp of the largest extent
MARGIN = 2.0**-8  # the grid is larger than the scene by this part of its largest extent, on every side


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


def vector(values) -> np.ndarray:
    """A float3 kernel argument."""
    return np.array([*values, 0], np.float32)


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
        program = build(scene.device, "tracers/precompute.cl", intersector=intersector.file, defines=defines)
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


def pad_of(extent: float, cell_size: np.ndarray) -> np.ndarray:
    """By how many cells of `cell_size` float32[3] the padded overlap test grows one on every side; a float3.

    `extent`: the grid's largest, in scene units.
    """
    return vector(PAD_ULP * 2.0**-24 * extent / cell_size)


def memory_limit(device: Device) -> int:
    """Bytes a grid and its building may take."""
    return min(device.memory_bytes, 16 * 2**30)


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


def walk_defines(spec: GridSpec) -> dict[str, int]:
    """Definitions that fix the walk to one grid resolution."""
    return {"TOP": spec.top, "LEAF_PER_TOP": spec.leaf_per_top}
