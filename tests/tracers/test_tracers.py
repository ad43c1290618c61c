"""Tracers agree bit for bit with each other and with brute force, whatever the options."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shapes import REPRESENTATIVE, every_intersector, icosphere, lattice_walls, random_rays, soup
from traced import GRID_TRACERS, SCENES, brute_hits, hits_of, setting_of, shared_scene_in

from harness import tracers
from harness.data import Rays, differing
from harness.device.stopwatch import Stopwatch
from harness.errors import DefrayError
from harness.spec.intersectors import INTERSECTORS, LANES
from harness.spec.structure import Uniform


@pytest.mark.parametrize("intersector", every_intersector())
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("spec", [Uniform(4, 32), Uniform(2, 6), Uniform(3, 5, per_cell=True)], ids=str)
def test_grid_tracers_agree_with_brute_force_bit_for_bit(device, name, intersector, spec):
    prepared, expected = shared_scene_in(device, name, spec), brute_hits(device, name, intersector)
    assert (expected.primitive >= 0).any()
    for tracer in GRID_TRACERS:
        hits = hits_of(prepared, SCENES[name][1], tracer, intersector)
        assert differing(hits, expected) == 0, tracer
        assert hits.tobytes() == expected.tobytes()


@pytest.mark.parametrize("intersector", every_intersector())
@pytest.mark.parametrize("lanes", LANES)
@pytest.mark.parametrize("tracer", [*GRID_TRACERS, "brute"])
def test_lanes_change_no_bit(device, tracer, lanes, intersector):
    hits = hits_of(shared_scene_in(device, "soup"), SCENES["soup"][1], tracer, intersector, lanes=str(lanes))
    assert hits.tobytes() == brute_hits(device, "soup", intersector, lanes="1").tobytes()


@pytest.mark.parametrize("arrange", ["two-pass", "record", "sort"])
@pytest.mark.parametrize("wave", ["1", "4", "40", "all"])
@pytest.mark.parametrize("compaction", ["true", "false"])
@pytest.mark.parametrize("batch", ["100000", "777"])
def test_options_of_the_deferred_tracer_change_no_bit(device, arrange, wave, compaction, batch):
    options = {"arrange": arrange, "wave": wave, "compaction": compaction, "batch": batch}
    hits = hits_of(shared_scene_in(device, "soup"), SCENES["soup"][1], "deferred", **options)
    assert hits.tobytes() == brute_hits(device, "soup").tobytes()


@pytest.mark.parametrize("tracer", [*GRID_TRACERS, "brute"])
def test_a_limited_ray_sees_nothing_beyond_its_limit(device, tracer):
    prepared, rays = shared_scene_in(device, "soup"), SCENES["soup"][1]
    free = brute_hits(device, "soup")
    half = dataclasses.replace(rays, t_max=np.where(np.arange(len(rays)) % 2, free.t, free.t * np.float32(0.999)))
    hits = hits_of(prepared, half, tracer)
    kept = np.arange(len(rays)) % 2 == 1
    assert (hits.primitive[kept] == free.primitive[kept]).all(), "the limit itself is within reach"
    assert (hits.primitive[~kept] == -1).all()


@pytest.mark.parametrize("scale", [2.0**-40, 1.0, 2.0**60])
def test_the_length_of_the_direction_scales_t_exactly(device, scale):
    prepared, rays = shared_scene_in(device, "soup"), SCENES["soup"][1]
    plain = hits_of(prepared, rays, "deferred")
    scaled = hits_of(prepared, dataclasses.replace(rays, directions=rays.directions * np.float32(scale)), "deferred")
    assert (scaled.primitive == plain.primitive).all()
    assert (scaled.t == plain.t / np.float32(scale)).all()


@pytest.mark.parametrize("tracer", GRID_TRACERS)
def test_signed_zeros_and_origins_on_planes(device, tracer):
    """-0.0 in a direction and origins exactly on cell planes lose no ray."""
    triangles = lattice_walls(4)
    prepared = setting_of(device, triangles, Uniform(2, 8))
    lower, size = prepared.structure.lower, prepared.structure.cell_size
    planes = (lower + size * np.random.default_rng(4).integers(0, 9, (900, 3))).astype(np.float32)
    directions = np.zeros((900, 3), np.float32)
    axis, sign = np.arange(900) % 3, np.where(np.arange(900) // 3 % 2, 1, -1)
    directions[np.arange(900), axis] = sign
    directions[::2] *= np.float32(-1)  # turns the zeros of every second ray into -0.0
    rays = Rays(planes, directions, np.full(900, np.inf, np.float32))
    assert differing(hits_of(prepared, rays, tracer), hits_of(prepared, rays, "brute")) == 0


def test_equal_t_goes_to_the_lower_primitive(device):
    triangles = np.concatenate([soup(20), soup(20)])
    prepared = setting_of(device, triangles)
    for tracer in (*GRID_TRACERS, "brute"):
        hits = hits_of(prepared, random_rays(500), tracer)
        assert hits.primitive.max() < 20


def test_rays_that_start_outside_or_pass_by(device):
    triangles = icosphere()
    prepared = setting_of(device, triangles)
    rays = random_rays(4000, low=-5, high=5)
    expected = hits_of(prepared, rays, "brute")
    assert (expected.primitive < 0).any() and (expected.primitive >= 0).any()
    for tracer in GRID_TRACERS:
        assert differing(hits_of(prepared, rays, tracer), expected) == 0


def test_counters_are_exact_and_repeat(device):
    prepared, rays = shared_scene_in(device, "soup"), SCENES["soup"][1]
    counts = {}
    for options in ({"arrange": "two-pass"}, {"arrange": "record"}, {"arrange": "sort"}, {"batch": "1000"}):
        made = tracers.find("deferred")(prepared, INTERSECTORS["ray-space"], {"lanes": "8", **options})
        counts[str(options)] = made.count(rays)
        assert made.count(rays) == counts[str(options)]
    two_pass, record, sort, batched = counts.values()
    assert two_pass == record == sort
    assert (two_pass.steps, two_pass.pairs, two_pass.tests) == (batched.steps, batched.pairs, batched.tests)
    assert sum(two_pass.finished_per_wave) == len(rays)
    assert two_pass.lane_tests >= two_pass.tests >= two_pass.pairs > 0
    forward = tracers.find("forward")(prepared, INTERSECTORS["ray-space"], {}).count(rays)
    optimal = tracers.find("work-optimal")(prepared, INTERSECTORS["ray-space"], {}).count(rays)
    assert (forward.tests, forward.pairs) == (optimal.tests, optimal.pairs)
    assert forward.tests <= two_pass.tests


@pytest.mark.parametrize("thickness", [0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-2])
@pytest.mark.parametrize("distance", [1, 4])
def test_flat_and_thin_scenes_seen_from_afar(device, thickness, distance):
    """Along an axis in which the scene is thin, rounding is that of its largest extent."""
    generator = np.random.default_rng(6)
    triangles = soup(3000, size=0.03) * np.float32([1, 1, thickness])
    prepared = setting_of(device, triangles, Uniform(8, 128))
    target = generator.random((1500, 3)) * [1, 1, thickness]
    towards = generator.normal(size=(1500, 3))
    origins = (target - distance * towards / np.linalg.norm(towards, axis=1, keepdims=True)).astype(np.float32)
    rays = Rays(origins, (target - origins).astype(np.float32), np.full(1500, np.inf, np.float32))
    expected = hits_of(prepared, rays, "brute")
    assert (expected.primitive >= 0).mean() > 0.1
    for tracer in GRID_TRACERS:
        assert differing(hits_of(prepared, rays, tracer), expected) == 0, tracer


def test_a_limited_ray_does_not_walk_on_through_empty_space(device):
    prepared = setting_of(device, icosphere(2), Uniform(4, 32))
    rays = random_rays(500, low=-0.3, high=0.3)
    short = dataclasses.replace(rays, t_max=np.full(500, 0.02, np.float32))
    for tracer in ("deferred", "forward"):
        made = tracers.find(tracer)(prepared, INTERSECTORS["ray-space"], {})
        assert made.count(short).steps < 0.2 * made.count(rays).steps
        assert made.count(short).tests == 0


def test_a_distance_that_overflows_is_a_miss_for_every_tracer(device):
    """Not a hit at infinity for one and a miss for another."""
    tiny = (soup(5) * np.float32(2e-20)).astype(np.float32)
    triangles = np.concatenate([soup(50), tiny + np.float32(0)])
    prepared = setting_of(device, triangles)
    rays = random_rays(2000)
    for name in REPRESENTATIVE:
        expected = hits_of(prepared, rays, "brute", name)
        assert np.isfinite(expected.t[expected.primitive >= 0]).all()
        for tracer in GRID_TRACERS:
            assert differing(hits_of(prepared, rays, tracer, name), expected) == 0


@pytest.mark.parametrize("arrange", ["two-pass", "record", "sort"])
def test_a_batch_whose_pairs_do_not_fit_is_halved(device, arrange):
    rays = SCENES["soup"][1]
    small = dataclasses.replace(device, max_allocation_bytes=150 << 10)
    prepared = dataclasses.replace(shared_scene_in(device, "soup"), device=small)
    made = tracers.find("deferred")(prepared, INTERSECTORS["ray-space"], {"wave": "all", "arrange": arrange})
    watch = Stopwatch(device.queue)
    hits = made.trace(rays, watch)
    assert made.batch_size < len(rays)
    assert hits.tobytes() == brute_hits(device, "soup").tobytes()
    assert watch.seconds["traverse"] <= watch.seconds["total"]
    options = {"wave": "all", "arrange": arrange}
    halved = tracers.find("deferred")(prepared, INTERSECTORS["ray-space"], options).count(rays)
    options["batch"] = str(made.batch_size)
    assert halved == tracers.find("deferred")(prepared, INTERSECTORS["ray-space"], options).count(rays)
    tiny = dataclasses.replace(prepared, device=dataclasses.replace(device, max_allocation_bytes=1 << 10))
    with pytest.raises(DefrayError, match="use a coarser grid"):
        hits_of(tiny, rays, "deferred", wave="all", arrange=arrange)


@pytest.mark.parametrize("batch", ["100000", "777"])
def test_brute_force_counts_every_pair(device, batch):
    triangles, rays = SCENES["soup"]
    made = tracers.find("brute")(shared_scene_in(device, "soup"), INTERSECTORS["ray-space"], {"batch": batch})
    counters = made.count(rays)
    assert counters.tests == len(rays) * len(triangles)
    assert counters == made.count_by_running(rays)


@pytest.mark.parametrize(
    ("tracer", "options", "message"),
    [
        ("deferred", {"wave": "0"}, "option wave=0 of deferred"),
        ("deferred", {"waves": "4"}, "unknown option of tracer deferred 'waves'; known: .*wave"),
        ("forward", {"lanes": "3"}, "option lanes=3 of forward"),
        ("deferred", {"batch": "none"}, "option batch=none of deferred"),
    ],
)
def test_a_bad_option_is_named(device, tracer, options, message):
    with pytest.raises(DefrayError, match=message):
        hits_of(setting_of(device, soup(10)), random_rays(8), tracer, **options)


def test_unknown_names_list_the_known():
    with pytest.raises(DefrayError, match="unknown tracer 'backward'; known: brute, deferred, embree, forward"):
        tracers.find("backward")
