"""Every corruption of a run's hits that a broken tracer could cause is caught by the check."""

import numpy as np
import pytest

from harness.data import MISS, Hits, Rays
from harness.reference.check import Checker
from harness.reference.embree_scene import EmbreeScene

INF = np.float32(np.inf)


def bumpy_sheets(cells=16):
    """Two bumpy sheets of 2 * cells^2 triangles over each other, the first one nearer to the rays."""
    rng = np.random.default_rng(7)
    triangles = []
    for height in (1.0, 2.0):
        x, y = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1))
        points = np.stack([x, y, height + 0.1 * rng.random(x.shape)], axis=-1).astype(np.float32)
        a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
        triangles += [np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))]
    return np.concatenate(triangles)


def rays_from_below(count=20_000):
    """Rays of many lengths; about a third miss."""
    rng = np.random.default_rng(8)
    origins = (rng.random((count, 3)) * [1.4, 1.4, 0.5] - [0.2, 0.2, 0]).astype(np.float32)
    directions = (rng.random((count, 3)) * [0.6, 0.6, 1] - [0.3, 0.3, -1]) * np.exp2(rng.integers(-3, 4, (count, 1)))
    return Rays(origins, directions.astype(np.float32), np.full(count, INF))


class Case:
    """A mesh, rays, honest hits, and a checker of each mode."""

    def __init__(self):
        self.mesh, self.rays = bumpy_sheets(), rays_from_below()
        self.hits = EmbreeScene(self.mesh).trace(self.rays)
        few = slice(0, 200)
        self.checkers = {
            "embree": (Checker(self.mesh, self.rays), slice(None)),
            "exact": (Checker(self.mesh, self.rays[few], "exact"), few),
        }
        hit = self.hits.primitive != MISS
        near = hit & (self.hits.primitive < len(self.mesh) // 2)
        self.near, self.missing = (int(np.flatnonzero(which[few])[3]) for which in (near, ~hit))

    def check(self, mode, change):
        checker, rows = self.checkers[mode]
        part = self.hits[rows]
        hits = Hits(part.t.copy(), part.primitive.copy(), part.u.copy(), part.v.copy())
        change(hits)
        found = checker.check(hits)
        classes = (found.same, found.tie, found.t_off, found.wrong, found.missed, found.phantom)
        assert sum(classes) == found.rays == len(hits)
        return found

    def plane_t(self, row, primitive):
        p, q, r = self.mesh[primitive].astype(np.float64)
        normal = np.cross(q - p, r - p)
        return np.float32(normal @ (p - self.rays.origins[row]) / (normal @ self.rays.directions[row]))


@pytest.fixture(scope="module")
def case():
    return Case()


@pytest.fixture(params=["embree", "exact"])
def mode(request):
    return request.param


def fails(found, **counts):
    assert not found.valid and found.reason
    for name, count in counts.items():
        assert getattr(found, name) == count, (name, found)


def test_honest_hits_pass(case, mode):
    found = case.check(mode, lambda hits: None)
    assert found.valid and found.reason == "" and found.same + found.tie == found.rays
    assert found.t_relative_error.max < 1e-5


@pytest.mark.parametrize("factor", [1.01, 0.99, 2.0])
def test_scaled_t(case, mode, factor):
    def change(hits):
        hits.t[case.near] *= factor

    fails(case.check(mode, change), t_off=1, wrong=0)


def test_slightly_scaled_t_is_counted(case, mode):
    def change(hits):
        hits.t[case.near] *= 1.0001

    found = case.check(mode, change)
    assert found.t_off == 1 and found.valid and found.t_relative_error.max > 9e-5


@pytest.mark.parametrize("name", ["t", "u", "v"])
@pytest.mark.parametrize("missing", [False, True])
def test_nan(case, mode, name, missing):
    def change(hits):
        getattr(hits, name)[case.missing if missing else case.near] = np.nan

    fails(case.check(mode, change), nonfinite=1, wrong=1)


def test_dropped_hit(case, mode):
    def change(hits):
        hits.t[case.near], hits.primitive[case.near] = INF, MISS

    fails(case.check(mode, change), missed=1)


def test_far_primitive(case, mode):
    def change(hits):
        hits.primitive[case.near] = (hits.primitive[case.near] + 100) % (len(case.mesh) // 2)

    fails(case.check(mode, change), wrong=1)


@pytest.mark.parametrize("with_its_t", [False, True])
def test_adjacent_primitive(case, mode, with_its_t):
    def change(hits):
        half = len(case.mesh) // 4  # triangles abc come first, then their neighbours acd
        row = case.near
        hits.primitive[row] = (hits.primitive[row] + half) % (2 * half)
        if with_its_t:
            hits.t[row] = case.plane_t(row, hits.primitive[row])

    fails(case.check(mode, change), wrong=1)


@pytest.mark.parametrize("t", [1.0, 100.0])
def test_phantom(case, mode, t):
    def change(hits):
        hits.t[case.missing], hits.primitive[case.missing] = t, 5

    fails(case.check(mode, change), phantom=1)


@pytest.mark.parametrize("primitive", [10_000, 1024, -2, 2**31 - 1, -(2**31)])
def test_primitive_out_of_range(case, mode, primitive):
    def change(hits):
        hits.primitive[case.near] = primitive

    fails(case.check(mode, change), wrong=1)


def test_negative_t(case, mode):
    def change(hits):
        hits.t[case.near] *= -1

    fails(case.check(mode, change), wrong=1)


def test_hit_behind_a_nearer_one(case, mode):
    upper = np.arange(len(case.mesh)) >= len(case.mesh) // 2
    behind = EmbreeScene(case.mesh, active=upper).trace(case.rays)

    def change(hits):
        rows = np.flatnonzero((behind.primitive[: len(hits)] != MISS) & (hits.primitive < len(case.mesh) // 2))
        row = rows[hits.primitive[rows] != MISS][0]
        hits.t[row], hits.primitive[row] = behind.t[row], behind.primitive[row]

    fails(case.check(mode, change), wrong=1)


def test_infinite_t_with_a_primitive(case, mode):
    def change(hits):
        hits.t[case.near] = INF

    fails(case.check(mode, change), wrong=1)


def test_finite_t_without_a_primitive(case, mode):
    def change(hits):
        hits.primitive[case.near] = MISS

    fails(case.check(mode, change), wrong=1)


def test_hits_of_other_rays(case):
    def change(hits):
        for name in ("t", "primitive", "u", "v"):
            getattr(hits, name)[:] = np.roll(getattr(hits, name), 1)

    found = case.check("embree", change)
    fails(found)
    assert found.wrong + found.missed + found.phantom > 10_000 and found.settled < found.rays


def test_poisoned_and_all_missed(case, mode):
    def poison(hits):
        hits.t[:], hits.primitive[:] = np.nan, 0

    def miss(hits):
        hits.t[:], hits.primitive[:] = INF, MISS

    fails(case.check(mode, poison), same=0)
    assert case.check(mode, miss).missed > 100


def test_hit_beyond_t_max(case, mode):
    _, rows = case.checkers[mode]
    short = case.rays[rows]
    limits = short.t_max.copy()
    limits[case.near] = case.hits.t[case.near] * np.float32(0.99)
    rays = Rays(short.origins, short.directions, limits)
    found = Checker(case.mesh, rays, mode).check(case.hits[rows])
    fails(found, wrong=1)


def test_wrong_arrays(case):
    checker, _ = case.checkers["embree"]
    hits = case.hits
    fails(checker.check(hits[:100]), wrong=len(case.rays))
    fails(checker.check(Hits(hits.t.astype(np.float64), hits.primitive, hits.u, hits.v)), wrong=len(case.rays))


def test_inactive_primitive(case, mode):
    _, rows = case.checkers[mode]
    active = np.ones(len(case.mesh), bool)
    active[case.hits.primitive[case.near]] = False
    found = Checker(case.mesh, case.rays[rows], mode, active).check(case.hits[rows])
    assert not found.valid and found.wrong >= 1
