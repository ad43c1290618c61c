"""The tracer that bins in streams: no option changes a bit, counts repeat, few rays against many triangles agree."""

from __future__ import annotations

import pytest
from shapes import aimed_rays, every_intersector, random_rays, soup
from test_adaptive import MESHES, SPECS
from test_adaptive import setting_of as adaptive_setting
from test_tracers import hits_of, setting_of

from harness import tracers
from harness.data import GridSpec
from harness.intersectors import INTERSECTORS


@pytest.mark.parametrize("lanes", ["1", "4", "8", "16"])
@pytest.mark.parametrize("wave", ["1", "6", "64"])
@pytest.mark.parametrize("streams", ["1", "3"])
@pytest.mark.parametrize("growth", ["1", "2"])
def test_options_change_no_bit(device, lanes, wave, streams, growth):
    mesh, rays = MESHES["clumps"]
    setting = adaptive_setting(device, mesh, SPECS[1])
    options = {"lanes": lanes, "wave": wave, "streams": streams, "growth": growth}
    expected = hits_of(setting, rays, "brute")
    assert (expected.primitive >= 0).any()
    assert hits_of(setting, rays, "streamed", **options).tobytes() == expected.tobytes()


@pytest.mark.parametrize("batch", ["64", "1000", "4096"])
def test_batches_change_no_bit(device, batch):
    mesh, rays = MESHES["soup"]
    setting = adaptive_setting(device, mesh)
    assert hits_of(setting, rays, "streamed", batch=batch).tobytes() == hits_of(setting, rays, "brute").tobytes()


@pytest.mark.parametrize("intersector", every_intersector())
@pytest.mark.parametrize("count", [1, 2, 3, 7, 9, 40])
@pytest.mark.parametrize("tracer", ["deferred", "streamed"])
def test_few_rays_against_many_triangles_a_cell(device, intersector, count, tracer):
    """Chunks that are not full are tested a triangle a lane; of two equal hits the lower number is kept."""
    mesh = soup(400, size=0.6)
    mesh[200:] = mesh[:200]  # every hit is a tie
    rays = aimed_rays(mesh, (0.5, 0.5, 0.5), count)
    setting = setting_of(device, mesh, GridSpec(1, 2))
    expected = hits_of(setting, rays, "brute", intersector)
    assert (expected.primitive >= 0).any() and expected.primitive.max() < 200
    assert hits_of(setting, rays, tracer, intersector, lanes="8").tobytes() == expected.tobytes()


def test_idle_lanes_of_few_rays_are_counted(device):
    """One ray in one cell of n triangles: n tests, in whole vectors of triangles rather than n vectors of rays."""
    mesh = soup(100, size=0.9)
    setting = setting_of(device, mesh, GridSpec(1, 1))
    for tracer in ("deferred", "streamed"):
        counts = tracers.find(tracer)(setting, INTERSECTORS["ray-space"], {"lanes": "8"}).count(
            aimed_rays(mesh, (0.5, 0.5, 0.5), 1)
        )
        assert counts.tests == 100 and counts.lane_tests == 104


def test_counts_repeat_and_steps_and_pairs_are_those_of_deferred(device):
    mesh, rays = MESHES["clumps"]
    setting = adaptive_setting(device, mesh)
    options = {"wave": "4", "growth": "1"}
    streamed, again, deferred = (
        tracers.find(name)(setting, INTERSECTORS["ray-space"], options).count(rays)
        for name in ("streamed", "streamed", "deferred")
    )
    assert streamed == again
    assert (streamed.steps, streamed.pairs, streamed.tests) == (deferred.steps, deferred.pairs, deferred.tests)


def test_more_streams_than_blocks_of_rays_is_no_matter(device):
    rays = random_rays(5)
    setting = setting_of(device, soup(), GridSpec(2, 8))
    assert hits_of(setting, rays, "streamed", streams="64").tobytes() == hits_of(setting, rays, "brute").tobytes()
