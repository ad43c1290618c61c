"""Every registered intersector on triangles and rays whose answer is known."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from c_as_python import flops_of_a_miss
from shapes import aimed_rays, icosphere
from shapes import every_intersector as representative_or_slow

from harness.data import Rays, Scene
from harness.device.stopwatch import Stopwatch
from harness.errors import DefrayError
from harness.spec.intersectors import INTERSECTORS, KERNELS, LANES, find
from harness.tracers import find as find_tracer
from harness.tracers.prepared import Prepared

TRIANGLE = np.array([[[0, 0, 0], [4, 0, 0], [0, 4, 0]]], np.float32)
every_intersector = pytest.mark.parametrize("name", INTERSECTORS)
# What is known to fail is expected to fail: a repair shows as well.
LIMITED_SCALE = {("moller-trumbore-epsilon", 1e-10)}
HITS_BESIDE = {"ray-space-plain", "ray-space-folded"}
SELF_HITS = {"ray-space-plain", "ray-space-folded", "woop-benthin-wald", "woop-benthin-wald-kahan"}
every_lane = pytest.mark.parametrize("lanes", LANES)


def expect_failure(request, known: bool) -> None:
    """Turn a known weakness of an intersector into an expected failure."""
    if known:
        request.node.add_marker(pytest.mark.xfail(strict=True))


def shoot(device, triangles, origins, directions, name, lanes=8, t_max=np.inf):
    """First hits by brute force."""
    origins, directions = np.atleast_2d(np.float32(origins)), np.atleast_2d(np.float32(directions))
    origins, directions = (np.ascontiguousarray(a) for a in np.broadcast_arrays(origins, directions))
    rays = Rays(origins, directions, np.full(len(origins), t_max, np.float32))
    prepared = Prepared.on_device(Scene("test", triangles), device)
    tracer = find_tracer("brute")(prepared, INTERSECTORS[name], {"lanes": str(lanes)})
    return tracer.trace(rays, Stopwatch(device.queue))


@pytest.mark.parametrize("name", representative_or_slow())
@every_lane
def test_t_u_v_of_a_plain_hit_in_every_width(device, name, lanes):
    hits = shoot(device, TRIANGLE, [[1, 2, 3], [1, 2, -3]], [[0, 0, -2], [0, 0, 2]], name, lanes)
    assert hits.primitive.tolist() == [0, 0]
    assert hits.t == pytest.approx(1.5)
    assert hits.u == pytest.approx(0.25) and hits.v == pytest.approx(0.5)


@every_intersector
def test_t_u_v_of_a_plain_hit(device, name):
    test_t_u_v_of_a_plain_hit_in_every_width(device, name, 8)


@every_intersector
def test_beside_behind_parallel_and_too_far_are_misses(device, name):
    origins = [[3, 3, 1], [-1, 1, 1], [1, 1, -1], [1, 1, 1], [1, 1, 0]]
    directions = [[0, 0, -1], [0, 0, -1], [0, 0, -1], [1, 0, 0], [1, 1, 0]]
    hits = shoot(device, TRIANGLE, origins, directions, name)
    assert (hits.primitive == -1).all() and np.isinf(hits.t).all()
    assert (hits.u == 0).all() and (hits.v == 0).all()
    assert shoot(device, TRIANGLE, [1, 1, 1], [0, 0, -1], name, t_max=0.99).primitive.tolist() == [-1]
    assert shoot(device, TRIANGLE, [1, 1, 1], [0, 0, -1], name, t_max=1).primitive.tolist() == [0]


@every_intersector
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("corner", range(3))
def test_a_triangle_that_is_not_finite_is_never_hit(device, monkeypatch, name, value, corner):
    monkeypatch.setattr("harness.structures.device_scene.check_scale", lambda triangles: None)
    broken = np.concatenate([TRIANGLE, TRIANGLE + np.float32([0, 0, -1])])
    broken[0, corner, 2] = value
    origins = np.random.default_rng(0).uniform(0.1, 1.5, (64, 3)) * [1, 1, 0] + [0, 0, 1]
    hits = shoot(device, broken, origins, [0, 0, -1], name)
    assert set(hits.primitive.tolist()) <= {1}
    assert hits.t == pytest.approx(2)


@every_intersector
@pytest.mark.parametrize("scale", [1e-10, 1.0, 1e10])
def test_hits_scale_with_the_scene(request, device, name, scale):
    expect_failure(request, (name, scale) in LIMITED_SCALE)
    triangles = (TRIANGLE * scale).astype(np.float32)
    hits = shoot(device, triangles, np.float32([1, 1, 1]) * np.float32(scale), [0, 0, -1], name)
    assert hits.primitive.tolist() == [0]
    assert hits.t == pytest.approx(scale)


@pytest.mark.parametrize("name", [name for name, entry in INTERSECTORS.items() if entry.watertight])
@every_lane
def test_a_watertight_intersector_loses_no_ray_aimed_at_an_edge(device, name, lanes):
    ball = icosphere(2)
    rays = aimed_rays(ball, (0.12, -0.07, 0.2), 20_000)
    hits = shoot(device, ball, rays.origins, rays.directions, name, lanes)
    assert (hits.primitive >= 0).all()


@every_intersector
def test_no_ray_from_a_wall_hits_the_wall(request, device, name):
    """Rays that start 256 ulp off a large wall near a coordinate plane: t must not round to the far side."""
    expect_failure(request, name in SELF_HITS)
    wall = np.array([[[-947, -1.5, 668], [1653, -1.5, 668], [1653, -1.5, -1016]]], np.float32)
    generator = np.random.default_rng(2)
    origins = np.stack([generator.uniform(800, 1600, 5000), np.full(5000, -1.5), generator.uniform(0, 600, 5000)], 1)
    origins = origins.astype(np.float32)
    origins[:, 1] += 256 * np.spacing(np.float32(1.5))
    directions = generator.normal(size=(5000, 3))
    directions[:, 1] = np.abs(directions[:, 1]) + 1e-3
    assert (shoot(device, wall, origins, directions, name).primitive == -1).all()


@every_intersector
def test_the_header_states_paper_cost_and_weakness(name):
    entry = find(name)
    header = "".join(
        line for line in Path(KERNELS / "intersect" / entry.file).read_text().splitlines(True) if line[:2] == "//"
    )
    for word in ("flops", "Bytes a triangle", "Watertight", "Known failures"):
        assert word in header
    stated = int(re.search(r"flops: (\d+)", header).group(1))
    assert stated == entry.flops and f"Bytes a triangle: {entry.bytes}" in header
    assert ("Watertight: yes" in header) == entry.watertight
    surname = re.split(r"[ ,]", entry.cite.replace("ö", "o"))[0]
    assert surname in header


# Of each, the flops of a rejected triangle that its statement leaves out: depths that only a hit uses, a product with
# a constant zero.
@pytest.mark.parametrize(
    "name, left_out",
    [
        ("ray-space", 0),
        ("ray-space-orthonormal", 0),
        ("ray-space-plain", 0),
        ("moller-trumbore", 0),
        ("moller-trumbore-epsilon", 0),
        ("plucker", 0),
        ("plucker-zero", 1),
        ("kensler-shirley", 0),
        ("woop-benthin-wald-kahan", 3),
    ],
)
def test_stated_flops_are_those_of_the_code(name, left_out):
    assert flops_of_a_miss(INTERSECTORS[name].file) - left_out == INTERSECTORS[name].flops


def test_every_file_is_registered():
    files = {path.name for path in (KERNELS / "intersect").glob("*.cl")}
    assert files == {entry.file for entry in INTERSECTORS.values()}


def test_an_unknown_intersector_lists_the_known():
    with pytest.raises(DefrayError, match=r"unknown intersector 'best'; known: .*moller-trumbore, .*ray-space"):
        find("best")


@every_intersector
def test_a_small_distant_triangle_is_not_hit_from_beside(request, device, name):
    """Edge functions of small triangles far from the origin must not round to zero, which would pass as inside."""
    expect_failure(request, name in HITS_BESIDE)
    corner = np.array([1640.0, -0.1, -995.0])
    small = corner + np.random.default_rng(3).uniform(0, 0.01, (400, 3, 3))
    generator = np.random.default_rng(4)
    origins = generator.uniform([-900, 0, -900], [900, 640, 600], (4000, 3))
    towards = generator.uniform([-900, 0, 0], [900, 640, 600], (4000, 3))
    hits = shoot(device, small.astype(np.float32), origins, towards - origins, name)
    assert (hits.primitive == -1).all()
