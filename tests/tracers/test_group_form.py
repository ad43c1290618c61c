"""The intersector's form for GPUs gives the same bits as the one in lanes, whatever the bins."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shapes import REPRESENTATIVE, icosphere, random_rays, soup
from traced import SCENES, brute_hits, hits_of, setting_of, shared_scene_in

from harness import tracers
from harness.data import Rays
from harness.errors import DefrayError
from harness.spec.intersectors import INTERSECTORS
from harness.spec.structure import Uniform
from harness.tracers.deferred.bins_packed import GROUP


@pytest.mark.parametrize("intersector", REPRESENTATIVE)
@pytest.mark.parametrize("name", SCENES)
def test_groups_agree_with_brute_force_bit_for_bit(device, name, intersector):
    prepared, expected = shared_scene_in(device, name, Uniform(2, 6)), brute_hits(device, name, intersector)
    hits = hits_of(prepared, SCENES[name][1], "deferred", intersector, form="group")
    assert (expected.primitive >= 0).any()
    assert hits.tobytes() == expected.tobytes()


@pytest.mark.parametrize("arrange", ["two-pass", "record", "sort"])
@pytest.mark.parametrize("pairs", ["index", "copy"])
def test_options_of_a_group_change_no_bit(device, arrange, pairs):
    prepared = shared_scene_in(device, "soup")
    for count in (1, GROUP - 1, GROUP + 1, 3000):
        rays = random_rays(count)
        hits = hits_of(prepared, rays, "deferred", form="group", arrange=arrange, pairs=pairs, wave="2")
        assert hits.tobytes() == hits_of(prepared, rays, "brute").tobytes(), count


@pytest.mark.parametrize("cells", [1, 2])
def test_bins_longer_than_a_group_and_lists_longer_than_a_tile(device, cells):
    """One cell for all, where every group shares its cell, and few cells, where some groups straddle two."""
    triangles, rays = icosphere(3), random_rays(5 * GROUP + 3, low=-1.5, high=1.5)
    assert len(triangles) > 4 * GROUP
    prepared = setting_of(device, triangles, Uniform(cells, cells))
    hits = hits_of(prepared, rays, "deferred", form="group")
    assert hits.tobytes() == hits_of(prepared, rays, "brute").tobytes()


def test_equal_t_goes_to_the_lower_primitive_in_groups_too(device):
    prepared = setting_of(device, np.concatenate([soup(20), soup(20)]))
    assert hits_of(prepared, random_rays(500), "deferred", form="group").primitive.max() < 20


def test_groups_count_the_same_work_without_padding(device):
    prepared, rays = shared_scene_in(device, "soup"), SCENES["soup"][1]
    found = {
        form: tracers.find("deferred")(prepared, INTERSECTORS["ray-space"], {"form": form}).count(rays)
        for form in ("lanes", "group")
    }
    for name in ("steps", "pairs", "tests", "waves"):
        assert getattr(found["group"], name) == getattr(found["lanes"], name)
    assert found["lanes"].padding > 0 and found["group"].padding == 0
    # Idle work-items of the last group test along only where the group shares its cell.
    assert found["group"].tests <= found["group"].lane_tests < 1.05 * found["group"].tests


def test_a_gpu_takes_groups_and_a_cpu_lanes(device):
    prepared = setting_of(device, soup(10))
    for is_cpu, native, options, expected in (
        (True, 8, {}, False), (False, 1, {}, True), (False, 1, {"form": "lanes"}, False),
        (True, 8, {"form": "group"}, True), (True, 8, {"lanes": "1"}, False), (False, 1, {"lanes": "8"}, False),
    ):  # fmt: skip
        other = dataclasses.replace(device, is_cpu=is_cpu, native_lanes=native)
        made = tracers.find("deferred")(dataclasses.replace(prepared, device=other), None, options)
        assert made.in_groups == expected and (made.lanes == 1 or not expected), (is_cpu, options)


def test_a_whole_trace_as_on_a_gpu(device):
    """One lane, the library's sort, groups: what a device that is no CPU runs by default."""
    prepared, rays = shared_scene_in(device, "sphere"), SCENES["sphere"][1]
    gpu = dataclasses.replace(prepared, device=dataclasses.replace(device, is_cpu=False, native_lanes=1))
    for arrange in ("two-pass", "record", "sort"):
        hits = hits_of(gpu, rays, "deferred", arrange=arrange)
        assert hits.tobytes() == brute_hits(device, "sphere").tobytes()


def test_a_group_of_several_lanes_is_refused(device):
    rays = Rays(*(np.zeros((1, 3), np.float32) for _ in range(2)), np.ones(1, np.float32))
    with pytest.raises(DefrayError, match=r"option form=group of deferred: .*one lane"):
        hits_of(setting_of(device, soup(10)), rays, "deferred", form="group", lanes="8")
