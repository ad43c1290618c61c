"""Forward tracing through the grid: step, test the cell's triangles, halt at the first hit."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from harness.device.runtime import cl
from harness.device.stopwatch import Stopwatch
from harness.spec.tracer_facts import TracerFacts
from harness.tracers.batch import Batch
from harness.tracers.device_tracer import DeviceOptions, DeviceTracer

EXITS = ("keep", "reject")  # what becomes of a hit beyond the exit of its cell


class ForwardOptions(DeviceOptions):
    """`exit`: whether a hit beyond the cell's exit is kept as the best so far, or rejected as in textbooks."""

    exit: Literal["keep", "reject"] = Field(default="keep", description="a hit beyond the exit of its cell")


class Forward(DeviceTracer):
    """One ray a work-item, as the paper's baseline; `lanes` > 1 tests that many triangles of a cell at a time."""

    name = "forward"
    needs_structure = True
    default_lanes = 1
    Options = ForwardOptions

    def prepare(self, batch: Batch) -> None:
        """Room for the number of cells each ray visits."""
        self.visited = cl.array.zeros(self.device.queue, batch.count, np.int32)

    def trace_batch(self, batch: Batch, watch: Stopwatch) -> None:
        """One kernel; traversal and intersection are interleaved, so there is only a total."""
        rule = {"REJECT_BEYOND_EXIT": 1} if self.options.exit == "reject" else {}
        program = self.program("tracers/forward.cl", lanes=self.lanes, walks=True, defines=rule)
        program.launch(
            "trace_forward",
            batch.count,
            *(batch.count, batch.rays, batch.keys, *self.structure.arguments),
            *(self.structure.cell_start, self.structure.references, self.triangles, batch.positions),
            *(self.visited, *self.counting),
        )


TRACER = Forward
FACTS = TracerFacts(
    order=4,
    colour="red",
    marker="s",
    kernels={"trace_forward": "forward"},
    test_kernels=("trace_forward",),
    terms={"rest": ("one", "steps", "pairs", "tests")},
    fitted_rays=65_536,
)
