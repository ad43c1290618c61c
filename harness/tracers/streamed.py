"""Deferred tracing in streams: the deferred tracer without passes over its pairs, for devices with few, fast cores.

Each work-item, one a core, walks its own rays, bins their pairs privately and intersects a bin as soon as it holds a
chunk. Nothing is counted, scanned or scattered, and no atomic is needed; the price is that only rays of one core
share a chunk.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from harness.device.runtime import cl
from harness.device.stopwatch import Stopwatch
from harness.spec.tracer_facts import TracerFacts
from harness.tracers.batch import Batch
from harness.tracers.device_tracer import DeviceOptions, DeviceTracer

BLOCK = 1024  # consecutive rays of one stream


class StreamedOptions(DeviceOptions):
    """`wave`: non-empty cells a ray between two emptyings of the bins; `growth`: times as many in each wave as in the
    one before; `streams`: work-items, 0 for one a compute unit of the device."""

    wave: int = Field(default=2, ge=1, le=4096)
    growth: int = Field(default=1, ge=1, le=64)
    streams: int = Field(default=0, ge=0, le=1024)


class Streamed(DeviceTracer):
    """All waves in one kernel, a stream of rays a work-item."""

    name = "streamed"
    needs_structure = True
    Options = StreamedOptions
    warm_up_rays = 1 << 18

    def trace_batch(self, batch: Batch, watch: Stopwatch) -> None:
        """One kernel; walking, binning and intersecting alternate, so there is only a total."""
        blocks, grid = -(-batch.count // BLOCK), self.structure
        cells = max(grid.nonempty, 1)
        fit = self.device.max_allocation_bytes // (4 * cells * self.lanes)
        streams = max(1, min(self.options.streams or self.device.compute_units, blocks, fit))
        share = -(-blocks // streams) * BLOCK  # rays of a stream
        active, listed = (
            self.buffers.get("active rays", streams * share),
            self.buffers.get("listed cells", streams * (cells + 1)),
        )
        bins, filled = (
            self.buffers.get("bins", streams * cells * self.lanes),
            self.buffers.get("fills", -(-streams * cells // 4)),
        )
        cl.enqueue_fill_buffer(self.device.queue, filled.data, np.int32(0), 0, filled.nbytes)
        shape = {"lanes": self.lanes, "walks": True, "walk_lanes": self.exchanged_lanes}
        program = self.program("tracers/streamed.cl", **shape, defines={"BLOCK": BLOCK})
        wave_counters = self._wave_counters()
        program.launch(
            "trace_stream",
            streams,
            *(batch.count, streams, share, self.options.wave, self.options.growth, batch.rays, batch.keys),
            *(*grid.arguments, batch.positions, batch.t_exit, grid.cell_start, grid.references, self.triangles),
            *(cells, active, bins, filled, listed, *self.counting, *wave_counters),
            local=1,
        )
        for counts in wave_counters:
            self._count_waves(*counts.get())

    def _wave_counters(self) -> tuple:
        """Another argument of the instrumented kernel: uint64 zeros for the padding and for each wave, as
        many as there can be."""
        if self.counters is None:
            return ()
        waves = self.structure.most_cells_met // self.options.wave + 4
        return (cl.array.zeros(self.device.queue, waves, np.uint64),)

    def _count_waves(self, padding: int, *finished: int) -> None:
        in_order = [int(rays) for rays in np.trim_zeros(finished, "b")]
        self.counted.padding += int(padding)
        self.counted.waves += len(in_order)
        self.counted.finished_per_wave += in_order


TRACER = Streamed
FACTS = TracerFacts(
    order=2,
    colour="pink",
    marker="P",
    kernels={"trace_stream": "streamed"},
    test_kernels=("trace_stream",),
    # One kernel that does all at a time, so that there is only a total.
    terms={"rest": ("active", "steps", "pairs", "far_pairs", "slots", "lane_tests", "far_tests")},
    fitted_options=({"wave": "2"}, {"wave": "8", "growth": "2"}),
    fitted_rays=1_048_576,  # of fewer rays more of the time goes into reading triangles for the first time
)
