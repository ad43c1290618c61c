"""Deferred tracing with intersection binning: the paper's tracer (section 2).

A wave walks each unfinished ray through at most `wave` non-empty cells without testing a triangle, arranges
the ray-cell pairs so that pairs of one cell are adjacent, and intersects bin after bin.
"""

from __future__ import annotations

import functools
from typing import Literal

import numpy as np
from pydantic import Field, field_validator

from harness.data import Counters, Rays
from harness.device import Device
from harness.intersectors import LANES, Intersector
from harness.program import Program
from harness.runtime import cl
from harness.stopwatch import Stopwatch
from harness.tracers._base import COUNTERS, Batch, BatchTooLarge, DeviceOptions, DeviceTracer, Setting

ENDLESS = 1 << 30  # more non-empty cells than a ray can meet
LONGEST_WAVE = 4096  # cells; beyond, say `all`
RECORDED_TOGETHER = 8  # rays a lane that a work-item of kernels/traverse.cl records
SEGMENT = 32  # cells a ray that one recording pass remembers at most


class DeferredOptions(DeviceOptions):
    """`arrange`: walk twice (the paper) or walk once and remember; `wave`: non-empty cells a ray, or `all`; `growth`:
    times as many in each wave as in the one before; `pairs`: whether a bin holds the index of a ray, which the
    intersector gathers, or a copy of the ray."""

    arrange: Literal["two-pass", "record"] = "two-pass"
    wave: str = "4"
    compaction: bool = True
    pairs: Literal["index", "copy"] = "index"
    growth: int = Field(default=1, ge=1, le=64)

    @field_validator("wave")
    @classmethod
    def _positive_or_all(cls, wave: str) -> str:
        if wave != "all" and not (wave.isdigit() and 0 < int(wave) <= LONGEST_WAVE):
            raise ValueError(f"must be a whole number from 1 to {LONGEST_WAVE}, or 'all'")
        return wave

    @property
    def cells(self) -> int:
        """Non-empty cells a ray in one wave."""
        return ENDLESS if self.wave == "all" else int(self.wave)

    @property
    def pair_words(self) -> int:
        """32-bit words of a pair in its bin."""
        return 8 if self.pairs == "copy" else 1

    @property
    def defines(self) -> dict[str, int]:
        """Definitions for the kernels that write and read pairs."""
        return {"COPY_RAYS": 1} if self.pairs == "copy" else {}


