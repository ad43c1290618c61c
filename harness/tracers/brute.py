"""Brute force: every triangle against every ray, no grid. The oracle of the other tracers."""

from __future__ import annotations

import numpy as np

from harness.data import Counters, Rays
from harness.device.runtime import cl
from harness.device.stopwatch import Stopwatch
from harness.spec.tracer_facts import TracerFacts
from harness.tracers.batch import Batch
from harness.tracers.device_tracer import DeviceTracer

BLOCK = 4096  # triangles a work-item tests, small enough to keep every core busy


class Brute(DeviceTracer):
    """All pairs of rays and active triangles, in lanes of rays."""

    name = "brute"
    warm_up_rays = 64

    def prepare(self, batch: Batch) -> None:
        """Rays in order, padded to whole chunks."""
        chunks = -(-batch.count // self.lanes)
        pairs = np.full(chunks * self.lanes, -1, np.int32)
        pairs[: batch.count] = np.arange(batch.count)
        self.pairs = cl.array.to_device(self.device.queue, pairs)
        self.chunks = chunks

    def trace_batch(self, batch: Batch, watch: Stopwatch) -> None:
        """One kernel over chunks of rays times blocks of triangles."""
        program = self.program("tracers/brute.cl", lanes=self.lanes)
        blocks = -(-self.scene.active_count // BLOCK)
        with watch.stage("intersect"):
            program.launch(
                "intersect_all",
                self.chunks * blocks,
                *(self.chunks, blocks, BLOCK, self.pairs, self.scene.active_count, self.scene.active),
                *(self.triangles, batch.rays, batch.keys, *self.counting),
            )

    def count(self, rays: Rays) -> Counters:
        """Exact by definition: every active triangle for every ray, which an instrumented run confirms."""
        whole, rest = divmod(len(rays), self.batch_size)
        chunks = whole * -(-self.batch_size // self.lanes) + -(-rest // self.lanes)
        triangles = self.scene.active_count
        return Counters(tests=len(rays) * triangles, lane_tests=chunks * self.lanes * triangles)

    def count_by_running(self, rays: Rays) -> Counters:
        """The same from an instrumented run, which takes as long as tracing."""
        return super().count(rays)


TRACER = Brute
FACTS = TracerFacts(
    order=5,
    colour="grey",
    marker="v",
    kernels={"intersect_all": "brute force"},
    test_kernels=("intersect_all",),
)
