"""Tracers in the adaptive grid: their hits are exact, whatever the options, and so are their counters."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from adaptive_grids import SPECS, on_planes
from shapes import REPRESENTATIVE, aimed_rays, random_rays, soup
from traced import GRID_TRACERS, MESHES, brute_hits, hits_of, setting_of, shared_scene_in

from harness import tracers
from harness.data import Rays, differing
from harness.spec.intersectors import INTERSECTORS
from harness.spec.structure import Adaptive, Uniform


@pytest.mark.parametrize("spec", SPECS, ids=str)
@pytest.mark.parametrize("name", MESHES)
def test_grid_tracers_agree_with_brute_force_bit_for_bit(device, name, spec):
    prepared, rays = shared_scene_in(device, name, spec), MESHES[name][1]
    for intersector in ("ray-space", "havel-herout"):
        expected = brute_hits(device, name, intersector)
        assert (expected.primitive >= 0).any()
        for tracer in GRID_TRACERS:
            assert hits_of(prepared, rays, tracer, intersector).tobytes() == expected.tobytes(), tracer


@pytest.mark.parametrize("arrange", ["two-pass", "record"])
@pytest.mark.parametrize("wave", ["1", "8", "all"])
@pytest.mark.parametrize("lanes", ["1", "4", "8", "16"])
@pytest.mark.parametrize("copied", ["index", "copy"])
def test_options_of_the_deferred_tracer_change_no_bit(device, arrange, wave, lanes, copied):
    options = {"arrange": arrange, "wave": wave, "lanes": lanes, "pairs": copied, "growth": "2"}
    hits = hits_of(shared_scene_in(device, "clumps", SPECS[1]), MESHES["clumps"][1], "deferred", **options)
    assert hits.tobytes() == brute_hits(device, "clumps").tobytes()


def test_walls_on_cell_planes_and_origins_on_them(device):
    """Squares on planes between cells; rays at their edges, along them and from points on them; -0.0 directions."""
    mesh = on_planes(device)
    prepared = setting_of(device, mesh, SPECS[1])
    generator, count = np.random.default_rng(4), 1500
    rays = aimed_rays(mesh[200:], (0.31, 0.52, 0.47), count)
    size = prepared.structure.cell_size * 2 ** (prepared.structure.shape[3] - 1)
    origins = (prepared.structure.lower + size * generator.integers(0, 5, (count, 3))).astype(np.float32)
    directions = np.zeros((count, 3), np.float32)
    directions[np.arange(count), np.arange(count) % 3] = np.where(np.arange(count) // 3 % 2, 1, -1)
    directions[::2] *= np.float32(-1)  # turns the zeros of every second ray into -0.0
    along = Rays(origins, directions, np.full(count, np.inf, np.float32))
    for part in (rays, along):
        expected = hits_of(prepared, part, "brute")
        assert (expected.primitive >= 0).any()
        for tracer in GRID_TRACERS:
            assert differing(hits_of(prepared, part, tracer), expected) == 0, tracer


@pytest.mark.parametrize("thickness", [0.0, 1e-6, 1e-3])
@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_flat_and_distant_scenes(device, thickness, offset):
    mesh = (soup(3000, size=0.03) * np.float32([1, 1, thickness]) + np.float32(offset)).astype(np.float32)
    prepared = setting_of(device, mesh, SPECS[0])
    rays = random_rays(2000, low=offset - 1, high=offset + 2)
    expected = hits_of(prepared, rays, "brute")
    assert (expected.primitive >= 0).any()
    for tracer in GRID_TRACERS:
        assert differing(hits_of(prepared, rays, tracer), expected) == 0, tracer


def test_counters_are_exact_and_empty_space_costs_few_steps(device):
    mesh, rays = MESHES["clumps"]
    counts = {}
    for name, spec in (("adaptive", Adaptive(top=20, leaf=8)), ("per-cell", Uniform(20, 8, per_cell=True))):
        prepared = setting_of(device, mesh, spec)
        deferred = tracers.find("deferred")(prepared, INTERSECTORS["ray-space"], {"wave": "1"})
        counts[name] = deferred.count(rays)
        assert counts[name] == deferred.count(rays)
        forward, optimal = (
            tracers.find(tracer)(prepared, INTERSECTORS["ray-space"], {}).count(rays)
            for tracer in ("forward", "work-optimal")
        )
        assert (forward.tests, forward.pairs) == (optimal.tests, optimal.pairs)
        assert (forward.steps, forward.pairs) == (counts[name].steps, counts[name].pairs)
        assert sum(counts[name].finished_per_wave) == len(rays)
    assert counts["adaptive"].steps < 0.5 * counts["per-cell"].steps


def test_hits_written_in_lanes_are_those_written_one_by_one(device):
    """Also u and v, which no tracer computes itself."""
    prepared, rays = shared_scene_in(device, "soup", SPECS[0]), MESHES["soup"][1]
    for name in REPRESENTATIVE:
        written = []
        for lanes in (1, 8):
            other = dataclasses.replace(prepared, device=dataclasses.replace(device, native_lanes=lanes))
            written.append(hits_of(other, rays[:2999], "forward", name))
        assert (written[0].u > 0).any() and written[0].tobytes() == written[1].tobytes()