class Deferred(DeviceTracer):
    """Walk, bin, intersect, compact; wave after wave until no ray is left."""

    name = "deferred"
    needs_grid = True
    Options = DeferredOptions
    start_stage = "traverse"
    warm_up_rays = 1 << 20  # PoCL compiles kernels anew for small launches, so few rays would warm only those

    def __init__(self, setting: Setting, intersector: Intersector | None, options: dict[str, str]):
        super().__init__(setting, intersector, options)
        self._rooms: dict[str, cl.array.Array] = {}

    def trace_batch(self, batch: Batch, watch: Stopwatch) -> None:
        """All waves of one batch."""
        queue = self.device.queue
        walk = self.program("traverse.cl", grid=True, walk_lanes=self.lanes, defines=self.options.defines)
        bins = _Bins(self)
        arrange = _TwoPass if self.options.arrange == "two-pass" else _Record
        active, active_count = cl.array.arange(queue, batch.count, dtype=np.int32), batch.count
        spare = self.room("spare", batch.count)
        length = self.options.cells
        while active_count:
            arranged = arrange(self, batch, walk, bins, active, active_count, length)
            length = min(length * self.options.growth, ENDLESS)
            with watch.stage("traverse"):
                bins.clear()
                arranged.walk()
            with watch.stage("arrange"):
                arranged.count()
                bins.lay_out()
                arranged.scatter()
            if not bins.chunks:
                self._count_finished(active_count)
                break
            with watch.stage("traverse"):
                arranged.walk_again()
            with watch.stage("intersect"):
                bins.intersect(batch)
            self._count_wave(bins)
            if self.options.compaction or self.counters is not None:
                with watch.stage("compact"):
                    kept = compact(self.device, active, spare, batch, active_count)
                active, spare = spare, active
                self._count_finished(active_count - kept)
                active_count = kept

    def walk_counts(self, rays: Rays) -> Counters:
        """Steps and pairs of walking every ray to its t_max, without testing a triangle."""
        self.counters, counted = cl.array.zeros(self.device.queue, len(COUNTERS), np.uint64), Counters()
        walk = self.program("traverse.cl", grid=True, walk_lanes=self.lanes)
        cell_count = cl.array.zeros(self.device.queue, self.grid.nonempty + 1, np.int32)
        for first in range(0, len(rays), self.batch_size):
            batch = Batch(self.device, rays[first : first + self.batch_size])
            self.start(batch)
            active = cl.array.arange(self.device.queue, batch.count, dtype=np.int32)
            arguments = (batch.count, active, batch.rays, batch.keys, *self.grid.arguments, ENDLESS)
            outputs = (batch.positions, batch.t_exit, cell_count, *self.counting)
            walk.launch("count_pairs", -(-batch.count // self.lanes), *arguments, *outputs)
        for name, value in zip(COUNTERS, self.counters.get(), strict=True):
            setattr(counted, name, int(value))
        self.counters = None
        return counted

    def room(self, name: str, count: int) -> cl.array.Array:
        """An int32 array of at least `count`, kept under its name for the next wave and the next batch: memory that
        is touched for the first time costs more than what is done with it. Raises BatchTooLarge."""
        if 4 * count > self.device.max_allocation_bytes:
            raise BatchTooLarge(f"{4 * count / 2**20:.1f} MiB for its {name}")
        if name not in self._rooms or len(self._rooms[name]) < count:
            self._rooms.pop(name, None)  # freed before its successor is made
            self._rooms[name] = cl.array.empty(self.device.queue, max(count, 1), np.int32)
        return self._rooms[name]

    def _halve(self, count: int, error: Exception) -> None:
        self._rooms.clear()
        super()._halve(count, error)

    def _count_wave(self, bins: _Bins) -> None:
        if self.counters is not None:
            self.counted.waves += 1
            self.counted.padding += bins.chunks * self.lanes - bins.pair_count()

    def _count_finished(self, finished: int) -> None:
        if self.counters is not None:
            self.counted.finished_per_wave.append(finished)


class _Bins:
    """The bins of one wave: one a non-empty cell, each a whole number of chunks of `lanes` pairs."""

    def __init__(self, tracer: Deferred):
        self.tracer, self.device, self.lanes = tracer, tracer.device, tracer.lanes
        self.cells = tracer.grid.nonempty
        names = ("counts", "first chunks", "cursors")
        self.cell_count, self.chunk_start, self.cursor = (tracer.room(name, self.cells + 1) for name in names)
        self.chunks = 0
        defines = tracer.options.defines
        self.bin_program = tracer.program("bin.cl", lanes=self.lanes, defines=defines)
        self.intersect_program = tracer.program("intersect_driver.cl", lanes=self.lanes, defines=defines)

    def clear(self) -> None:
        """Empty bins."""
        self.cell_count.fill(0)

    def lay_out(self) -> None:
        """Prefix sum of the counts in chunks, and room for the pairs."""
        chunk_scan(self.device, self.lanes)(self.cell_count, self.chunk_start)
        self.chunks = int(self.chunk_start[-1].get())
        self._make_room()
        self.bin_program.launch(
            "lay_out_bins",
            self.cells,
            *(self.cells, self.cell_count, self.chunk_start, self.chunk_cell, self.pairs, self.cursor),
        )

    def _make_room(self) -> None:
        slots = self.chunks * self.lanes
        if slots >= 2**31 or self.chunks < 0:
            raise BatchTooLarge(f"{4 * slots / 2**20:.1f} MiB for its pairs")
        self.pairs = self.tracer.room("pairs", slots * self.tracer.options.pair_words)
        self.chunk_cell = self.tracer.room("chunks", self.chunks)

    def pair_count(self) -> int:
        """Pairs stored in this wave."""
        return int(cl.array.sum(self.cell_count, dtype=np.int64).get())

    def intersect(self, batch: Batch) -> None:
        """Chunk after chunk, in the order of the bins."""
        grid = self.tracer.grid
        self.intersect_program.launch(
            "intersect_bins",
            self.chunks,
            *(self.chunks, self.chunk_cell, self.pairs, grid.cell_start, grid.references),
            *(self.tracer.triangles, batch.rays, batch.keys, *self.tracer.counting),
        )


class _TwoPass:
    """The paper's arrangement: the first walk counts, the second packs."""

    def __init__(
        self, tracer: Deferred, batch: Batch, walk: Program, bins: _Bins, active, active_count: int, length: int
    ):
        self.tracer, self.batch, self.program, self.bins = tracer, batch, walk, bins
        self.groups = -(-active_count // tracer.lanes)
        rays = (active_count, active, batch.rays, batch.keys)
        self.arguments = (*rays, *tracer.grid.arguments, length, batch.positions, batch.t_exit)

    def walk(self) -> None:
        """Count ray visits to each cell."""
        counting = self.tracer.counting
        self.program.launch("count_pairs", self.groups, *self.arguments, self.bins.cell_count, *counting)

    def count(self) -> None:
        """Nothing: the first walk has counted."""

    def scatter(self) -> None:
        """Nothing: the second walk stores the pairs."""

    def walk_again(self) -> None:
        """Store each ray in the bins of its cells."""
        self.program.launch("pack_pairs", self.groups, *self.arguments, self.bins.cursor, self.bins.pairs)


class _Segment:
    """What one recording pass remembers: `cells`, `ranks` int32[count, slots], `lengths` int32[count]."""

    def __init__(self, tracer: Deferred, number: int, active, count: int, length: int):
        self.active, self.count, self.slots = active, count, length + 1
        # The last group of lanes may be partly empty and still writes its first slots.
        places = (count + max(LANES)) * self.slots
        if places >= 2**31:
            raise BatchTooLarge(f"{8 * places / 2**20:.1f} MiB for its recorded cells")
        self.cells, self.ranks = (tracer.room(f"recorded {what} {number}", places) for what in ("cells", "ranks"))
        self.lengths = tracer.room(f"recorded lengths {number}", count)
        self.bytes = 8 * places + 4 * count


class _Record:
    """Walks once: remembers cells and ranks in segments, then scatters them into the bins."""

    def __init__(
        self, tracer: Deferred, batch: Batch, walk: Program, bins: _Bins, active, active_count: int, length: int
    ):
        self.tracer, self.batch, self.program, self.bins = tracer, batch, walk, bins
        self.active, self.active_count, self.length = active, active_count, length
        self.segments: list[_Segment] = []

    def walk(self) -> None:
        """Record up to `wave` cells a ray; a wave longer than a segment takes several passes."""
        active, count, left = self.active, self.active_count, self.length
        queue = self.tracer.device.queue
        while count and left > 0:
            length = min(left, SEGMENT)
            segment = _Segment(self.tracer, len(self.segments), active, count, length)
            self._record(segment, length)
            self.segments.append(segment)
            if sum(s.bytes for s in self.segments) > self.tracer.device.memory_bytes / 2:
                raise BatchTooLarge("half of the device's memory for its recorded cells")
            left -= length
            if left > 0:
                following = cl.array.empty(queue, count, np.int32)
                count = compact(self.tracer.device, active, following, self.batch, count)
                active = following

    def _record(self, segment: _Segment, length: int) -> None:
        batch, tracer, count = self.batch, self.tracer, segment.count
        self.program.launch(
            "record_pairs",
            -(-count // (RECORDED_TOGETHER * tracer.lanes)) if tracer.lanes > 1 else count,
            *(count, segment.active, batch.rays, batch.keys, *tracer.grid.arguments, length),
            *(batch.positions, batch.t_exit, segment.cells, segment.lengths, *tracer.counting),
        )

    def count(self) -> None:
        """Count the recorded encounters of each cell and rank them within it."""
        for s in self.segments:
            arguments = (s.count, s.slots, s.cells, s.lengths, self.bins.cell_count, s.ranks)
            self.bins.bin_program.launch("rank_pairs", s.count, *arguments)

    def scatter(self) -> None:
        """Store the recorded encounters at their bins' offsets."""
        for s in self.segments:
            arguments = (s.count, s.active, s.slots, s.cells, s.lengths, s.ranks)
            bins, rays = self.bins, (self.batch.rays, self.batch.keys)
            bins.bin_program.launch("scatter_pairs", s.count, *arguments, bins.chunk_start, *rays, bins.pairs)

    def walk_again(self) -> None:
        """Nothing: every ray has been walked."""


def compact(device: Device, active, kept, batch: Batch, count: int) -> int:
    """Copy the unfinished rays of `active` to `kept`, in order; returns their number."""
    total = cl.array.empty(device.queue, 1, np.int32)
    unfinished_scan(device)(active, kept, batch.positions, batch.keys, batch.t_exit, total, size=count)
    return int(total.get()[0])


@functools.cache
def chunk_scan(device: Device, lanes: int):
    """Exclusive prefix sum of ceil(count / lanes): the first chunk of each bin."""
    from pyopencl.scan import GenericScanKernel

    return GenericScanKernel(
        device.context,
        np.int32,
        arguments="__global int *cell_count, __global int *chunk_start",
        input_expr=f"(i < N - 1 ? (cell_count[i] + {lanes - 1}) / {lanes} : 0)",
        scan_expr="a+b",
        neutral="0",
        output_statement="chunk_start[i] = prev_item;",
    )


@functools.cache
def unfinished_scan(device: Device):
    """List compaction: a ray stays while it is in the grid and its best t lies beyond the cells walked."""
    from pyopencl.scan import GenericScanKernel

    return GenericScanKernel(
        device.context,
        np.int32,
        arguments=(
            "__global int *active, __global int *kept, __global ulong *positions, __global ulong *keys, "
            "__global float *t_exit, __global int *total"
        ),
        input_expr=(
            "(positions[active[i]] != 0xffffffffffffffffUL"
            " && as_float((uint)(keys[active[i]] >> 32)) > t_exit[active[i]]) ? 1 : 0"
        ),
        scan_expr="a+b",
        neutral="0",
        output_statement="""
            if (prev_item != item) kept[prev_item] = active[i];
            if (i == N - 1) total[0] = item;
        """,
    )


TRACER = Deferred
