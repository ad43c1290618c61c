"""Arranging by sorting: walk once and remember, then sort the pairs by cell. What the paper holds binning against.

On a CPU a least-significant-digit radix sort (kernels/tracers/deferred/sort.cl), a block of the pairs a work-item,
with as few passes over the bits of the cell as MOST_DIGIT_BITS allows; elsewhere pyopencl's radix sort.
"""

from __future__ import annotations

import numpy as np

from harness.device.primitives import exclusive_scan, library_sort
from harness.device.runtime import cl
from harness.tracers.batch import BatchTooLarge
from harness.tracers.deferred.recording import Recording

MOST_DIGIT_BITS = 10  # 1024 counters and as many places written to: what a core's first cache holds
BLOCKS_A_CORE = 4
SHORT_TABLE = 1 << 16  # counts that one core sums sooner than a parallel prefix sum starts
LEAST_BLOCK = 4096  # pairs; a smaller block has more digits to look after than pairs


class SortedRecording(Recording):
    """Records as `Recording` does, sorts, and copies each run of one cell into its bin."""

    def count(self) -> None:
        """Sort the recorded pairs by cell; count those of each cell."""
        bits = max((self.bins.cells - 1).bit_length(), 1)
        passes = -(-bits // MOST_DIGIT_BITS)
        self.digit_bits = -(-bits // passes)
        defines = {**self.tracer.options.defines, "DIGIT_BITS": self.digit_bits}
        self.program = self.tracer.program("tracers/deferred/sort.cl", lanes=self.tracer.lanes, defines=defines)
        self.cell_first = self.tracer.buffers.get("first pairs", self.bins.cells)
        if sum(s.count * s.slots for s in self.segments) >= 2**31:
            raise BatchTooLarge("2^31 places for its pairs to sort")
        sort = self._sort_blocks if self.tracer.device.is_cpu else self._sort_by_library
        self.sorted, self.pairs = sort(passes, bits)
        self.program.launch("find_bins", self.pairs, self.pairs, self.sorted, self.cell_first, self.bins.cell_count)

    def scatter(self) -> None:
        """Copy the sorted pairs to their bins."""
        self.program.launch(
            "fill_bins",
            self.pairs,
            *(self.pairs, self.sorted, self.cell_first, self.bins.chunk_start),
            *(self.batch.rays, self.batch.keys, self.bins.pairs),
        )

    def _pairs_buffer(self, name: str, pairs: int) -> cl.array.Array:
        return self.tracer.buffers.get(name, 2 * pairs)

    def _sort_blocks(self, passes: int, bits: int) -> tuple[cl.array.Array, int]:
        """Sorted pairs, 8 bytes each, and their number. The first pass reads what was recorded."""
        segments = self.segments
        blocks = [self._blocks(s.count) for s in segments]
        table = self._table(sum(blocks))
        firsts = np.cumsum([0, *blocks[:-1]])
        parts = [
            (s.count, s.active, s.slots, s.cells, s.lengths, number, int(first), sum(blocks))
            for s, number, first in zip(segments, blocks, firsts, strict=True)
        ]
        for part, number in zip(parts, blocks, strict=True):
            self.program.launch("count_recorded", number, *part, table, local=1)
        pairs = self._sum(table)
        source, target = (self._pairs_buffer(f"pairs to sort {i}", pairs) for i in range(2))
        for part, number in zip(parts, blocks, strict=True):
            self.program.launch("move_recorded", number, *part, table, source, local=1)
        number = self._blocks(pairs)
        table = self._table(number)
        for shift in range(self.digit_bits, passes * self.digit_bits, self.digit_bits):
            arguments = (pairs, shift, number, source, table)
            self.program.launch("count_digits", number, *arguments, local=1)
            self._sum(table, read=False)
            self.program.launch("move_digits", number, *arguments, target, local=1)
            source, target = target, source
        return source, pairs

    def _blocks(self, count: int) -> int:
        return max(1, min(BLOCKS_A_CORE * self.tracer.device.compute_units, count // LEAST_BLOCK))

    def _sum(self, table: cl.array.Array, read: bool = True) -> int:
        """Prefix sum in place; returns the sum of all where it is to be read."""
        if len(table) <= SHORT_TABLE:
            self.program.launch("sum_counts", 1, len(table), table, local=1)
        else:
            exclusive_scan(self.tracer.device)(table)
        return int(table[-1].get()) if read else 0

    def _table(self, blocks: int) -> cl.array.Array:
        """Counts int32[digits, blocks], and one more place for their sum."""
        return self._array("digit counts", (blocks << self.digit_bits) + 1)

    def _array(self, name: str, count: int) -> cl.array.Array:
        return self.tracer.buffers.get(name, count)[:count]

    def _sort_by_library(self, passes: int, bits: int) -> tuple[cl.array.Array, int]:
        """As `_sort_blocks`, from the pairs gathered side by side."""
        device = self.tracer.device
        firsts, bases, pairs = [], [], 0
        for number, s in enumerate(self.segments):
            first = self._array(f"first places {number}", s.count + 1)
            cl.enqueue_copy(device.queue, first.data, s.lengths.data, byte_count=4 * s.count)
            exclusive_scan(device)(first)
            firsts.append(first)
            bases.append(pairs)
            pairs += int(first[-1].get())
        gathered = self._pairs_buffer("pairs to sort 0", pairs)
        for s, first, base in zip(self.segments, firsts, bases, strict=True):
            arguments = (s.count, s.active, s.slots, s.cells, s.lengths, first, base, gathered)
            self.program.launch("gather_recorded", s.count, *arguments)
        if not pairs:
            return gathered, 0
        (result,), _ = library_sort(device)(gathered[: 2 * pairs].view(np.uint64), key_bits=bits, queue=device.queue)
        return result, pairs
