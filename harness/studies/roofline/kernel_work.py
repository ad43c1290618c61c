"""What each kernel computes and moves, from exact counters and the sizes of arrays: flops and bytes for a roofline.

Flops follow the rule of kernels/intersect.clh: + - * and a division one each, fma two, comparisons, selections,
minima and everything on integers none. Bytes are counted twice: `bytes`, the least that any cache could leave, each
table once a launch; `uncached_bytes`, every load and store as the kernel states it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

from harness.data import Counters
from harness.records.roofline_row import KernelWork
from harness.structures.contract import WalkWork

RAY, KEY, POSITION, EXIT, INDEX = 32, 8, 8, 4, 4  # bytes a ray


@dataclass(frozen=True)
class Facts:
    """A run's exact counts and the sizes of what its kernels read.

    `walked`: rays walked, added up over the waves. `chunks`: groups of `lanes` pairs of one cell. `walk`: what
    walking the structure computes and reads, None for tracers that walk none. `cells`: non-empty ones.
    `triangle_bytes`: of one triangle as stored. `pair_bytes`: of one pair in its bin. `test_flops`: of one
    ray-triangle test.
    """

    rays: int
    hits: int
    counters: Counters
    walked: int
    lanes: int
    cells: int
    references: int
    triangles: int
    triangle_bytes: int
    pair_bytes: int
    walk: WalkWork | None
    test_flops: int

    @property
    def waves(self) -> int:
        """Launches of each kernel of a wave; one for tracers without waves."""
        return max(self.counters.waves, 1)

    @property
    def chunks(self) -> int:
        """Chunks of all waves."""
        return (self.counters.pairs + self.counters.padding) // self.lanes

    def table(self, size: int, read: int) -> int:
        """The least traffic of reading `read` bytes out of a table of `size`, once a wave."""
        return min(size * self.waves, read)


def walked_rays(counters: Counters, rays: int, batch: int, compaction: bool = True) -> int:
    """Rays at the beginning of each wave, added up over waves and batches of `batch` rays."""
    if not compaction:
        return rays * max(len(counters.finished_per_wave), 1)
    total, left, active = 0, rays, 0
    for finished in counters.finished_per_wave:
        if not active:
            active = min(batch, left)
            left -= active
        total += active
        active -= finished
    return total


def work_of(kernel: str, facts: Facts) -> KernelWork | None:
    """What a kernel did in the whole run; None for one whose work is not stated here."""
    return KERNELS[kernel](facts) if kernel in KERNELS else None


def _plain(flops: int, moved: int, uncached: int | None = None) -> KernelWork:
    return _work(flops, flops, moved, moved if uncached is None else uncached)


def _work(flops: int, executed: int, least: int, most: int) -> KernelWork:
    return KernelWork(flops=flops, executed_flops=executed, bytes=least, uncached_bytes=most)


def _tables(f: Facts) -> int:
    """The structure's tables, as steps read them."""
    return sum(f.table(size, read * f.counters.steps) for size, read in f.walk.tables)


def _step_bytes(f: Facts) -> int:
    return sum(read for _, read in f.walk.tables)


def _walk(f: Facts, stored: int, stored_uncached: int) -> KernelWork:
    """A walk of all active rays: records of the rays, the grid, and what is stored of the pairs."""
    flops = f.walked * f.walk.ray_flops + f.counters.steps * f.walk.step_flops
    rays = f.walked * (INDEX + RAY + KEY + POSITION + EXIT)
    return _plain(flops, rays + _tables(f) + stored, rays + _step_bytes(f) * f.counters.steps + stored_uncached)


def _stops(f: Facts) -> int:
    """Where each ray stopped."""
    return f.walked * (POSITION + EXIT)


def _counts(f: Facts) -> int:
    """Counts of the bins raised by one a pair, read and written."""
    return 2 * f.table(4 * f.cells, 4 * f.counters.pairs)


def _count_pairs(f: Facts) -> KernelWork:
    return _walk(f, _counts(f), 8 * f.counters.pairs)


def _pack_pairs(f: Facts) -> KernelWork:
    pairs = f.counters.pairs * f.pair_bytes
    return _walk(f, _stops(f) + _counts(f) + pairs, _stops(f) + 8 * f.counters.pairs + pairs)


