"""Tracers that run OpenCL kernels: their programs, batches of rays in bounded memory, and instrumented runs."""

from __future__ import annotations

import copy
from abc import abstractmethod
from contextlib import nullcontext
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from harness.data import Counters, Hits, Rays
from harness.device.program import Program, build
from harness.device.runtime import cl
from harness.device.stopwatch import Stopwatch
from harness.errors import DefrayError
from harness.spec.intersectors import Intersector
from harness.structures.device_scene import stored_triangles
from harness.tracers.base import Options, Tracer
from harness.tracers.batch import Batch, BatchTooLarge
from harness.tracers.buffers import Buffers
from harness.tracers.prepared import Prepared

SMALLEST_BATCH = 256  # rays; what does not fit then will not fit at all
COUNTERS = ("steps", "pairs", "tests", "lane_tests")


class DeviceOptions(Options):
    """Options of every tracer that runs on an OpenCL device."""

    lanes: Literal["auto", "1", "4", "8", "16"] = "auto"
    contraction: Literal["off", "on"] = Field(default="off", description="may a * b + c become one fma")
    batch: int = Field(default=1 << 20, ge=64, le=1 << 26, description="rays on the device at a time")


class DeviceTracer(Tracer):
    """A tracer that runs OpenCL kernels over batches of rays, in bounded device memory."""

    Options: ClassVar[type[Options]] = DeviceOptions
    default_lanes: ClassVar[int | None] = None  # None: the device's own
    start_stage: ClassVar[str | None] = None  # stage that preparing the rays belongs to, beside the total

    def __init__(self, prepared: Prepared, intersector: Intersector | None, options: dict[str, str]):
        super().__init__(prepared, intersector, options)
        self.device = prepared.device
        self.scene = prepared.device_scene
        self.structure = prepared.structure
        self.counters: cl.array.Array | None = None
        self.batch_size = self.options.batch
        self.buffers = Buffers(self.device)
        if intersector and intersector.needs_double and not self.device.has_double:
            raise DefrayError(f"{self.device.name} has no double precision, which {intersector.name} needs")
        if not self.device.has_int64_atomics:
            raise DefrayError(f"{self.device.name} has no 64-bit atomics (cl_khr_int64_extended_atomics)")

    @property
    def lanes(self) -> int:
        """Rays (or triangles) tested at a time."""
        if self.options.lanes != "auto":
            return int(self.options.lanes)
        return self.default_lanes or self.device.native_lanes

    @property
    def exchanged_lanes(self) -> int:
        """Rays that walk together where one that is through gives its lane to the next: twice as many as are tested
        together, as one half computes while the other waits for memory."""
        return 2 * self.lanes if self.lanes in (4, 8) else self.lanes

    @property
    def contraction(self) -> dict[str, int]:
        """The definition that lets the compiler contract inside the intersector, where the options ask for it."""
        return {"CONTRACT": 1} if self.options.contraction == "on" else {}

    @cached_property
    def triangles(self) -> cl.array.Array:
        """The triangles in the form that the intersector stores: vertices, or 12 floats each."""
        return stored_triangles(self.scene, self.intersector, self.contraction)

    @property
    def counting(self) -> tuple:
        """The last argument of an instrumented kernel, nothing for a plain one."""
        return () if self.counters is None else (self.counters,)

    def program(
        self,
        *files: str,
        lanes: int = 1,
        walks: bool = False,
        walk_lanes: int = 1,
        defines: dict[str, int] | None = None,
    ) -> Program:
        """Build kernel files for this tracer's intersector and, where they walk, its structure."""
        defines = {**(defines or {}), **self.contraction}
        if walks:
            defines |= {**self.structure.defines, "WALK_LANES": walk_lanes}
        if self.counters is not None:
            defines["COUNT_WORK"] = 1
        file = self.intersector.file if self.intersector else None
        header = self.structure.header if walks else None
        return build(self.device, *files, intersector=file, structure=header, lanes=lanes, defines=defines)

    @cached_property
    def _start_program(self) -> Program:
        if not self.needs_structure:
            return build(self.device, "tracers/start_alone.cl")
        defines = self.structure.defines | {"WALK_LANES": self.device.native_lanes}
        return build(self.device, "tracers/start.cl", structure=self.structure.header, defines=defines)

    def start(self, batch: Batch) -> None:
        """Prepare the ray records and, with a structure, find where each ray enters it."""
        inputs = (batch.count, batch.origins, batch.directions, batch.t_max)
        if self.needs_structure:
            outputs = (batch.rays, batch.keys, batch.positions, batch.t_exit)
            groups = -(-batch.count // self.device.native_lanes)
            self._start_program.launch("start_rays", groups, *inputs, *self.structure.arguments, *outputs)
        else:
            self._start_program.launch("start_rays_alone", batch.count, *inputs, batch.rays, batch.keys)

    def finish(self, batch: Batch) -> None:
        """Turn best keys into hits."""
        lanes, file = self.device.native_lanes, self.intersector.file
        program = build(self.device, "tracers/hits.cl", intersector=file, lanes=lanes, defines=self.contraction)
        arguments = (batch.rays, batch.keys, self.triangles, *batch.hits)
        program.launch("write_hits", -(-batch.count // lanes), batch.count, *arguments)

    def prepare(self, batch: Batch) -> None:
        """Untimed work before a batch."""

    @abstractmethod
    def trace_batch(self, batch: Batch, watch: Stopwatch) -> None:
        """Leave the best hits' keys in `batch.keys`."""

    def trace(self, rays: Rays, watch: Stopwatch) -> Hits:
        """First hits, batch by batch; a batch whose pairs do not fit is halved and started again."""
        parts, first = [], 0
        while first < len(rays):
            count = len(rays[first : first + self.batch_size])
            before = self._counts_so_far()
            try:
                batch = self._trace_one(rays[first : first + count], watch)
            except (BatchTooLarge, cl.MemoryError) as error:
                self._restore_counts(before)
                self._halve(count, error)
                continue
            parts.append(batch.download())
            first += batch.count
        columns = zip(*((p.t, p.primitive, p.u, p.v) for p in parts), strict=True)
        return Hits(*(np.concatenate(column) for column in columns))

    def _trace_one(self, rays: Rays, watch: Stopwatch) -> Batch:
        batch = Batch(self.device, rays)
        self.prepare(batch)
        with watch.total():
            with watch.stage(self.start_stage) if self.start_stage else nullcontext():
                self.start(batch)
            self.trace_batch(batch, watch)
            self.finish(batch)
        return batch

    def _counts_so_far(self) -> tuple | None:
        return None if self.counters is None else (self.counters.get(), copy.deepcopy(self.counted))

    def _restore_counts(self, before: tuple | None) -> None:
        """Forget what a batch that failed has counted."""
        if before is not None:
            self.counters.set(before[0])
            self.counted = before[1]

    def _halve(self, count: int, error: Exception) -> None:
        self.buffers.clear()
        if count <= SMALLEST_BATCH:
            raise DefrayError(f"a batch of {count} rays needs {error}; use a coarser grid") from error
        self.batch_size = -(-count // 2)

    def count(self, rays: Rays) -> Counters:
        """Exact work counts summed over all batches."""
        self.counters = cl.array.zeros(self.device.queue, len(COUNTERS), np.uint64)
        self.counted = Counters()
        try:
            self.trace(rays, Stopwatch(self.device.queue))
            for name, value in zip(COUNTERS, self.counters.get(), strict=True):
                setattr(self.counted, name, int(value))
        finally:
            self.counters = None
        return self.counted
