"""The classes of agreement, on rays whose truth is known."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from harness.data import MISS, Hits, Rays
from harness.errors import DefrayError
from harness.records.agreement import RelativeError
from harness.reference import check as check_module
from harness.reference.check import BAND_ULP, Checker
from harness.reference.embree_scene import EmbreeScene
from harness.reference.exact import measure, zero_area
from harness.reference.oracle import Oracle

INF = np.float32(np.inf)


def hits_of(t, primitive):
    zeros = np.zeros(len(t), np.float32)
    return Hits(np.array(t, np.float32), np.array(primitive, np.int32), zeros, zeros.copy())


def rays_of(origins, directions, t_max=INF):
    origins = np.array(origins, np.float32)
    return Rays(origins, np.array(directions, np.float32), np.full(len(origins), t_max, np.float32))


def exact_hits(mesh, rays, active=None):
    """Hits as the oracle has them, rounded to float32."""
    oracle = Oracle(mesh, active)
    rows = zip(rays.origins, rays.directions, rays.t_max, strict=True)
    truths = [oracle.first_hit(*row) for row in rows]
    return hits_of([truth.t for truth in truths], [truth.primitive for truth in truths])


def moller_trumbore(triangles, origins, directions):
    """Float32 Moller-Trumbore of ray i with triangle i: bool hit, float32 t."""

    def dot(a, b):
        return (a * b).sum(axis=1, dtype=np.float32)

    p, q, r = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    across = np.cross(directions, r - p)
    with np.errstate(divide="ignore"):
        inverse = np.float32(1) / dot(q - p, across)
    u = dot(origins - p, across) * inverse
    moment = np.cross(origins - p, q - p)
    v = dot(directions, moment) * inverse
    return (u >= 0) & (v >= 0) & (u + v <= 1), dot(r - p, moment) * inverse


def soup(count=400, seed=1):
    rng = np.random.default_rng(seed)
    return (rng.random((count, 1, 3)) + rng.normal(size=(count, 3, 3)) * 0.1).astype(np.float32)


def random_rays(count, t_max=INF, seed=2):
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3)) * np.exp2(rng.integers(-20, 20, (count, 1)))
    return rays_of(rng.random((count, 3)), directions, t_max)


SQUARE = np.array([[[0, 0, 1], [1, 0, 1], [1, 1, 1]], [[0, 0, 1], [1, 1, 1], [0, 1, 1]]], np.float32)
WALL = np.array([[[-9, -9, 3], [9, -9, 3], [0, 9, 3]]], np.float32)
UP = [0, 0, 1]


def test_record_is_plain_json():
    checker = Checker(SQUARE, rays_of([[0.75, 0.25, 0], [5, 5, 0]], [UP, UP]))
    record = checker.check(hits_of([1, np.inf], [0, MISS])).as_json()
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["valid"] and record["same"] == record["rays"] == 2
    phantom_on_a_line = np.concatenate([SQUARE, np.ones((1, 3, 3), np.float32)])
    found = Checker(phantom_on_a_line, rays_of([[5, 5, 0]], [UP])).check(hits_of([1], [2]))
    assert found.phantom == 1 and not found.valid
    json.dumps(found.as_json(), allow_nan=False)


def test_none_and_unknown_mode():
    rays = rays_of([[0.75, 0.25, 0]], [UP])
    found = Checker(SQUARE, rays, "none").check(hits_of([1], [0]))
    assert not found.valid and found.reason == "not checked" and found.reference == "none"
    with pytest.raises(DefrayError):
        Checker(SQUARE, rays, "maybe")


@pytest.mark.parametrize("mode", ["embree", "exact"])
def test_no_rays(mode):
    found = Checker(SQUARE, rays_of(np.empty((0, 3)), np.empty((0, 3))), mode).check(hits_of([], []))
    assert found.valid and found.t_relative_error == RelativeError(p50=None, p99=None, max=None)


@pytest.mark.parametrize("mode", ["embree", "exact"])
def test_tie_on_a_shared_edge_and_on_a_duplicate(mode):
    mesh = np.concatenate([SQUARE, SQUARE[:1]])
    checker = Checker(mesh, rays_of([[0.5, 0.5, 0]], [UP]), mode)
    classes = [checker.check(hits_of([1], [primitive])) for primitive in range(3)]
    assert all(found.valid and found.same + found.tie == 1 for found in classes)
    assert sum(found.tie for found in classes) == 2


@pytest.mark.parametrize("mode", ["embree", "exact"])
@pytest.mark.parametrize("gap, tied, gross", [(2.0**-22, 1, False), (2.0**-18, 0, False), (2.0**-14, 0, True)])
def test_surfaces_close_behind_each_other(mode, gap, tied, gross):
    """About 3, 50 and 800 local ulp apart: one t, another t within rounding, another t."""
    behind = SQUARE[:1] + np.array([0, 0, gap], np.float32)
    mesh = np.concatenate([SQUARE[:1], behind])
    found = Checker(mesh, rays_of([[0.75, 0.25, 0]], [UP]), mode).check(hits_of([1 + gap], [1]))
    assert (found.tie, found.wrong, "beyond rounding" in found.reason) == (tied, 1 - tied, gross), found


@pytest.mark.parametrize("mode", ["embree", "exact"])
def test_neighbour_in_the_same_plane_is_no_tie(mode):
    """The same t, but the ray is far outside the claimed triangle."""
    found = Checker(SQUARE, rays_of([[0.75, 0.25, 0]], [UP]), mode).check(hits_of([1], [1]))
    assert found.wrong == 1 and "beyond rounding" in found.reason


@pytest.mark.parametrize("mode", ["embree", "exact"])
def test_both_modes_accept_the_truth(mode):
    mesh = soup()
    for t_max in (INF, np.float32(1e-3), np.float32(0.3)):
        rays = random_rays(600, t_max)
        found = Checker(mesh, rays, mode).check(exact_hits(mesh, rays))
        assert found.valid and found.same + found.tie == 600, found


def test_modes_give_the_same_classes():
    """Embree on disputed rays only, and exact arithmetic on all, class a careless tracer alike."""
    mesh, rays = soup(), random_rays(1500)
    hits = exact_hits(mesh, rays)
    rng = np.random.default_rng(3)
    hits.primitive[::7] = rng.integers(-1, len(mesh), len(hits.primitive[::7]))
    hits.primitive[::21] = MISS
    hits.t[::7] = np.where(hits.primitive[::7] == MISS, np.inf, 0.5)
    hits.t[3::11] *= 1.5
    one, two = (Checker(mesh, rays, mode).check(hits) for mode in ("embree", "exact"))
    for name in ("t_off", "wrong", "missed", "phantom", "nonfinite", "worst_band_ulp", "valid"):
        assert getattr(one, name) == getattr(two, name), name
    assert min(one.t_off, one.wrong, one.missed, one.phantom) > 5


@pytest.mark.parametrize("mode", ["embree", "exact"])
def test_silhouette_within_the_band_is_counted_but_valid(mode):
    """A ray close to a triangle's edge: the front claimed instead of the wall, and the other way round."""
    mesh = np.concatenate([SQUARE, WALL])
    count, ulp = 20_000 if mode == "embree" else 10, 2.0**-24
    for offset, false in ((-20, (1, 0)), (20, (3, 2))):
        x = np.full(count, 0.5)
        rays = rays_of(np.stack([x, x * 0, x * 0], axis=1), np.tile([0, 1, 2.0], (count, 1)))
        rays.origins[:, 1], rays.directions[:, 1] = 0.25, 0
        rays.origins[0] = [0.5, offset * ulp, 0]
        hits = exact_hits(mesh, rays[:2])
        hits = hits_of(np.r_[hits.t[0], np.full(count - 1, hits.t[1])], np.r_[hits.primitive[0], np.zeros(count - 1)])
        checker = Checker(mesh, rays, mode)
        assert checker.check(hits).same + checker.check(hits).tie == count
        hits.t[0], hits.primitive[0] = np.float32(false[0] / 2), false[1]
        found = checker.check(hits)
        assert found.wrong == 1 and 0 < found.worst_band_ulp < BAND_ULP
        assert found.valid == (mode == "embree")  # one of ten is too high a rate, one of 20,000 is not
        assert "beyond rounding" not in found.reason


