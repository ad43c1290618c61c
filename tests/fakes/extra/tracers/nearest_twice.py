"""A tracer from one file: forward tracing, asked twice."""

from __future__ import annotations

from harness.device.stopwatch import Stopwatch
from harness.tracers.batch import Batch
from harness.tracers.forward import Forward


class NearestTwice(Forward):
    """Traces forward, and once more with the best hits known, which changes none."""

    name = "nearest-twice"

    def trace_batch(self, batch: Batch, watch: Stopwatch) -> None:
        """Both passes; there is only a total."""
        super().trace_batch(batch, watch)
        super().trace_batch(batch, watch)


TRACER = NearestTwice
