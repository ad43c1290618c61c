"""Rooflines: ceilings that do their work, kernels timed by name, work counted, and rows without a check refused."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from shapes import icosphere, random_rays, soup
from traced import setting_of
from typer.testing import CliRunner

from harness import tracers
from harness.analysis.results import Results, read_published
from harness.campaign.tasks import ROOFLINE_VARIANTS
from harness.commands.main import app
from harness.data import Counters
from harness.device.program import launch_listeners
from harness.device.stopwatch import KernelWatch
from harness.errors import DefrayError
from harness.measure import group as measure
from harness.records.roofline_row import RooflineRow, roofline_file
from harness.records.schema import checked
from harness.report.figures import kernel_ceilings, time_by_kernel
from harness.spec.intersectors import INTERSECTORS
from harness.structures.grids import grid_walk_work
from harness.studies.roofline.ceilings import CHAINS, VECTORS, Ceilings
from harness.studies.roofline.instructions import triangle_loop
from harness.studies.roofline.kernel_work import KERNELS, Facts, walked_rays, work_of

VARIANTS = {
    "deferred": [{}, {"arrange": "record", "pairs": "copy"}],
    "forward": [{}],
    "work-optimal": [{}],
    "streamed": [{}],
}


def test_ceilings_copy_every_float_and_finish_every_chain(device):
    ceilings = Ceilings(device)
    count = ceilings.memory_items * VECTORS * ceilings.lanes
    ceilings.source.set(np.arange(count, dtype=np.float32))
    found = ceilings.measure()
    assert (ceilings.target.get() == ceilings.source.get()).all()
    # a/2 + 1 comes to 2, whatever a chain begins with.
    assert (ceilings.sums.get() == 2 * CHAINS * ceilings.lanes).all()
    assert ceilings.sizes.memory == 8 * count > 4 * ceilings.sizes.cache
    assert set(found) == {"memory", "cache", "fma"} and min(found.values()) > 1e6


@pytest.mark.parametrize("tracer", VARIANTS)
def test_kernels_are_timed_by_name_and_their_work_is_stated(device, tracer):
    prepared, rays = setting_of(device, soup()), random_rays(3000)
    for options in VARIANTS[tracer]:
        made = tracers.find(tracer)(prepared, INTERSECTORS["ray-space"], options)
        made.trace(rays, KernelWatch(device.queue))
        watch = KernelWatch(device.queue)
        made.trace(rays, watch)
        assert not launch_listeners
        assert {name for _, name in watch.kernels} <= set(KERNELS), (
            "say in kernel_work.py, or in the tracer's own file, what the kernel does"
        )
        assert all(time.launches and time.seconds > 0 for time in watch.kernels.values())
        for stage in watch.seconds.keys() - {"total"}:
            own = sum(time.seconds for (where, _), time in watch.kernels.items() if where == stage)
            assert own + watch.rest(stage) >= (1 - 1e-9) * watch.seconds[stage] > 0
        if tracer == "deferred":
            waves = made.count(rays).waves
            assert watch.kernels["intersect", "intersect_bins"].launches == waves
        assert ("other", "write_hits") in watch.kernels


def test_a_run_that_fails_leaves_no_kernel_and_no_listener(device):
    watch = KernelWatch(device.queue)
    with pytest.raises(ValueError), watch.total(), watch.stage("traverse"):
        Ceilings(device)
        raise ValueError
    assert not watch.kernels and not launch_listeners
    with watch.total():
        pass
    assert not watch.kernels


def test_rays_walked_in_waves_and_batches():
    counters = Counters(finished_per_wave=[3, 7, 1, 1, 3])  # ten rays in two waves, five in three
    assert walked_rays(counters, 15, 10) == (10 + 7) + (5 + 4 + 3)
    assert walked_rays(counters, 15, 10, compaction=False) == 15 * 5
    assert walked_rays(Counters(), 15, 10) == 0


FACTS = Facts(
    rays=100,
    hits=90,
    counters=Counters(steps=500, pairs=200, tests=1000, lane_tests=1600, waves=2, padding=40),
    walked=150,
    lanes=8,
    cells=50,
    references=300,
    triangles=120,
    triangle_bytes=36,
    pair_bytes=32,
    walk=grid_walk_work(9, 400, 80_000),
    test_flops=39,
)


def test_work_of_the_intersection_by_hand():
    found = work_of("intersect_bins", FACTS)
    chunks, loads = 240 // 8, 1600 // 8
    assert (found.flops, found.executed_flops) == (39_000, 62_400)
    own = 4 * chunks + 240 * 32 + 16 * 90
    assert found.uncached_bytes == own + 16 * chunks + 40 * loads
    # Both launches together read fewer triangles than the scene has, so that a cache would save nothing here.
    assert found.bytes == own + 16 * chunks + 40 * loads
    many = dataclasses.replace(FACTS, counters=FACTS.counters.model_copy(update={"lane_tests": 160_000}))
    assert work_of("intersect_bins", many).bytes == own + 16 * chunks + 2 * (4 * 300 + 36 * 120)
    gathered = work_of("intersect_bins", dataclasses.replace(FACTS, pair_bytes=4))
    assert gathered.bytes == found.bytes - 240 * 28 + 40 * 150
    assert gathered.uncached_bytes == found.uncached_bytes - 240 * 28 + 40 * 200


def test_work_of_the_walk_by_hand():
    found = work_of("record_pairs", FACTS)
    assert found.flops == found.executed_flops == 150 * 12 + 500 * 9
    rays = 150 * (4 + 32 + 8 + 8 + 4 + 8 + 4 + 4)
    assert found.uncached_bytes == rays + 500 * (4 + 8 + 4)
    assert found.bytes == rays + 2 * 400 + 500 * 8 + 200 * 4
    adaptive = work_of("record_pairs", dataclasses.replace(FACTS, walk=grid_walk_work(39, 400, 80_000)))
    assert adaptive.flops == 150 * 12 + 500 * 39
    assert (adaptive.bytes, adaptive.uncached_bytes) == (found.bytes, found.uncached_bytes)
    assert work_of("unknown", FACTS) is None


def test_work_of_a_stream_by_hand():
    found = work_of("trace_stream", FACTS)
    walk, chunks, loads = 150 * 12 + 500 * 9, 240 // 8, 1600 // 8
    assert (found.flops, found.executed_flops) == (walk + 39_000, walk + 62_400)
    ray, stop, hits = 4 + 32 + 8 + 8 + 4, 8 + 4, 90 * (8 + 4)
    bins = 200 * (4 + 2) + 40 * 4 + 240 * 4
    kept = 150 * (4 + 8 + 8 + 4 + 4)
    walked = 150 * (ray + stop) + kept + 500 * 12
    assert found.uncached_bytes == walked + hits + bins + 200 * 32 + chunks * 8 + loads * (4 + 36)
    # One launch, whatever the number of waves: each table once.
    tables = 400 + 500 * 8 + 240 * 4 + 50 + 4 * 50 + 4 * 200 + 36 * 120
    assert found.bytes == 100 * (ray + stop) + hits + tables


@pytest.mark.parametrize("name", KERNELS)
def test_no_cache_adds_traffic(name):
    for facts in (FACTS, dataclasses.replace(FACTS, pair_bytes=4, walk=grid_walk_work(9, 1 << 20, 80_000))):
        found = work_of(name, facts)
        assert 0 < found.bytes <= found.uncached_bytes
        assert found.flops <= found.executed_flops


def measured(folder, *more: str):
    """`defray roofline` of a ball."""
    mesh = icosphere(2)
    np.savez(folder / "ball.npz", vertices=mesh.reshape(-1, 3), faces=np.arange(3 * len(mesh)).reshape(-1, 3))
    arguments = ["roofline", str(folder / "ball.npz"), "--kind", "random", "--structure", "2/8"]
    return CliRunner().invoke(app, [*arguments, "--rays", "2k", "--repetitions", "2", "--out", str(folder), *more])


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Three variants measured and stored."""
    folder = tmp_path_factory.mktemp("roofline")
    done = measured(folder, "--variants", f"{ROOFLINE_VARIANTS},streamed:ray-space")
    assert done.exit_code == 0, done.output
    assert "intersect_bins" in done.stdout and "fma" in done.stdout
    return folder


