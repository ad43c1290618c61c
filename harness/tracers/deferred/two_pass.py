"""Arranging the pairs of one wave by cell: walk twice, or walk once and remember."""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.device.program import Program
from harness.tracers.batch import Batch
from harness.tracers.deferred.bins import Bins

if TYPE_CHECKING:
    from harness.tracers.deferred.tracer import Deferred


class TwoPass:
    """The paper's arrangement: the first walk counts, the second packs."""

    def __init__(
        self, tracer: Deferred, batch: Batch, walk: Program, bins: Bins, active, active_count: int, length: int
    ):
        self.tracer, self.batch, self.program, self.bins = tracer, batch, walk, bins
        self.groups = -(-active_count // tracer.lanes)
        rays = (active_count, active, batch.rays, batch.keys)
        self.arguments = (*rays, *tracer.grid.arguments, length, batch.positions, batch.t_exit)

    def walk(self) -> None:
        """Count ray visits to each cell."""
        counting = self.tracer.counting
        self.program.launch("count_pairs", self.groups, *self.arguments, self.bins.cell_count, *counting)

    def count(self) -> None:
        """Nothing: the first walk has counted."""

    def scatter(self) -> None:
        """Nothing: the second walk stores the pairs."""

    def walk_again(self) -> None:
        """Store each ray in the bins of its cells."""
        self.program.launch("pack_pairs", self.groups, *self.arguments, self.bins.cursor, self.bins.pairs)
