"""Bins for the GPU's form of the intersector: pairs of all cells side by side, without padding."""

from __future__ import annotations

from harness.device.primitives import chunk_scan
from harness.device.runtime import cl
from harness.tracers.batch import Batch, BatchTooLarge
from harness.tracers.deferred.bins import Bins
from harness.tracers.device_tracer import DeviceTracer

GROUP = 64  # work-items of a group: two or four vectors of the GPUs there are


class GroupBins(Bins):
    """Bins of one lane, so that a chunk is a pair. No pair's cell is written down: a group of the intersector finds
    the bins of its pairs by bisection, as a work-item that wrote the cells of a long bin would take long."""

    def __init__(self, tracer: DeviceTracer):
        super().__init__(tracer)
        defines = {**tracer.options.defines, "GROUP": GROUP}
        self.intersect_program = tracer.program("tracers/deferred/intersect_group.cl", defines=defines)

    def lay_out(self) -> None:
        """Prefix sum of the counts, which is where packing begins in each bin, and room for the pairs."""
        chunk_scan(self.device, 1)(self.cell_count, self.chunk_start)
        self.chunks = int(self.chunk_start[-1].get())
        if self.chunks < 0:
            raise BatchTooLarge("2^31 places for its pairs")
        self.pairs = self.tracer.buffers.get("pairs", self.chunks * self.tracer.options.pair_words)
        cl.enqueue_copy(self.device.queue, self.cursor.data, self.chunk_start.data, byte_count=4 * self.cells)

    def intersect(self, batch: Batch) -> None:
        """A work-group for every GROUP pairs."""
        cells = self.tracer.structure
        self.intersect_program.launch(
            "intersect_bins_group",
            self.chunks,
            *(self.chunks, self.cells, self.chunk_start, self.pairs, cells.cell_start, cells.references),
            *(self.tracer.triangles, batch.rays, batch.keys, *self.tracer.counting),
            local=GROUP,
        )
