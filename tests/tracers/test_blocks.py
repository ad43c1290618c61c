"""What a CPU does in blocks instead of the library's scans: list compaction, and the layout of bins."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from shapes import random_rays, soup

from harness import tracers
from harness.data import Scene, differing
from harness.device.runtime import cl
from harness.device.stopwatch import Stopwatch
from harness.spec.intersectors import INTERSECTORS
from harness.spec.structure import Uniform
from harness.tracers.deferred.bins import Bins
from harness.tracers.deferred.compaction import BLOCKS, blocks_of, compact
from harness.tracers.prepared import Prepared

LEFT_GRID = 2**64 - 1


@pytest.mark.parametrize("count", [1, 2, BLOCKS - 1, BLOCKS, BLOCKS + 1, 3 * BLOCKS + 7, 5000])
def test_blocks_cover_a_list_once(count):
    blocks, size = blocks_of(count)
    assert (blocks - 1) * size < count <= blocks * size and blocks <= BLOCKS


@pytest.mark.parametrize("is_cpu", [True, False])
@pytest.mark.parametrize("count", [1, BLOCKS - 1, BLOCKS + 1, 5000])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_compaction_keeps_the_unfinished_rays_in_order(device, is_cpu, count, share):
    generator = np.random.default_rng(count)
    active = generator.permutation(count + 50)[:count].astype(np.int32)
    gone, hit = generator.random((2, count + 50)) < share
    t_exit = np.full(count + 50, 2.0, np.float32)
    best_t = np.where(hit, 1.0, 3.0).astype(np.float32)
    arrays = {
        "positions": np.where(gone, np.uint64(LEFT_GRID), np.uint64(7)),
        "keys": best_t.view(np.uint32).astype(np.uint64) << np.uint64(32),
        "t_exit": t_exit,
    }
    batch = SimpleNamespace(**{name: cl.array.to_device(device.queue, value) for name, value in arrays.items()})
    listed, kept = cl.array.to_device(device.queue, active), cl.array.empty(device.queue, count, np.int32)
    found = compact(dataclasses.replace(device, is_cpu=is_cpu), listed, kept, batch, count)
    expected = active[~(gone | hit)[active]]
    assert kept.get()[:found].tolist() == expected.tolist()


@pytest.mark.parametrize("fullest", [1, 9, 1000])
def test_bins_are_laid_out_in_blocks_as_by_the_librarys_scan(device, fullest):
    prepared = Prepared.on_device(Scene("soup", soup(700)), device)
    prepared = prepared.with_structure(Uniform(2, 16))
    counts = np.random.default_rng(fullest).integers(0, fullest + 1, prepared.structure.nonempty + 1).astype(np.int32)
    laid_out = []
    for is_cpu in (True, False):
        other = dataclasses.replace(device, is_cpu=is_cpu)
        options = {"lanes": "8", "form": "lanes"}
        tracer = tracers.find("deferred")(
            dataclasses.replace(prepared, device=other), INTERSECTORS["ray-space"], options
        )
        bins = Bins(tracer)
        bins.cell_count[: len(counts)].set(counts)
        bins.lay_out()
        cells = bins.cells
        chunks = -(-counts[:cells] // 8)
        assert bins.chunks == chunks.sum() > 0
        assert bins.chunk_start.get()[: cells + 1].tolist() == [0, *np.cumsum(chunks).tolist()]
        assert bins.chunk_cell.get()[: bins.chunks].tolist() == np.repeat(np.arange(cells), chunks).tolist()
        laid_out.append(bins.cursor.get()[:cells].tolist())
    assert laid_out[0] == laid_out[1] == (8 * np.cumsum([0, *chunks[:-1]])).tolist()


@pytest.mark.parametrize("pairs", ["index", "copy"])
@pytest.mark.parametrize(("lanes", "form"), [("1", "lanes"), ("8", "lanes"), ("1", "group")])
def test_what_lies_in_the_unused_slots_of_bins_is_never_tested(device, pairs, lanes, form):
    """Rays of an earlier trace have hits of their own, which fewer, later rays must not get."""
    prepared = Prepared.on_device(Scene("soup", soup(700)), device)
    prepared = prepared.with_structure(Uniform(2, 16))
    options = {"lanes": lanes, "form": form, "pairs": pairs, "arrange": "record"}

    def fresh():
        return tracers.find("deferred")(prepared, INTERSECTORS["ray-space"], options)

    used = fresh()
    earlier = used.trace(random_rays(3000, seed=1), Stopwatch(device.queue))
    assert np.isfinite(earlier.t).any()
    few = random_rays(53, seed=2)
    assert not differing(used.trace(few, Stopwatch(device.queue)), fresh().trace(few, Stopwatch(device.queue)))