def test_skipping_the_wall_behind_an_edge_is_gross():
    """Losing a ray at a silhouette is rounding; losing the wall behind it as well is not."""
    mesh = np.concatenate([SQUARE, WALL])
    rays = rays_of([[0.5, 2.0**-22, 0]], [UP])
    found = Checker(mesh, rays, "exact").check(hits_of([np.inf], [MISS]))
    assert found.missed == 1 and found.worst_band_ulp > 1e6 and "beyond rounding" in found.reason


def test_embree_wrong_and_the_run_right():
    mesh, rays = soup(), random_rays(2000)
    hits = exact_hits(mesh, rays)
    checker = Checker(mesh, rays)
    row = int(np.flatnonzero(hits.primitive != MISS)[0])
    missing = int(np.flatnonzero(hits.primitive == MISS)[0])
    checker.reference[row], checker.reference[missing] = MISS, 3  # as if Embree had lost one and made one up
    found = checker.check(hits)
    assert found.valid and found.reference_wrong == 2 and found.settled >= 2
    assert found.same + found.tie == 2000


def test_embree_and_the_run_wrong_alike():
    """A hit far outside its triangle is settled exactly, whoever shares the error."""
    checker = Checker(SQUARE, rays_of([[0.75, 0.25, 0], [5, 5, 0]], [UP, UP]))
    checker.reference[:] = 1
    found = checker.check(hits_of([1, 1], [1, 1]))
    assert found.wrong == found.phantom == 1 and found.reference_wrong == 0 and not found.valid


