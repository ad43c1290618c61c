"""What grids share: padded bounds, the overlap test's pad, and lists of triangles by leaf cell."""

from __future__ import annotations

import numpy as np

from harness.device.opened import Device
from harness.device.primitives import exclusive_scan
from harness.device.program import Program
from harness.device.runtime import cl
from harness.spec.structure import OVERLAPS
from harness.structures.contract import WalkWork
from harness.structures.device_scene import DeviceScene

PAD_ULP = 32  # triangle-cell overlap is tested with cells grown by this many float32 ulp of the largest extent
AXIS_FLOPS = 12  # of a ray's three axes in leaf cells, once a ray and wave: three flops and a division each
START_FLOPS = 4 + AXIS_FLOPS + 18 + 6  # scaling by a power of two, axes, six planes of the bounds, entry position
MARGIN = 2.0**-8  # a grid is larger than the scene by this part of its largest extent, on every side


def vector(values) -> np.ndarray:
    """A float3 kernel argument."""
    return np.array([*values, 0], np.float32)


def overlap_defines(overlap: str, pad: np.ndarray) -> tuple[dict[str, int], np.ndarray]:
    """Definitions that choose the overlap test, and its pad: `pad`, a float3, for the padded one, 0 for others."""
    if overlap == "padded":
        return {}, pad
    return {"OVERLAP_TEST": OVERLAPS.index(overlap)}, vector(np.zeros(3))


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


def grid_walk_work(step_flops: int, first_level: int, second_level: int) -> WalkWork:
    """What a walk through a grid computes and reads; the levels' tables in bytes."""
    return WalkWork(START_FLOPS, AXIS_FLOPS, step_flops, ((first_level, 4), (second_level, 8)))
