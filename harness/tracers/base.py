"""What tracers share: options, batches of rays on the device, and the final hits."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from contextlib import nullcontext
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from harness.data import Counters, Hits, Rays
from harness.device.program import Program, build
from harness.device.runtime import cl
from harness.device.stopwatch import Stopwatch
from harness.errors import DefrayError, known
from harness.spec.intersectors import Intersector
from harness.spec.structure import GridSpec
from harness.structures.base import stored_triangles, walk_defines
from harness.tracers.batch import Batch, BatchTooLarge
from harness.tracers.prepared import Prepared

SMALLEST_BATCH = 256  # rays; what does not fit then will not fit at all
COUNTERS = ("steps", "pairs", "tests", "lane_tests")


class Options(BaseModel):
    """Options of a tracer; a tracer's own class adds to it."""

    model_config = ConfigDict(extra="forbid")


class DeviceOptions(Options):
    """Options of every tracer that runs on an OpenCL device."""

    lanes: Literal["auto", "1", "4", "8", "16"] = "auto"
    contraction: Literal["off", "on"] = Field(default="off", description="may a * b + c become one fma")
    batch: int = Field(default=1 << 20, ge=64, le=1 << 26, description="rays on the device at a time")


class Tracer(ABC):
    """One way of finding first hits."""

    name: ClassVar[str]
    needs_device: ClassVar[bool] = True
    needs_grid: ClassVar[bool] = False
    needs_intersector: ClassVar[bool] = True
    warm_up_rays: ClassVar[int] = 1 << 16  # enough to run every kernel, its later waves included
    Options: ClassVar[type[Options]] = DeviceOptions

    def __init__(self, setting: Prepared, intersector: Intersector | None, options: dict[str, str]):
        self.setting, self.intersector = setting, intersector
        self.options = parse_options(type(self), options)

    @abstractmethod
    def trace(self, rays: Rays, watch: Stopwatch) -> Hits:
        """First hits of all rays; adds the times to `watch`."""

    @abstractmethod
    def count(self, rays: Rays) -> Counters:
        """Exact work counts, from an instrumented run."""


def parse_options(tracer: type[Tracer], options: dict[str, str]) -> Options:
    """Validate options given as text; raises DefrayError naming the option."""
    try:
        return tracer.Options(**options)
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0]) if first["loc"] else "?"
        if first["type"] == "extra_forbidden":
            raise known(f"option of tracer {tracer.name}", name, tracer.Options.model_fields) from None
        reason = first["msg"].removeprefix("Value error, ").lower()
        raise DefrayError(f"option {name}={options.get(name)} of {tracer.name}: {reason}") from None


class DeviceTracer(Tracer):
    """A tracer that runs OpenCL kernels over batches of rays, in bounded device memory."""

    default_lanes: ClassVar[int | None] = None  # None: the device's own
    start_stage: ClassVar[str | None] = None  # stage that preparing the rays belongs to, beside the total

    def __init__(self, setting: Prepared, intersector: Intersector | None, options: dict[str, str]):
        super().__init__(setting, intersector, options)
        self.device = setting.device
        self.scene = setting.device_scene
        self.grid = setting.grid
        self.counters: cl.array.Array | None = None
        self.batch_size = self.options.batch
        self._buffers: dict[str, cl.array.Array] = {}
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
        grid: bool = False,
        walk_lanes: int = 1,
        defines: dict[str, int] | None = None,
    ) -> Program:
        """Build kernel files for this tracer's intersector and, where they walk, its grid."""
        defines = {**(defines or {}), **self.contraction}
        if grid:
            defines |= {**self.grid.defines, "WALK_LANES": walk_lanes}
        if self.counters is not None:
            defines["COUNT_WORK"] = 1
        file = self.intersector.file if self.intersector else None
        return build(self.device, *files, intersector=file, lanes=lanes, defines=defines)

    @cached_property
    def _start_program(self) -> Program:
        defines = self.grid.defines if self.grid else walk_defines(GridSpec(1, 1))
        return build(self.device, "tracers/start.cl", defines={**defines, "WALK_LANES": self.device.native_lanes})

    def start(self, batch: Batch) -> None:
        """Prepare the ray records and, with a grid, find where each ray enters it."""
        inputs = (batch.count, batch.origins, batch.directions, batch.t_max)
        if self.grid:
            outputs = (batch.rays, batch.keys, batch.positions, batch.t_exit)
            groups = -(-batch.count // self.device.native_lanes)
            self._start_program.launch("start_rays", groups, *inputs, *self.grid.arguments, *outputs)
        else:
            self._start_program.launch("start_rays_without_grid", batch.count, *inputs, batch.rays, batch.keys)

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

    def buffer(self, name: str, count: int) -> cl.array.Array:
        """An int32 array of at least `count`, kept under its name for the next wave and the next batch: memory that
        is touched for the first time costs more than what is done with it. Raises BatchTooLarge."""
        if 4 * count > self.device.max_allocation_bytes:
            raise BatchTooLarge(f"{4 * count / 2**20:.1f} MiB for its {name}")
        if name not in self._buffers or len(self._buffers[name]) < count:
            self._buffers.pop(name, None)  # freed before its successor is made
            self._buffers[name] = cl.array.empty(self.device.queue, max(count, 1), np.int32)
        return self._buffers[name]

    def _halve(self, count: int, error: Exception) -> None:
        self._buffers.clear()
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
