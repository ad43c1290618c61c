"""Brute force: every triangle against every ray, no grid. The oracle of the other tracers."""

from __future__ import annotations

import numpy as np

from harness.runtime import cl
from harness.stopwatch import Stopwatch
from harness.tracers._base import Batch, DeviceTracer

BLOCK = 4096  # triangles a work-item tests, small enough to keep every core busy


class Brute(DeviceTracer):
    """All pairs of rays and active triangles, in lanes of rays."""

    name = "brute"

    def prepare(self, batch: Batch) -> None:
        """Rays in order, padded to whole chunks."""
        chunks = -(-batch.count // self.lanes)
        pairs = np.full(chunks * self.lanes, -1, np.int32)
        pairs[: batch.count] = np.arange(batch.count)
        self.pairs = cl.array.to_device(self.device.queue, pairs)
        self.chunks = chunks

    def trace_batch(self, batch: Batch, watch: Stopwatch) -> None:
        """One kernel over chunks of rays times blocks of triangles."""
        program = self.program("intersect_driver.cl", lanes=self.lanes)
        blocks = -(-self.scene.active_count // BLOCK)
        with watch.stage("intersect"):
            program.launch(
                "intersect_all",
                self.chunks * blocks,
                *(self.chunks, blocks, BLOCK, self.pairs, self.scene.active_count, self.scene.active),
                *(self.scene.triangles, batch.rays, batch.keys, *self.counting),
            )


TRACER = Brute
