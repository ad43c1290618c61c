"""The sorted arrangement: pairs in the order of their cells, none lost, by either sort."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shapes import random_rays, soup
from traced import hits_of, setting_of

from harness import tracers
from harness.device.stopwatch import Stopwatch
from harness.spec.intersectors import INTERSECTORS
from harness.spec.structure import Uniform
from harness.tracers.deferred import sort as _sort
from harness.tracers.deferred.sort import SortedRecording


@pytest.fixture
def sorted_pairs(monkeypatch):
    """(recorded pairs as a set of each wave, sorted pairs uint64[n]) of every wave that is traced."""
    waves = []
    count = SortedRecording.count

    def watched(self):
        count(self)
        recorded = []
        for s in self.segments:
            cells, lengths, active = s.cells.get(), s.lengths.get(), s.active.get()
            for a in range(s.count):
                met = cells[a * s.slots : a * s.slots + lengths[a]]
                recorded += [(int(cell) << 32) | int(active[a]) for cell in met]
        waves.append((np.array(recorded, np.uint64), self.sorted.get().view(np.uint64)[: self.pairs]))

    monkeypatch.setattr(SortedRecording, "count", watched)
    return waves


@pytest.mark.parametrize("sorter", ["blocks", "library"])
@pytest.mark.parametrize("wave", ["4", "40"])
@pytest.mark.parametrize("most_bits", [3, 10])
def test_pairs_are_sorted_by_cell_and_none_is_lost(device, monkeypatch, sorted_pairs, sorter, wave, most_bits):
    monkeypatch.setattr(_sort, "MOST_DIGIT_BITS", most_bits)
    monkeypatch.setattr(_sort, "LEAST_BLOCK", 64)
    triangles, rays = soup(), random_rays(1500)
    prepared = setting_of(device, triangles, Uniform(4, 16))
    chosen = dataclasses.replace(device, is_cpu=sorter == "blocks")
    made = tracers.find("deferred")(
        dataclasses.replace(prepared, device=chosen), INTERSECTORS["ray-space"], {"arrange": "sort", "wave": wave}
    )
    hits = made.trace(rays, Stopwatch(device.queue))
    assert hits.tobytes() == hits_of(prepared, rays, "brute").tobytes()
    assert len(sorted_pairs) >= 1 and len(sorted_pairs[0][0]) > len(rays)
    for recorded, found in sorted_pairs:
        assert (np.diff((found >> np.uint64(32)).astype(np.int64)) >= 0).all()
        assert (np.sort(found) == np.sort(recorded)).all()


def test_sorting_is_timed_as_arranging(device):
    prepared = setting_of(device, soup())
    made = tracers.find("deferred")(prepared, INTERSECTORS["ray-space"], {"arrange": "sort"})
    watch = Stopwatch(device.queue)
    made.trace(random_rays(20_000), watch)
    assert 0 < watch.seconds["arrange"] < watch.seconds["total"]


@pytest.mark.parametrize("arrange", ["two-pass", "record", "sort"])
def test_the_devices_memory_does_not_grow_with_the_number_of_rays(device, monkeypatch, arrange):
    prepared = setting_of(device, soup())
    used = {}
    for batches in (1, 4):
        made = tracers.find("deferred")(prepared, INTERSECTORS["ray-space"], {"arrange": arrange, "batch": "1000"})
        rays = random_rays(1000)
        rays = dataclasses.replace(rays, **{
            name: np.concatenate([getattr(rays, name)] * batches) for name in ("origins", "directions", "t_max")
        })  # fmt: skip
        hits = made.trace(rays, Stopwatch(device.queue))
        assert len(hits) == 1000 * batches
        used[batches] = made.buffers.sizes()
    assert used[4] == used[1] and used[1]
