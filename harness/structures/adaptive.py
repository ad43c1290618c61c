"""The adaptive grid: every top cell has its own number of leaf cells, by its number of triangles.

Top cells are nearly cubic and their number follows the triangles', as do the leaf cells of each (Kalojanov, Billeter
& Slusallek 2011, with the exponents of Ize 2007). Built on the device; the host only chooses the levels.
"""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass

import numpy as np

from harness.device.primitives import number_scan, offsets
from harness.device.program import build
from harness.device.runtime import cl
from harness.errors import DefrayError
from harness.spec.structure import MOST_ADAPTIVE_TOP, Adaptive
from harness.structures.contract import Structure, WalkWork
from harness.structures.device_scene import DeviceScene
from harness.structures.grids import (
    divided_bounds,
    fill_cells,
    grid_walk_work,
    memory_limit,
    overlap_defines,
    pad_of,
    padded_bounds,
    vector,
)

TOP_DENSITY = 0.0625  # top cells per triangle
DENSITY = 0.3  # leaf cells per triangle of a top cell, unless the spec says otherwise
MOST_TOP_CELLS = 1 << 24
MOST_LEAVES = 1 << 28  # a top cell's first leaf cell is kept in 28 bits
STEP_FLOPS = 39  # three planes of three, sliding along the cube three of two, the box three of eight
EMPTY = -(1 << 31)  # an empty cell's entry before its eight codes are written
OCTANTS = 8
UNUSED = 1 << 20  # farther than any cell


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveGrid(Structure):
    """A grid whose second level follows the scene.

    `top_cells` int32[x*y*z]: first leaf cell << 3 | level of a top cell with 2^level leaf cells per axis, or negative
    where it is empty. `leaves` int32[leaf_cells*2]: a leaf cell's number among the non-empty ones, or negative, and
    the box around what lies in it. Negative entries hold how far empty space goes, for each octant
    (kernels/structures/adaptive_walk.clh). `lower`, `cell_size`: float32[3], of the finest level. `shape`: top cells
    along x, y, z, and the finest level. `blocks`: top cells in use, `leaf_cells` those of all of them, `top_counts`
    int[blocks] the triangles of each.
    """

    name = Adaptive.name
    header = "structures/adaptive_walk.clh"

    spec: Adaptive
    lower: np.ndarray
    cell_size: np.ndarray
    top_cells: cl.array.Array
    leaves: cl.array.Array
    blocks: int
    shape: tuple[int, int, int, int]
    density: float
    leaf_cells: int
    top_counts: np.ndarray

    @classmethod
    def build(cls, scene: DeviceScene, spec: Adaptive, overlap: str = "padded") -> AdaptiveGrid:
        """Build the grid; raises DefrayError for one that needs too much memory."""
        started = time.perf_counter()
        builder = _AdaptiveBuilder(scene, spec, overlap)
        counts = builder.list_by_top_cell()
        top_cells = builder.choose_levels(counts)
        leaves, nonempty = builder.list_by_leaf_cell(top_cells)
        entries = builder.reference_cell, builder.reference_primitive
        cell_start, references = fill_cells(scene, builder.program, entries, builder.references, leaves, nonempty)
        builder.code_empty_leaves(top_cells, leaves)
        leaves = builder.bound_cells(top_cells, leaves, cell_start, references)
        scene.device.queue.finish()
        return cls(
            spec=spec,
            lower=builder.lower,
            cell_size=builder.cell_size,
            top_cells=top_cells,
            leaves=leaves,
            cell_start=cell_start,
            references=references,
            blocks=builder.blocks,
            nonempty=nonempty,
            build_seconds=time.perf_counter() - started,
            overlap=overlap,
            shape=tuple(int(v) for v in builder.shape),
            density=builder.density,
            leaf_cells=builder.cells,
            top_counts=counts[counts > 0],
        )

    @functools.cached_property
    def counted(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of triangles that top cells in use have, int[n], and how many cells have each."""
        return np.unique(self.top_counts, return_counts=True)

    @property
    def arguments(self) -> tuple:
        """Tables of both levels, lower corner, cells per scene unit, shape."""
        box = vector(self.lower), vector(1 / self.cell_size)
        return self.top_cells, self.leaves, *box, np.array(self.shape, np.int32)

    @property
    def table_bytes(self) -> int:
        """Of the tables of both levels."""
        return table_bytes(self.top_cells.nbytes, self.leaf_cells)

    @property
    def bytes(self) -> int:
        """Bytes of all arrays."""
        return sum(array.nbytes for array in (self.top_cells, self.leaves, self.cell_start, self.references))

    @property
    def walk_work(self) -> WalkWork:
        """An entry of the first level, and of the second a leaf cell's number and box."""
        return grid_walk_work(STEP_FLOPS, self.top_cells.nbytes, self.leaves.nbytes)

    @property
    def most_cells_met(self) -> int:
        """A ray crosses each plane of the finest level once at most."""
        return sum(self.shape[:3]) << self.shape[3]

    def describe(self) -> dict:
        """As of any structure, with the numbers of top cells that the scene has led to."""
        found = {"top": max(self.shape[:3]), "cells": self.leaf_cells, "density": self.density}
        return {**super().describe(), **found, "resolution": list(self.shape[:3])}


STRUCTURE = AdaptiveGrid


def table_bytes(top_bytes: int, cells: float) -> float:
    """Bytes of both levels' tables: a leaf cell has its number and its box."""
    return top_bytes + 8 * cells


def top_shape(extent: np.ndarray, triangles: int, top: int = 0) -> np.ndarray:
    """Nearly cubic top cells along each axis, int[3], of a box of `extent` float64[3].

    `top` along the longest axis; 0: TOP_DENSITY cells a triangle.
    """
    if top:
        size = extent.max() / top
        return np.clip(np.rint(extent / size), 1, top).astype(np.int64)
    per_unit = np.cbrt(TOP_DENSITY * triangles / extent.prod())
    return np.clip(np.floor(extent * per_unit), 1, MOST_ADAPTIVE_TOP).astype(np.int64)


def levels_of(counts: np.ndarray, density: float, finest: int) -> np.ndarray:
    """Level of each top cell from its triangles int[n]: 2^level nearest to the cube root of density * triangles."""
    wanted = np.log2(np.maximum(np.cbrt(density * counts), 1))
    return np.clip(np.rint(wanted), 0, finest).astype(np.int64)


class _AdaptiveBuilder:
    """Arrays that live from one step of the build to the next."""

    def __init__(self, scene: DeviceScene, spec: Adaptive, overlap: str):
        self.scene, self.spec, self.device, self.queue = scene, spec, scene.device, scene.device.queue
        self.density = DENSITY if spec.density is None else spec.density
        extent = padded_bounds(scene)[1]
        self.tops, self.finest = top_shape(extent, scene.active_count, spec.top), spec.leaf.bit_length() - 1
        if self.tops.prod() > MOST_TOP_CELLS:
            raise DefrayError(f"grid {spec} has {self.tops.prod():,} top cells; at most {MOST_TOP_CELLS:,} do")
        self.shape = np.array([*self.tops, self.finest], np.int32)
        self.lower, self.cell_size = divided_bounds(scene, self.tops << self.finest)
        defines, self.pad = overlap_defines(overlap, pad_of(extent.max(), self.cell_size))
        self.cells = 0
        self.program = build(
            self.device,
            "structures/adaptive_build.cl",
            "structures/cells.cl",
            structure=AdaptiveGrid.header,
            defines=defines,
        )

    def _triangle_arguments(self) -> tuple:
        return self.scene.triangles, vector(self.lower), vector(1 / self.cell_size), self.pad, self.shape

    def list_by_top_cell(self) -> np.ndarray:
        """An entry for each triangle and top cell it overlaps; returns the triangles of every top cell, int[n]."""
        scene, queue = self.scene, self.queue
        start = cl.array.empty(queue, scene.active_count, np.uint32)
        active = (scene.active_count, scene.active)
        self.program.launch("count_top", scene.active_count, *active, *self._triangle_arguments(), start)
        self.entries = offsets(self.device, start)
        self._check_memory(8 * self.entries, 4 * self.entries)
        self.entry_top, self.entry_primitive = (
            cl.array.empty(queue, max(self.entries, 1), np.int32) for _ in range(2)
        )
        counts = cl.array.zeros(queue, int(self.tops.prod()), np.int32)
        outputs = (self.entry_top, self.entry_primitive, counts)
        self.program.launch("emit_top", scene.active_count, *active, *self._triangle_arguments(), start, *outputs)
        return counts.get()

    def choose_levels(self, counts: np.ndarray) -> cl.array.Array:
        """Level and first leaf cell of every top cell in use, and how far empty space goes from the others."""
        used = counts > 0
        level = levels_of(counts, self.density, self.finest)
        cells = np.where(used, 8**level, 0)
        self.blocks, self.cells = int(used.sum()), int(cells.sum())
        self._check_memory(13 * self.cells, 8 * self.cells)
        first = np.cumsum(cells) - cells
        top_cells = cl.array.to_device(self.queue, np.where(used, first << 3 | level, EMPTY).astype(np.int32))
        self._code_empty_top_cells(used, top_cells)
        return top_cells

    def _code_empty_top_cells(self, used: np.ndarray, top_cells: cl.array.Array) -> None:
        """Distance of every top cell to the next one in use ahead along each octant, coded into the empty ones."""
        start = cl.array.to_device(self.queue, np.where(used, 0, UNUSED).astype(np.int32))
        rooms = [cl.array.empty_like(start) for _ in range(2)]
        for octant in range(OCTANTS):
            near, stride = start, 1
            for axis, length in enumerate(map(int, self.tops)):
                towards, far = 1 if octant >> axis & 1 else -1, rooms[axis % 2]
                self.program.launch("spread_distance", len(used), len(used), length, stride, towards, near, far)
                near, stride = far, stride * length
            self.program.launch("code_top_cells", len(used), len(used), octant, near, top_cells)

    def list_by_leaf_cell(self, top_cells: cl.array.Array) -> tuple[cl.array.Array, int]:
        """An entry for each reference; returns the leaf cells, numbered or EMPTY, and how many are not empty."""
        queue, program = self.queue, self.program
        start = cl.array.empty(queue, max(self.entries, 1), np.uint32)
        entries = np.uint32(self.entries), self.entry_top, self.entry_primitive
        inputs = (*entries, *self._triangle_arguments(), top_cells)
        program.launch("count_leaves", self.entries, *inputs, start)
        self.references = offsets(self.device, start)
        self._check_memory(12 * self.references + 13 * self.cells, 4 * self.references)
        leaves = cl.array.zeros(queue, max(self.cells, 1), np.int32)
        self.reference_cell = cl.array.empty(queue, max(self.references, 1), np.uint32)
        self.reference_primitive = cl.array.empty(queue, max(self.references, 1), np.int32)
        outputs = (leaves, self.reference_cell, self.reference_primitive)
        program.launch("emit_leaves", self.entries, *inputs, start, *outputs)
        del self.entry_top, self.entry_primitive
        total = cl.array.zeros(queue, 1, np.int32)
        number_scan(self.device, EMPTY)(leaves, total)
        return leaves, int(total.get()[0])

    def code_empty_leaves(self, top_cells: cl.array.Array, leaves: cl.array.Array) -> None:
        """How far empty space goes from the empty leaf cells, within their top cell."""
        edges = cl.array.empty(self.queue, max(self.cells, 1), np.uint8)
        self.program.launch("code_leaves", len(top_cells), len(top_cells), top_cells, leaves, edges)

    def bound_cells(self, top_cells, leaves, cell_start, references) -> cl.array.Array:
        """The leaf cells as the walk reads them, each with the box around what lies in it."""
        walked = cl.array.empty(self.queue, 2 * max(self.cells, 1), np.int32)
        inputs = *self._triangle_arguments(), top_cells, leaves, cell_start, references
        self.program.launch("bound_cells", len(top_cells), len(top_cells), *inputs, walked)
        return walked

    def _check_memory(self, need: int, largest: int) -> None:
        """Refuse what the device cannot hold, before it is asked for."""
        limit = memory_limit(self.device)
        too_many = self.cells >= MOST_LEAVES or largest >= 2**33
        if too_many or need > limit or largest > self.device.max_allocation_bytes:
            raise DefrayError(
                f"grid {self.spec} needs {need / 2**30:.1f} GiB; the limit here is {limit / 2**30:.1f} GiB; "
                "a lower density or fewer top cells would do"
            )