def test_rows_hold_every_kernel_and_the_ceilings(stored):
    deferred, forward, streamed = roofline_file(stored).read()
    whole = {"start_rays", "trace_forward", "write_hits", "outside stages"}
    assert {kernel.name for kernel in forward.kernels} == whole
    tests, streamed_tests = (INTERSECTORS["ray-space"].flops * row.counters.tests for row in (deferred, streamed))
    (stream,) = (kernel for kernel in streamed.kernels if kernel.name == "trace_stream")
    assert stream.stage == "other" and stream.launches == 1 and stream.flops > streamed_tests
    (bins,) = (kernel for kernel in deferred.kernels if kernel.name == "intersect_bins")
    assert bins.flops == tests and bins.launches == deferred.counters.waves
    assert {kernel.name for kernel in deferred.kernels if not kernel.own} <= {
        "clear bins",
        "rest of arrange",
        "between kernels",
        "rest of compact",
        "outside stages",
    }
    assert all(len(getattr(deferred.ceilings, name).samples) == 3 * 2 for name in ("memory", "cache", "fma"))


def test_resuming_measures_nothing_again(stored, monkeypatch):
    monkeypatch.setattr("harness.studies.roofline.measured_kernels.measure_roofline", None)
    before = roofline_file(stored).path.read_bytes()
    done = measured(stored, "--variants", ROOFLINE_VARIANTS, "--resume", "--json")
    assert done.exit_code == 0, done.output
    assert [row["tracer"] for row in json.loads(done.stdout)] == ["deferred", "forward"]
    assert roofline_file(stored).path.read_bytes() == before


