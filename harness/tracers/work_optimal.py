"""Synthetic work-optimal intersection (paper, section 3): the cells up to each hit are known beforehand."""

from __future__ import annotations

import numpy as np

from harness.data import Hits, Rays
from harness.device.primitives import exclusive_scan
from harness.device.runtime import cl
from harness.device.stopwatch import Stopwatch
from harness.spec.tracer_facts import TracerFacts
from harness.tracers.batch import Batch
from harness.tracers.device_tracer import DeviceTracer


class WorkOptimal(DeviceTracer):
    """The paper's baseline. Recording the cells is not timed: forward tracing with traversal free of charge."""

    name = "work-optimal"
    needs_structure = True
    default_lanes = 1

    recorded: Rays | None = None  # the rays whose cells are recorded, while they fit one batch

    def trace(self, rays: Rays, watch: Stopwatch) -> Hits:
        """First hits; the recorded cells of the last rays are kept for the next repetition."""
        if self.recorded is not rays:
            self.recorded = None
        hits = super().trace(rays, watch)
        self.recorded = rays if len(rays) <= self.batch_size else None
        return hits

    def prepare(self, batch: Batch) -> None:
        """Trace forward once to learn how many cells each ray visits, then write them down."""
        if self.recorded is None:
            self._record(batch)

    def _record(self, batch: Batch) -> None:
        queue, grid = self.device.queue, self.structure
        program = self.program("tracers/forward.cl", lanes=self.lanes, walks=True)
        self.visited = cl.array.zeros(queue, batch.count, np.int32)
        throwaway = () if self.counters is None else (cl.array.zeros_like(self.counters),)
        self.start(batch)
        program.launch(
            "trace_forward",
            batch.count,
            *(batch.count, batch.rays, batch.keys, *grid.arguments, grid.cell_start, grid.references),
            *(self.triangles, batch.positions, self.visited, *throwaway),
        )
        self.visited_start = self.visited.copy()
        exclusive_scan(self.device)(self.visited_start)
        total = int(self.visited_start[-1].get()) + int(self.visited[-1].get())
        self.visited_cell = cl.array.empty(queue, max(total, 1), np.int32)
        program.launch(
            "record_visited",
            batch.count,
            *(batch.count, batch.rays, *grid.arguments, batch.positions),
            *(self.visited, self.visited_start, self.visited_cell),
        )

    def trace_batch(self, batch: Batch, watch: Stopwatch) -> None:
        """Spin over the recorded cells."""
        program = self.program("tracers/work_optimal.cl", lanes=self.lanes)
        with watch.stage("intersect"):
            program.launch(
                "intersect_visited",
                batch.count,
                *(batch.count, batch.rays, batch.keys, self.visited, self.visited_start, self.visited_cell),
                *(self.structure.cell_start, self.structure.references, self.triangles, *self.counting),
            )


TRACER = WorkOptimal
FACTS = TracerFacts(
    order=3,
    colour="orange",
    marker="D",
    kernels={"intersect_visited": "work-optimal"},
    test_kernels=("intersect_visited",),
)
