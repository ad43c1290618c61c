"""The tracer that bins in streams: no option changes a bit, counts repeat, few rays against many triangles agree."""

from __future__ import annotations

import numpy as np
import pytest
from adaptive_grids import SPECS
from shapes import every_intersector, random_rays, soup
from traced import MESHES, brute_hits, hits_of, setting_of, shared_scene_in

from harness import tracers
from harness.data import Rays
from harness.spec.intersectors import INTERSECTORS
from harness.spec.structure import Uniform


def at_centres(mesh, count) -> Rays:
    """Rays from outside at the centres of the first triangles."""
    origins = np.full((count, 3), -1, np.float32)
    directions = mesh[:count].mean(axis=1) - origins
    return Rays(origins, directions, np.full(count, np.inf, np.float32))


@pytest.mark.parametrize("lanes", ["1", "4", "8", "16"])
@pytest.mark.parametrize("wave", ["1", "6", "64"])
@pytest.mark.parametrize("streams", ["1", "3"])
@pytest.mark.parametrize("growth", ["1", "2"])
def test_options_change_no_bit(device, lanes, wave, streams, growth):
    prepared, expected = shared_scene_in(device, "clumps", SPECS[1]), brute_hits(device, "clumps")
    options = {"lanes": lanes, "wave": wave, "streams": streams, "growth": growth}
    assert (expected.primitive >= 0).any()
    assert hits_of(prepared, MESHES["clumps"][1], "streamed", **options).tobytes() == expected.tobytes()


@pytest.mark.parametrize("batch", ["64", "1000", "4096"])
def test_batches_change_no_bit(device, batch):
    hits = hits_of(shared_scene_in(device, "soup", SPECS[0]), MESHES["soup"][1], "streamed", batch=batch)
    assert hits.tobytes() == brute_hits(device, "soup").tobytes()


@pytest.mark.parametrize("intersector", every_intersector())
@pytest.mark.parametrize("count", [1, 2, 3, 7, 9, 40])
@pytest.mark.parametrize("tracer", ["deferred", "streamed"])
def test_few_rays_against_many_triangles_a_cell(device, intersector, count, tracer):
    """Chunks that are not full are tested a triangle a lane; of two triangles with the same hit the lower counts."""
    mesh = soup(400, size=0.6)
    mesh[200:] = mesh[:200]  # every hit is a tie
    rays = at_centres(mesh, count)
    prepared = setting_of(device, mesh, Uniform(1, 2))
    expected = hits_of(prepared, rays, "brute", intersector)
    assert (expected.primitive >= 0).any() and expected.primitive.max() < 200
    assert hits_of(prepared, rays, tracer, intersector, lanes="8").tobytes() == expected.tobytes()


def test_idle_lanes_of_few_rays_are_counted(device):
    """One ray in one cell of n triangles: n tests, in whole vectors of triangles rather than n vectors of rays."""
    mesh = soup(100, size=0.9)
    prepared = setting_of(device, mesh, Uniform(1, 1))
    for tracer in ("deferred", "streamed"):
        counts = tracers.find(tracer)(prepared, INTERSECTORS["ray-space"], {"lanes": "8"}).count(at_centres(mesh, 1))
        assert counts.tests == 100 and counts.lane_tests == 104


def test_counts_repeat_and_steps_and_pairs_are_those_of_deferred(device):
    prepared, rays = shared_scene_in(device, "clumps", SPECS[0]), MESHES["clumps"][1]
    options = {"wave": "4", "growth": "1"}
    streamed, again, deferred = (
        tracers.find(name)(prepared, INTERSECTORS["ray-space"], options).count(rays)
        for name in ("streamed", "streamed", "deferred")
    )
    assert streamed == again
    assert (streamed.steps, streamed.pairs, streamed.tests) == (deferred.steps, deferred.pairs, deferred.tests)


@pytest.mark.parametrize("growth", ["1", "2"])
@pytest.mark.parametrize("batch", ["2048", "4096"])
def test_one_stream_counts_waves_and_padding_as_deferred_does(device, growth, batch):
    """Its bins hold what those of the other hold at the end of a wave; more streams share them, so they pad more."""
    prepared, rays = shared_scene_in(device, "clumps", SPECS[0]), MESHES["clumps"][1]
    common = {"wave": "2", "growth": growth, "batch": batch, "lanes": "8"}

    def counted(name, **options):
        return tracers.find(name)(prepared, INTERSECTORS["ray-space"], common | options).count(rays)

    one, three, deferred = counted("streamed", streams="1"), counted("streamed", streams="3"), counted("deferred")
    assert one.finished_per_wave == three.finished_per_wave == deferred.finished_per_wave
    assert one.padding == deferred.padding > 0 and one.lane_tests == deferred.lane_tests
    assert three.padding > one.padding and three.pairs == one.pairs


def test_more_streams_than_blocks_of_rays_is_no_matter(device):
    rays = random_rays(5)
    prepared = setting_of(device, soup(), Uniform(2, 8))
    assert hits_of(prepared, rays, "streamed", streams="64").tobytes() == hits_of(prepared, rays, "brute").tobytes()