def test_a_row_without_a_check_or_with_too_few_times_is_refused(stored):
    row = roofline_file(stored).read()[0].as_json()
    for changed, reason in (
        ({"valid": False}, "must not have times"),
        ({"agreement": {**row["agreement"], "reference": "none"}}, "compared with a reference"),
        ({"seconds": row["seconds"][:1]}, "a time for each repetition"),
        ({"kernels": [{**row["kernels"][0], "seconds": [1.0]}]}, "a time for each repetition"),
    ):
        with pytest.raises(DefrayError, match=reason):
            checked(RooflineRow, {**row, **changed}, "here")


def test_wrong_hits_have_no_times(tmp_path, monkeypatch):
    plain = measure.Group.check

    def failed(group, run, runs):
        return plain(group, run, runs).model_copy(update={"valid": False, "reason": "made up"})

    monkeypatch.setattr(measure.Group, "check", failed)
    done = measured(tmp_path, "--variants", "forward:ray-space")
    assert done.exception.exit_code == 1 and "check failed" in str(done.exception)
    (row,) = roofline_file(tmp_path).read()
    assert row.kernels == row.seconds == [] and not row.valid


@pytest.mark.parametrize(
    "more, reason",
    [
        (("--variants", "embree"), "embree has no kernels on a device"),
        (("--variants", ","), "names no variant"),
        (("--check", "none"), "times need a check"),
    ],
)
def test_what_cannot_be_measured_is_one_clear_line(tmp_path, more, reason):
    done = measured(tmp_path, *more)
    assert isinstance(done.exception, DefrayError) and reason in str(done.exception)


@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("figure", [kernel_ceilings, time_by_kernel])
def test_figures_are_drawn_from_stored_rows(stored, figure, narrow):
    device = roofline_file(stored).read()[0].machine.device
    runs = Results([], stored, device, read_published())
    numbers = figure.select(runs)
    assert len(numbers) and set(numbers["runs"]) == {row.id for row in runs.roofline}
    figure.draw(runs, numbers, narrow).draw_without_rendering()
    assert figure.caption(runs, numbers)
    assert figure.select(Results([], stored, "another device", read_published())).empty


LISTING = """
    1000:  vmovaps 0x20(%rsp),%ymm1
    1004:  vmulps %ymm1,%ymm2,%ymm3
    1008:  inc    %eax
    100a:  jne    1008 <name+0x8>
    100c:  vfmadd231ps (%rsp),%ymm2,%ymm3
    1010:  vsubps %ymm1,%ymm2,%ymm3
    1014:  cmp    %eax,%ecx
    1016:  jb     100c <name+0xc>
    1018:  jmp    1000 <name>
"""


def test_the_loop_over_triangles_is_the_innermost_with_most_arithmetic():
    found = triangle_loop(LISTING)
    assert (found.instructions, found.arithmetic, found.stack) == (4, 2, 1)
    with pytest.raises(DefrayError, match="no loop"):
        triangle_loop("    1000:  ret\n")