def _record_pairs(f: Facts) -> KernelWork:
    """Each step stores its cell, a pair's stays; the number of cells a ray."""
    kept = _stops(f) + 4 * f.walked
    return _walk(f, kept + 4 * f.counters.pairs, kept + 4 * f.counters.steps)


def _rank_pairs(f: Facts) -> KernelWork:
    """Cells read, ranks written, counts raised."""
    own = 4 * f.walked + 8 * f.counters.pairs
    return _plain(0, own + _counts(f), own + 8 * f.counters.pairs)


def _lay_out_bins(f: Facts) -> KernelWork:
    """Counts and offsets read, cursors and cells of chunks written."""
    return _plain(0, 12 * f.cells * f.waves + 4 * f.chunks)


def _count_chunks(f: Facts) -> KernelWork:
    """Counts read."""
    return _plain(0, 4 * f.cells * f.waves)


def _join_blocks(f: Facts) -> KernelWork:
    """Unfinished rays read and written."""
    return _plain(0, 8 * max(f.walked - f.rays, 0))


def _scatter_pairs(f: Facts) -> KernelWork:
    """Cells and ranks read, offsets looked up, pairs written; a copied ray is read once."""
    ray = RAY + KEY if f.pair_bytes > 4 else 0
    own = f.walked * (INDEX + 4 + ray) + f.counters.pairs * (8 + f.pair_bytes)
    return _plain(0, own + f.table(4 * f.cells, 4 * f.counters.pairs), own + 4 * f.counters.pairs)


def _prefix_sum(f: Facts) -> KernelWork:
    return _plain(0, 8 * f.cells * f.waves)


def _clear_bins(f: Facts) -> KernelWork:
    return _plain(0, 4 * f.cells * f.waves)


def _compaction(f: Facts) -> KernelWork:
    """State of each ray read, unfinished ones kept."""
    return _plain(0, f.walked * (INDEX + POSITION + KEY + EXIT) + 4 * max(f.walked - f.rays, 0))


def _test_tables(f: Facts, loads: int) -> int:
    """References and triangles, for so many loads of one triangle."""
    return f.table(4 * f.references, 4 * loads) + f.table(f.triangle_bytes * f.triangles, f.triangle_bytes * loads)


def _intersect_bins(f: Facts) -> KernelWork:
    """A chunk loads its pairs once and each triangle of its cell once, for all of its lanes.

    Of keys only one update a hit is counted: how often a hit gives way to a nearer one is not. Chunks of few rays, a
    triangle a lane, load up to `lanes` times as much as is counted here.
    """
    loads = f.counters.lane_tests // f.lanes
    own = 4 * f.chunks + f.chunks * f.lanes * f.pair_bytes + 2 * KEY * f.hits
    gathered = 0 if f.pair_bytes > 4 else RAY + KEY
    least = f.table(12 * f.cells, 16 * f.chunks) + min(gathered * f.walked, gathered * f.counters.pairs)
    most = 16 * f.chunks + gathered * f.counters.pairs + loads * (4 + f.triangle_bytes)
    tests = f.counters.tests * f.test_flops
    return _work(tests, f.counters.lane_tests * f.test_flops, own + least + _test_tables(f, loads), own + most)


def _trace_stream(f: Facts) -> KernelWork:
    """All waves in one launch, which could read each table once. Every wave reads its rays, keeps where they stopped
    and which are left. A pair takes a slot and the fill of its bin, which its chunk reads; chunks as in
    `intersect_bins`, with gathered rays. The list of bins to empty is left out.
    """
    c, once = f.counters, replace(f, counters=f.counters.model_copy(update={"waves": 1}))
    slots, loads = f.chunks * f.lanes, c.lane_tests // f.lanes
    flops = f.walked * f.walk.ray_flops + c.steps * f.walk.step_flops
    state, stop, hits = INDEX + RAY + KEY + POSITION + EXIT, POSITION + EXIT, f.hits * (KEY + 4)
    bins = once.table(4 * f.lanes * f.cells, 4 * slots) + once.table(f.cells, c.pairs)
    least = f.rays * (state + stop) + hits + _tables(once) + bins
    least += once.table(4 * f.cells, 8 * f.chunks) + _test_tables(once, loads)
    kept = f.walked * (INDEX + POSITION + KEY + EXIT + INDEX)
    most = f.walked * (state + stop) + kept + hits + _step_bytes(f) * c.steps
    most += 6 * c.pairs + 4 * c.padding + 4 * slots + RAY * c.pairs + 8 * f.chunks + loads * (4 + f.triangle_bytes)
    executed = flops + c.lane_tests * f.test_flops
    return _work(flops + c.tests * f.test_flops, executed, least, most)


