"""The bins of the deferred tracer: pairs of one cell side by side, in whole chunks."""

from __future__ import annotations

import numpy as np

from harness.device.primitives import chunk_scan
from harness.device.runtime import cl
from harness.tracers.batch import Batch, BatchTooLarge
from harness.tracers.deferred.compaction import BLOCKS, blocks_of
from harness.tracers.device_tracer import DeviceTracer


class Bins:
    """The bins of one wave: one a non-empty cell, each a whole number of chunks of `lanes` pairs."""

    def __init__(self, tracer: DeviceTracer):
        self.tracer, self.device, self.lanes = tracer, tracer.device, tracer.lanes
        self.cells = tracer.structure.nonempty
        names = ("counts", "first chunks", "cursors")
        self.cell_count, self.chunk_start, self.cursor = (tracer.buffers.get(name, self.cells + 1) for name in names)
        self.chunks = 0
        defines = tracer.options.defines
        self.bin_program = tracer.program("tracers/deferred/bins.cl", lanes=self.lanes, defines=defines)
        self.intersect_program = tracer.program("tracers/deferred/intersect.cl", lanes=self.lanes, defines=defines)

    def clear(self) -> None:
        """Empty bins."""
        # pyopencl's own fill takes ten times as long.
        cl.enqueue_fill_buffer(self.device.queue, self.cell_count.data, np.int32(0), 0, self.cell_count.nbytes)

    def lay_out(self) -> None:
        """Prefix sum of the counts in chunks, and room for the pairs."""
        if self.device.is_cpu:
            self._lay_out_in_blocks()
            return
        chunk_scan(self.device, self.lanes)(self.cell_count, self.chunk_start)
        self.chunks = int(self.chunk_start[-1].get())
        self._grow()
        self.bin_program.launch(
            "lay_out_bins",
            self.cells,
            *(self.cells, self.cell_count, self.chunk_start, self.chunk_cell, self.cursor),
        )

    def _lay_out_in_blocks(self) -> None:
        """The same on a CPU, whose work-items stream through blocks of cells."""
        blocks, size = blocks_of(self.cells)
        block_chunks = self.tracer.buffers.get("chunks of blocks", BLOCKS)
        self.bin_program.launch("count_chunks", blocks, self.cells, size, self.cell_count, block_chunks)
        self.chunks = int(block_chunks.get()[:blocks].sum(dtype=np.int64))
        self._grow()
        inputs = self.cells, size, self.cell_count, block_chunks
        outputs = self.chunk_start, self.chunk_cell, self.cursor
        self.bin_program.launch("lay_out_blocks", blocks, *inputs, *outputs)

    def _grow(self) -> None:
        slots = self.chunks * self.lanes
        if slots >= 2**31 or self.chunks < 0:
            raise BatchTooLarge(f"{4 * slots / 2**20:.1f} MiB for its pairs")
        self.pairs = self.tracer.buffers.get("pairs", slots * self.tracer.options.pair_words)
        self.chunk_cell = self.tracer.buffers.get("chunks", self.chunks)

    def pair_count(self) -> int:
        """Pairs stored in this wave."""
        return int(cl.array.sum(self.cell_count, dtype=np.int64).get())

    def intersect(self, batch: Batch) -> None:
        """Chunk after chunk, in the order of the bins."""
        cells = self.tracer.structure
        self.intersect_program.launch(
            "intersect_bins",
            self.chunks,
            *(self.chunks, self.chunk_cell, self.chunk_start, self.cell_count, self.pairs),
            *(
                cells.cell_start,
                cells.references,
                self.tracer.triangles,
                batch.rays,
                batch.keys,
                *self.tracer.counting,
            ),
        )