def test_settled_rays_are_settled_once(monkeypatch):
    mesh, rays = soup(), random_rays(300)
    hits = exact_hits(mesh, rays)
    hits.t[:], hits.primitive[:] = INF, MISS
    checker = Checker(mesh, rays)
    first = checker.check(hits)
    assert first.missed > 50
    monkeypatch.setattr(checker.oracle, "first_hit", None)
    assert checker.check(hits) == first


def test_too_many_disputes_are_not_all_settled(monkeypatch):
    monkeypatch.setattr(check_module, "MOST_EXACT", 20)
    mesh, rays = soup(), random_rays(600)
    hits = exact_hits(mesh, rays)
    expected = int((hits.primitive != MISS).sum())
    hits.t[:], hits.primitive[:] = INF, MISS
    found = Checker(mesh, rays).check(hits)
    assert found.settled == 20 and found.missed == expected and not found.valid
    assert f"{expected - 20} more disputes" in found.reason


def test_many_chunks_agree_with_one(monkeypatch):
    mesh, rays = soup(), random_rays(5000)
    hits = EmbreeScene(mesh, robust=False).trace(rays)
    hits.t[::50] *= 1.1
    whole = Checker(mesh, rays).check(hits)
    monkeypatch.setattr(check_module, "_CHUNK", 301)
    assert Checker(mesh, rays).check(hits) == whole


@pytest.mark.parametrize("mode", ["embree", "exact"])
def test_rays_that_cannot_hit(mode):
    rays = rays_of([[0.75, 0.25, 0]] * 5, [UP, [0, 0, 0], [0, np.nan, 1], UP, UP])
    rays.t_max[3:] = [np.nan, -1]
    hits = hits_of([1] + [np.inf] * 4, [0] + [MISS] * 4)
    found = Checker(SQUARE, rays, mode).check(hits)
    assert found.valid and found.same == 5
    hits.t[1], hits.primitive[1] = 1, 0
    assert Checker(SQUARE, rays, mode).check(hits).phantom == 1


