"""Aimed rays: something must be hit, methods that leak are seen to leak, and a lost hit is counted."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import icosphere, soup

from harness import tracers
from harness.data import Hits, Rays, Scene, View
from harness.device.opened import Device
from harness.device.stopwatch import Stopwatch
from harness.errors import DefrayError
from harness.inputs.aimed_rays import MOST_T, CornerIndex, aimed_rays, closed_fans, leaked
from harness.inputs.scenes_by_name import load_scene
from harness.reference.oracle import Oracle
from harness.spec import intersectors
from harness.tracers.prepared import Prepared

INSIDE = View((0.1, 0.05, -0.08), (1.0, 0.2, 0.3), name="inside")


def scene_of(triangles: np.ndarray, view: View = INSIDE) -> Scene:
    return Scene("test", np.ascontiguousarray(triangles, np.float32), (view,), sha256="0" * 64)


def brute_hits(scene: Scene, device: Device, rays: Rays, intersector: str, **options) -> Hits:
    tracer = tracers.find("brute")(Prepared.on_device(scene, device), intersectors.find(intersector), options)
    return tracer.trace(rays, Stopwatch(device.queue))


@pytest.fixture(scope="module")
def sphere() -> Scene:
    return scene_of(icosphere(3))


@pytest.fixture(scope="module")
def aimed(sphere):
    return aimed_rays(sphere, 20_000)


def test_counts_shares_and_kind(aimed):
    assert len(aimed) == 20_000 and aimed.rays.kind == "aimed"
    assert 0.4 < aimed.at_vertex.mean() < 0.6
    assert np.isinf(aimed.rays.t_max).all() and aimed.rays.directions.any(axis=1).all()


def test_the_same_seed_gives_the_same_rays(sphere, aimed):
    again, other = aimed_rays(sphere, 20_000), aimed_rays(sphere, 2_000, seed=2)
    assert again.rays.origins.tobytes() == aimed.rays.origins.tobytes()
    assert again.rays.directions.tobytes() == aimed.rays.directions.tobytes()
    assert other.rays.directions.tobytes() != aimed.rays.directions[:2_000].tobytes()


def test_targets_are_vertices_and_points_of_edges(sphere, aimed):
    targets = aimed.rays.origins.astype(np.float64) + aimed.rays.directions
    vertices = np.unique(sphere.triangles.reshape(-1, 3), axis=0)
    nearest = np.array([np.abs(vertices - target).max(axis=1).min() for target in targets[:2_000]])
    at_vertex = aimed.at_vertex[:2_000]
    assert (nearest[at_vertex] < 1e-6).all()
    assert (nearest[~at_vertex] > 1e-6).mean() > 0.99


def test_a_watertight_intersector_stops_all_and_another_leaks(sphere, aimed, device):
    few = aimed[:6_000]
    assert leaked(brute_hits(sphere, device, few.rays, "ray-space")).sum() == 0
    assert leaked(brute_hits(sphere, device, few.rays, "moller-trumbore")).sum() > 50


def test_a_dropped_hit_and_a_nan_are_leaks(sphere, aimed, device):
    few = aimed[:1_000]
    hits = brute_hits(sphere, device, few.rays, "ray-space")
    hits.t[3], hits.primitive[3] = np.inf, -1
    hits.t[5] = np.nan
    hits.t[7] = 1.5
    hits.t[9] = 0.5  # something nearer is fine
    assert np.flatnonzero(leaked(hits)).tolist() == [3, 5, 7]


def test_the_exact_oracle_stops_a_sample(sphere, aimed):
    oracle = Oracle(sphere.triangles)
    for row in range(200):
        truth = oracle.first_hit(aimed.rays.origins[row], aimed.rays.directions[row], np.float32(np.inf))
        assert truth.t <= MOST_T, row


@pytest.mark.slow
def test_the_exact_oracle_stops_aimed_rays_in_sponza():
    scene = load_scene("sponza")
    aimed, oracle = aimed_rays(scene, 3_000, seed=3), Oracle(scene.triangles)
    for row in range(len(aimed)):
        truth = oracle.first_hit(aimed.rays.origins[row], aimed.rays.directions[row], np.float32(np.inf))
        assert truth.t <= MOST_T, row


def test_a_convex_body_seen_from_outside_is_aimed_at_from_within():
    outside = View((0, 0, -4), (0, 0, 0))
    assert len(aimed_rays(scene_of(icosphere(2), outside), 500)) == 500


def test_unconnected_triangles_are_refused():
    with pytest.raises(DefrayError, match="share an edge") as caught:
        aimed_rays(scene_of(soup(400), View((0.5, 0.5, -1.0), (0.5, 0.5, 0.5))), 100)
    assert "\n" not in str(caught.value)


def test_hardly_any_shared_edge_ends_in_one_line():
    side = 0.04  # large enough to be hit at times
    low, right, up, far = ((0.5 + x * side, 0.5 + y * side, -0.3) for x, y in ((0, 0), (1, 0), (0, 1), (1, 1)))
    triangles = np.concatenate([soup(20_000), np.array([[low, right, up], [right, far, up]])])
    scene = scene_of(triangles, View((0.5, 0.5, -2.0), (0.5, 0.5, 0.5)))
    with pytest.raises(DefrayError, match=r"too few .* share an edge: [0-9,]+ tries gave [1-9]") as caught:
        aimed_rays(scene, 10_000)
    assert "\n" not in str(caught.value)


def fan(count: int = 6, height: float = 0.2, missing: int = 0) -> np.ndarray:
    """Triangles around the origin of space, seen from -z; `missing` of them are left out."""
    angles = np.arange(count + 1) * 2 * np.pi / count
    rim = np.stack([np.cos(angles), np.sin(angles), np.full(count + 1, height)], axis=1).astype(np.float32)
    rim[-1] = rim[0]
    return np.array([[(0, 0, 0), rim[i], rim[i + 1]] for i in range(count - missing)], np.float32)


def closed(triangles, first, second, target=None, origin=(0, 0, -5)) -> bool:
    first, second = np.array([first], np.float32), np.array([second], np.float32)
    target = (first + second) / 2 if target is None else np.array([target])
    at_vertex = (first == second).all(axis=1)
    origin = np.array([origin], np.float32)
    return bool(closed_fans(CornerIndex(triangles), first, second, target.astype(np.float64), origin, at_vertex)[0])


def test_a_closed_fan_is_kept_and_an_open_one_is_not():
    centre = (0, 0, 0)
    assert closed(fan(), centre, centre)
    assert not closed(fan(missing=1), centre, centre)
    assert not closed(np.concatenate([fan(), fan()]), centre, centre)


def test_minus_zero_is_zero():
    flipped = fan()
    flipped[::2, 0] = -0.0
    assert closed(flipped, (0, 0, 0), (0, 0, 0))


def test_a_fan_turned_away_in_part_or_seen_at_grazing_angle_is_not_kept():
    folded = fan()
    folded[2] = folded[2][[0, 2, 1]]
    assert not closed(folded, (0, 0, 0), (0, 0, 0))
    assert not closed(fan(height=0.0), (0, 0, 0), (0, 0, 0), origin=(5, 0, -0.1))
    assert not closed(fan(height=3.0), (0, 0, 0), (0, 0, 0), origin=(5, 0, -0.1))


def test_an_edge_needs_two_triangles():
    triangles = fan()
    assert closed(triangles, triangles[0, 0], triangles[0, 2])
    assert not closed(triangles, triangles[0, 1], triangles[0, 2])
    assert not closed(np.concatenate([triangles, triangles[:1]]), triangles[0, 0], triangles[0, 2])


def test_a_fan_smaller_than_rounding_is_not_kept():
    assert not closed(fan() * np.float32(1e-7), (0, 0, 0), (0, 0, 0))


def test_positions_that_share_a_hash_are_told_apart(monkeypatch):
    monkeypatch.setattr("harness.inputs.aimed_rays.hash_positions", lambda points: np.zeros(len(points), np.uint64))
    assert closed(fan(), (0, 0, 0), (0, 0, 0))
    position, corner = CornerIndex(fan()).around(np.array([[0, 0, 0], [7, 7, 7]], np.float32))
    assert position.tolist() == [0] * 6 and (corner % 3 == 0).all()
