"""Arranging as the paper does: walk twice, first to count, then to pack."""

from __future__ import annotations

from harness.tracers.deferred.wave import Wave


class TwoPass:
    """The paper's arrangement: the first walk counts, the second packs."""

    def __init__(self, wave: Wave):
        self.wave, tracer, batch = wave, wave.tracer, wave.batch
        self.groups = -(-wave.active_count // tracer.lanes)
        rays = (wave.active_count, wave.active, batch.rays, batch.keys)
        self.arguments = (*rays, *tracer.structure.arguments, wave.length, batch.positions, batch.t_exit)

    def walk(self) -> None:
        """Count ray visits to each cell."""
        counting = self.wave.tracer.counting
        self.wave.walk.launch("count_pairs", self.groups, *self.arguments, self.wave.bins.cell_count, *counting)

    def count(self) -> None:
        """Nothing: the first walk has counted."""

    def scatter(self) -> None:
        """Nothing: the second walk stores the pairs."""

    def walk_again(self) -> None:
        """Store each ray in the bins of its cells."""
        bins = self.wave.bins
        self.wave.walk.launch("pack_pairs", self.groups, *self.arguments, bins.cursor, bins.pairs)