@pytest.mark.parametrize("mode", ["embree", "exact"])
def test_limit_within_rounding_of_the_hit(mode):
    """A hit lost or found within rounding of t_max is in the band; one lost well before it is not."""
    tilted = np.array([[[-1, -1, 0.9], [1, -1, 1.2], [0, 2, 1.1]]], np.float32)
    origin, direction = [[0.1, 0.2, 0]], [UP]
    t = exact_hits(tilted, rays_of(origin, direction)).t[0]
    near = Checker(tilted, rays_of(origin, direction, t * np.float32(1 + 2.0**-20)), mode)
    found = near.check(hits_of([np.inf], [MISS]))
    assert found.missed == 1 and 0 < found.worst_band_ulp < BAND_ULP and "beyond" not in found.reason
    far = Checker(tilted, rays_of(origin, direction, t * np.float32(1.01)), mode)
    assert "beyond rounding" in far.check(hits_of([np.inf], [MISS])).reason


def test_origin_on_a_triangle():
    """t = 0 is not a hit: claimed, it is counted as rounding."""
    mesh = np.concatenate([SQUARE, WALL])
    checker = Checker(mesh, rays_of([[0.75, 0.25, 1]], [UP]), "exact")
    assert checker.check(hits_of([2], [2])).valid
    found = checker.check(hits_of([0], [0]))
    assert found.wrong == 1 and found.worst_band_ulp == 0 and "beyond" not in found.reason


def test_sliver_error_is_counted_not_fatal():
    """Moller-Trumbore's t on a long sliver is honest float32 error: t_off, and no gross error."""
    rng = np.random.default_rng(5)
    count = 20_000
    base = rng.random((count, 3)) + [0, 0, 3]
    along, tilt = rng.normal(size=(2, count, 3))
    mesh = np.stack([base, base + along, base + along / 2 + tilt * 1e-5], axis=1).astype(np.float32)
    targets = mesh.astype(np.float64).mean(axis=1)
    origins = rng.random((count, 3)).astype(np.float32)
    directions = (targets - origins).astype(np.float32)
    with np.errstate(invalid="ignore"):
        hit, t = moller_trumbore(mesh, origins, directions)
    margin = measure(mesh, origins, directions, np.full(count, INF)).margin
    rows = np.flatnonzero(hit & (t > 0) & (margin > 0))[:64]
    seen = []
    for row in rows:
        checker = Checker(mesh[[row]], rays_of(origins[[row]], directions[[row]]), "exact")
        seen.append(checker.check(hits_of([t[row]], [0])))
    assert all(found.valid for found in seen)
    assert sum(found.t_off for found in seen) > 5
    assert max(found.t_relative_error.max for found in seen) > 1e-3


def test_shared_references():
    mesh, rays = soup(), random_rays(200)
    active = np.arange(len(mesh)) % 3 > 0
    embree, oracle = EmbreeScene(mesh, active=active), Oracle(mesh, active)
    checker = Checker(mesh, rays, active=active, embree=embree, oracle=oracle)
    assert checker.oracle is oracle
    assert checker.check(exact_hits(mesh, rays, active)).valid


@pytest.mark.slow
@pytest.mark.skipif("DEFRAY_SCENES" not in os.environ, reason="DEFRAY_SCENES names no folder of scenes")
def test_embree_on_a_real_scene():
    scene = np.load(Path(os.environ["DEFRAY_SCENES"]) / "sponza.npz")
    mesh = scene["vertices"][scene["faces"]]
    active = ~zero_area(mesh)
    rng = np.random.default_rng(6)
    low, high = mesh.min(axis=(0, 1)), mesh.max(axis=(0, 1))
    rays = rays_of(rng.uniform(low, high, (200_000, 3)), rng.normal(size=(200_000, 3)))
    checker = Checker(mesh, rays, active=active)
    for robust in (True, False):
        found = checker.check(EmbreeScene(mesh, robust, active).trace(rays))
        assert found.valid and found.same + found.tie > 199_990, found
