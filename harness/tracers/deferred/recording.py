"""Walking once: cells are remembered in segments and scattered into the bins."""

from __future__ import annotations

import numpy as np

from harness.device.runtime import cl
from harness.spec.intersectors import LANES
from harness.tracers.batch import BatchTooLarge
from harness.tracers.buffers import Buffers
from harness.tracers.deferred.compaction import compact
from harness.tracers.deferred.wave import Wave

RECORDED_TOGETHER = 8  # rays a lane that a work-item records, where several rays walk together
SEGMENT = 32  # cells a ray that one recording pass remembers at most


class Segment:
    """What one recording pass remembers: `cells`, `ranks` int32[count, slots], `lengths` int32[count]."""

    def __init__(self, buffers: Buffers, number: int, active, count: int, length: int):
        self.active, self.count, self.slots = active, count, length + 1
        # The last group of lanes may be partly empty and still writes its first slots.
        places = (count + max(LANES)) * self.slots
        if places >= 2**31:
            raise BatchTooLarge(f"{8 * places / 2**20:.1f} MiB for its recorded cells")
        self.cells, self.ranks = (buffers.get(f"recorded {what} {number}", places) for what in ("cells", "ranks"))
        self.lengths = buffers.get(f"recorded lengths {number}", count)
        self.bytes = 8 * places + 4 * count


class Recording:
    """Walks once: remembers cells and ranks in segments, then scatters them into the bins."""

    def __init__(self, wave: Wave):
        self.wave, self.tracer, self.batch, self.bins = wave, wave.tracer, wave.batch, wave.bins
        self.segments: list[Segment] = []

    def walk(self) -> None:
        """Record up to `length` cells a ray; a wave longer than a segment takes several passes."""
        active, count, left = self.wave.active, self.wave.active_count, self.wave.length
        device = self.tracer.device
        while count and left > 0:
            length = min(left, SEGMENT)
            segment = Segment(self.tracer.buffers, len(self.segments), active, count, length)
            self._record(segment, length)
            self.segments.append(segment)
            if sum(s.bytes for s in self.segments) > device.memory_bytes / 2:
                raise BatchTooLarge("half of the device's memory for its recorded cells")
            left -= length
            if left > 0:
                following = cl.array.empty(device.queue, count, np.int32)
                count = compact(device, active, following, self.batch, count)
                active = following

    def _record(self, segment: Segment, length: int) -> None:
        batch, tracer, count = self.batch, self.tracer, segment.count
        together = RECORDED_TOGETHER * tracer.exchanged_lanes if tracer.lanes > 1 else 1
        self.wave.walk.launch(
            "record_pairs",
            -(-count // together),
            *(count, segment.active, batch.rays, batch.keys, *tracer.structure.arguments, length, together),
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
