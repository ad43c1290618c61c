"""The two-level grid, built on the device: count, scan, fill."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from harness.device.opened import Device
from harness.device.primitives import exclusive_scan, rank_scan
from harness.device.program import Program, build
from harness.device.runtime import cl
from harness.errors import DefrayError
from harness.spec.structure import Uniform
from harness.structures.contract import Structure, WalkWork
from harness.structures.device_scene import DeviceScene
from harness.structures.grids import (
    divided_bounds,
    fill_cells,
    grid_walk_work,
    memory_limit,
    overlap_defines,
    pad_of,
    vector,
)

BRICK = (4, 4, 2)  # leaf cells that share one word of occupancy bits
STEP_FLOPS = 9  # three planes of three
FINE = 1024  # leaf cells per axis from which on the size is estimated before building


def grid_box(scene: DeviceScene, spec: Uniform) -> tuple[np.ndarray, np.ndarray]:
    """Lower corner and cell size, float32[3] each: the scene's bounds and a margin."""
    return divided_bounds(scene, spec.resolution)


def pad_cells(spec: Uniform, cell_size: np.ndarray) -> np.ndarray:
    """`pad_of` a grid of one leaf resolution."""
    return pad_of(spec.resolution * float(cell_size.max()), cell_size)


def check_size(scene: DeviceScene, spec: Uniform) -> None:
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


@dataclass(frozen=True, eq=False, kw_only=True)
class UniformGrid(Structure):
    """The two-level grid of one resolution.

    `top_block` int32[top^3], -1 where a top cell is empty; `leaves` uint32[b,2], occupancy bits of bricks of 4x4x2
    leaf cells and the number of non-empty cells before them. `lower`, `cell_size`: float32[3]. `blocks`: top cells in
    use.
    """

    name = Uniform.name
    header = "structures/uniform_walk.clh"

    spec: Uniform
    lower: np.ndarray
    cell_size: np.ndarray
    top_block: cl.array.Array
    leaves: cl.array.Array
    blocks: int

    @classmethod
    def build(cls, scene: DeviceScene, spec: Uniform, overlap: str = "padded") -> UniformGrid:
        """Build the grid; raises DefrayError for one that needs too much memory."""
        check_size(scene, spec)
        started = time.perf_counter()
        builder = _UniformBuilder(scene, spec, overlap)
        top_block = builder.count_references()
        bricks, nonempty = builder.emit_references(top_block)
        entries = builder.entry_cell, builder.entry_primitive
        cell_start, references = fill_cells(scene, builder.program, entries, builder.references, bricks, nonempty)
        scene.device.queue.finish()
        return cls(
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
            overlap=overlap,
        )

    @property
    def arguments(self) -> tuple:
        """Tables of both levels, lower corner, cells per scene unit."""
        return self.top_block, self.leaves, vector(self.lower), vector(1 / self.cell_size)

    @property
    def defines(self) -> dict[str, int]:
        """The resolution, fixed when kernels are built."""
        return walk_defines(self.spec)

    @property
    def table_bytes(self) -> int:
        """Of the tables of both levels."""
        return self.top_block.nbytes + self.leaves.nbytes

    @property
    def walk_work(self) -> WalkWork:
        """An entry of the first level, and of the second a brick."""
        return grid_walk_work(STEP_FLOPS, self.top_block.nbytes, self.leaves.nbytes)

    @property
    def most_cells_met(self) -> int:
        """A ray crosses each plane of the grid once at most."""
        return 3 * self.spec.resolution

    def describe(self) -> dict:
        """As of any structure; `cells` are the leaf cells of all top cells in use."""
        return {**super().describe(), "cells": self.blocks * self.spec.leaf_per_top**3}


STRUCTURE = UniformGrid


def walk_defines(spec: Uniform) -> dict[str, int]:
    """Definitions that fix the walk to one grid resolution."""
    return {"TOP": spec.top, "LEAF_PER_TOP": spec.leaf_per_top}


class _UniformBuilder:
    """Arrays that live from one step of the build to the next."""

    def __init__(self, scene: DeviceScene, spec: Uniform, overlap: str):
        self.scene, self.spec, self.device = scene, spec, scene.device
        self.queue = scene.device.queue
        self.lower, self.cell_size = grid_box(scene, spec)
        chosen, self.pad = overlap_defines(overlap, pad_cells(spec, self.cell_size))
        self.program: Program = build(
            scene.device,
            "structures/uniform_build.cl",
            "structures/cells.cl",
            structure=UniformGrid.header,
            defines=walk_defines(spec) | chosen,
        )
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


def bricks_per_block(spec: Uniform) -> int:
    """Words of occupancy of one block."""
    per_axis = [-(-spec.leaf_per_top // size) for size in BRICK]
    return per_axis[0] * per_axis[1] * per_axis[2]