def _cells_one_by_one(f: Facts, rays: int, flops: int, tables: int, tables_uncached: int) -> KernelWork:
    """Rays that test each triangle of their cells on their own."""
    c = f.counters
    least = tables + f.table(4 * f.cells, 8 * c.pairs) + _test_tables(f, c.tests)
    most = tables_uncached + 8 * c.pairs + 4 * c.tests + f.triangle_bytes * c.lane_tests
    executed = flops + c.lane_tests * f.test_flops
    return _work(flops + c.tests * f.test_flops, executed, rays + least, rays + most)


def _trace_forward(f: Facts) -> KernelWork:
    flops = f.rays * f.walk.ray_flops + f.counters.steps * f.walk.step_flops
    rays = f.rays * (RAY + 2 * KEY + POSITION + 4)
    return _cells_one_by_one(f, rays, flops, _tables(f), _step_bytes(f) * f.counters.steps)


def _intersect_visited(f: Facts) -> KernelWork:
    rays = f.rays * (RAY + 2 * KEY + 8) + 4 * f.counters.pairs
    return _cells_one_by_one(f, rays, 0, 0, 0)


def _start_rays(f: Facts) -> KernelWork:
    return _plain(f.rays * f.walk.start_flops, f.rays * (28 + RAY + KEY + POSITION + EXIT))


def _start_without_grid(f: Facts) -> KernelWork:
    return _plain(4 * f.rays, f.rays * (28 + RAY + KEY))


def _write_hits(f: Facts) -> KernelWork:
    """Ray, key and triangle read, t, primitive, u and v written; the test repeated, its hit's own flops left out."""
    triangles = f.triangle_bytes * f.hits
    rays = f.rays * (RAY + KEY + 16)
    least = rays + min(f.triangle_bytes * f.triangles, triangles)
    return _work(f.hits * f.test_flops, f.rays * f.test_flops, least, rays + triangles)


# Kernels by name, and the parts of a stage that are not kernels of this project.
KERNELS: dict[str, Callable[[Facts], KernelWork]] = {
    "start_rays": _start_rays,
    "start_rays_without_grid": _start_without_grid,
    "count_pairs": _count_pairs,
    "pack_pairs": _pack_pairs,
    "record_pairs": _record_pairs,
    "rank_pairs": _rank_pairs,
    "lay_out_bins": _lay_out_bins,
    "count_chunks": _count_chunks,
    "lay_out_blocks": _lay_out_bins,  # offsets are written instead of read
    "keep_in_blocks": _compaction,
    "join_blocks": _join_blocks,
    "scatter_pairs": _scatter_pairs,
    "intersect_bins": _intersect_bins,
    "trace_stream": _trace_stream,
    "trace_forward": _trace_forward,
    "intersect_visited": _intersect_visited,
    "write_hits": _write_hits,
    "clear bins": _clear_bins,
    "prefix sum": _prefix_sum,
    "compaction": _compaction,
}
# What the time of a stage beyond its kernels is called: fills, library scans, and waiting for the host. Where a stage
# has the kernel of WITHOUT_LIBRARY, no scan is in it.
RESTS = {
    "traverse": "clear bins",
    "arrange": "prefix sum",
    "compact": "compaction",
    "intersect": "between kernels",
    "other": "outside stages",
}
WITHOUT_LIBRARY = {"arrange": "lay_out_blocks", "compact": "keep_in_blocks"}


def rest_name(stage: str, kernels: Collection[str]) -> str:
    """Name of what a stage takes beyond its kernels, given the names of all kernels."""
    if WITHOUT_LIBRARY.get(stage) in kernels:
        return f"rest of {stage}"
    return RESTS.get(stage, f"rest of {stage}")
