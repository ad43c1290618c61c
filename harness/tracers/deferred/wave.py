"""One wave of the deferred tracer: the rays that are walked and the bins that they fill."""

from __future__ import annotations

from dataclasses import dataclass

from harness.device.program import Program
from harness.device.runtime import cl
from harness.tracers.batch import Batch
from harness.tracers.deferred.bins import Bins
from harness.tracers.device_tracer import DeviceTracer


@dataclass(eq=False)
class Wave:
    """What an arrangement works on. `active` int32[active_count or more]: the unfinished rays of the batch; `length`:
    cells that each of them is walked through at most; `walk`: the program that walks them."""

    tracer: DeviceTracer
    batch: Batch
    walk: Program
    bins: Bins
    active: cl.array.Array
    active_count: int
    length: int
