"""The exact oracle against a brute-force implementation in rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest

from harness.reference.exact import exact_hit, may_hit, measure, zero_area
from harness.reference.oracle import Oracle, Truth, first_hit

INF = np.float32(np.inf)


def rational(vector):
    return [Fraction(float(value)) for value in vector]


def minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def brute_force(triangles, origin, direction, t_max) -> Truth:
    """Plane first, then the hit point against the edges: another formula than the oracle's."""
    o, d = rational(origin), rational(direction)
    best, ties = None, []
    for index, triangle in enumerate(triangles):
        p, q, r = (rational(vertex) for vertex in triangle)
        normal = cross(minus(q, p), minus(r, p))
        slope = dot(normal, d)
        if slope == 0:
            continue
        t = dot(normal, minus(p, o)) / slope
        if t <= 0 or (t_max != np.inf and t > Fraction(float(t_max))):
            continue
        point = [x + t * y for x, y in zip(o, d, strict=True)]
        sides = (dot(normal, cross(minus(b, a), minus(point, a))) for a, b in ((p, q), (q, r), (r, p)))
        if any(side < 0 for side in sides):
            continue
        if best is None or t < best:
            best, ties = t, []
        if t == best:
            ties.append(index)
    return Truth(best, tuple(ties))


def agree(triangles, origins, directions, limits):
    oracle = Oracle(triangles)
    ties = 0
    for origin, direction, t_max in zip(origins, directions, limits, strict=True):
        truth = brute_force(triangles, origin, direction, t_max)
        assert oracle.first_hit(origin, direction, t_max) == truth
        assert first_hit(triangles, None, origin, direction, t_max) == truth
        ties += len(truth.primitives) > 1
    return ties


def lattice_mesh(size=3):
    """Both diagonals' halves of every unit square of two lattice planes, and a few tilted ones."""
    rng = np.random.default_rng(3)
    triangles = []
    for x in range(size):
        for y in range(size):
            a, b, c, d = [x, y, 2], [x + 1, y, 2], [x + 1, y + 1, 2], [x, y + 1, 2]
            triangles += [[a, b, c], [a, c, d]]
    triangles += rng.integers(0, size + 1, (30, 3, 3)).tolist()
    return np.array(triangles, np.float32)


def test_lattice_with_ties():
    rng = np.random.default_rng(1)
    mesh = lattice_mesh()
    origins = rng.integers(-2, 5, (150, 3)).astype(np.float32)
    targets = mesh.reshape(-1, 3)[rng.integers(0, mesh.size // 3, 150)]
    middles = mesh[rng.integers(0, len(mesh), 150)][:, :2].mean(axis=1)
    directions = np.concatenate([targets, middles]).astype(np.float32) - np.tile(origins, (2, 1))
    limits = rng.choice([INF, np.float32(1), np.float32(0.5)], 300)
    assert agree(mesh, np.tile(origins, (2, 1)), directions, limits) > 50


@pytest.mark.parametrize("scale", [2.0**-60, 2.0**-20, 1.0, 2.0**60])
@pytest.mark.parametrize("shift", [0.0, 1e4])
def test_random_mesh_at_any_scale(scale, shift):
    rng = np.random.default_rng(2)
    mesh = ((rng.random((60, 3, 3)) + shift) * scale).astype(np.float32)
    origins = ((rng.random((40, 3)) + shift) * scale).astype(np.float32)
    targets = mesh[rng.integers(0, 60, 40)].mean(axis=1)
    agree(mesh, origins, (targets - origins).astype(np.float32), np.full(40, INF))


def test_extreme_exponents():
    rng = np.random.default_rng(4)
    exponents = rng.integers(-140, 120, (40, 3, 3)).astype(np.float64)
    mesh = (rng.choice([-1, 1], (40, 3, 3)) * np.exp2(exponents)).astype(np.float32)
    origins = (rng.choice([-1, 1], (30, 3)) * np.exp2(rng.integers(-140, 120, (30, 3)))).astype(np.float32)
    directions = np.exp2(rng.integers(-149, 100, (30, 3))).astype(np.float32)
    agree(mesh, origins, directions, np.full(30, INF))
    tiny = (rng.integers(-3, 4, (40, 3, 3)) * 2.0**-149).astype(np.float32)
    start = (rng.integers(-3, 4, (30, 3)) * 2.0**-149).astype(np.float32)
    agree(tiny, start, rng.integers(-3, 4, (30, 3)).astype(np.float32), np.full(30, INF))


def test_many_blocks_agree_with_the_scan():
    rng = np.random.default_rng(5)
    centres = rng.random((20000, 1, 3))
    mesh = (centres + rng.normal(size=(20000, 3, 3)) * 0.02).astype(np.float32)
    mesh[::50] = rng.integers(0, 3, (400, 3, 3)).astype(np.float32) / 2
    active = rng.random(20000) < 0.7
    oracle = Oracle(mesh, active)
    for _ in range(60):
        origin = (rng.random(3) * 2 - 0.5).astype(np.float32)
        direction = (rng.choice(mesh.reshape(-1, 3)) - origin).astype(np.float32)
        t_max = rng.choice([INF, np.float32(0.7)])
        truth = oracle.first_hit(origin, direction, t_max)
        assert truth == first_hit(mesh, active, origin, direction, t_max)
        assert all(active[primitive] for primitive in truth.primitives)
        hits = oracle.all_hits(origin, direction, t_max)
        assert (hits[0] == (truth.t_exact, truth.primitive)) if hits else truth == Truth()


def test_nearer_hit_in_a_later_batch():
    """Huge triangles: every block's box holds the origins, so the first batch says nothing of the others."""
    rng = np.random.default_rng(8)
    mesh = rng.normal(size=(6000, 3, 3)).astype(np.float32)
    oracle = Oracle(mesh)
    for _ in range(10):
        origin, direction = (rng.normal(size=(2, 3)) * 0.2).astype(np.float32)
        assert oracle.first_hit(origin, direction, INF) == first_hit(mesh, None, origin, direction, INF)


def test_rays_through_vertices_that_float64_misjudges():
    """Full 24-bit coordinates: edge functions are exactly zero at the vertex, and not so in float64."""
    rng = np.random.default_rng(9)
    around = np.exp2(-2) * np.exp(2j * np.pi * np.arange(6) / 6)
    for _ in range(300):
        origin, vertex = (1 + rng.random((2, 3))).astype(np.float32)
        vertex[2] += 1
        direction = vertex - origin
        rim = vertex + np.stack([around.real, around.imag, rng.normal(size=6) * 0.1], axis=1)
        fan = np.stack([np.tile(vertex, (6, 1)), rim, np.roll(rim, 1, axis=0)], axis=1).astype(np.float32)
        if (direction.astype(np.float64) == vertex.astype(np.float64) - origin).all():
            assert Oracle(fan).first_hit(origin, direction, INF) == Truth(Fraction(1), tuple(range(6)))


def test_axis_rays_on_block_planes():
    mesh = lattice_mesh()
    for axis in range(3):
        for sign in (1, -1):
            direction = np.zeros(3, np.float32) * np.float32(-1)
            direction[axis] = sign
            for start in ([0, 0, 0], [1, 1, 2], [3, 3, -4], [1, -4, 1]):
                origin = np.array(start, np.float32)
                truth = brute_force(mesh, origin, direction, INF)
                assert Oracle(mesh).first_hit(origin, direction, INF) == truth


def test_coplanar_degenerate_and_invalid_never_hit():
    origin, direction = np.zeros(3, np.float32), np.array([1, 1, 1], np.float32)
    coplanar = np.array([[1, 1, 1], [3, 2, 1], [5, 4, 3]], np.float32)
    line = np.array([[1, 1, 1], [2, 2, 2], [3, 3, 3]], np.float32)
    point = np.ones((3, 3), np.float32)
    broken = np.array([[1, 0, 0], [0, 1, 0], [0, 0, np.nan]], np.float32)
    mesh = np.stack([coplanar, line, point, broken])
    assert Oracle(mesh).first_hit(origin, direction, INF) == Truth()
    good = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], np.float32)
    assert Oracle(good).first_hit(origin, direction, INF).t_exact == Fraction(1, 3)
    for bad in (np.zeros(3, np.float32), np.array([np.nan, 1, 1], np.float32)):
        assert Oracle(good).first_hit(origin, bad, INF) == Truth()
    for t_max in (np.nan, 0, -1):
        assert Oracle(good).first_hit(origin, direction, np.float32(t_max)) == Truth()
    assert Oracle(np.empty((0, 3, 3), np.float32)).first_hit(origin, direction, INF) == Truth()


def test_range_is_exact():
    triangle = np.array([[-1, -1, 3], [1, -1, 3], [0, 1, 3]], np.float32)
    origin, direction = np.zeros(3, np.float32), np.array([0, 0, 3], np.float32)
    one = np.float32(1)
    assert exact_hit(triangle, origin, direction, one) == 1
    assert exact_hit(triangle, origin, direction, np.nextafter(one, 0, dtype=np.float32)) is None
    assert exact_hit(triangle, np.array([0, 0, 3], np.float32), direction, INF) is None  # t = 0
    assert exact_hit(triangle, np.array([0, 0, 4], np.float32), direction, INF) is None  # t < 0


def test_zero_area_is_exact():
    rng = np.random.default_rng(6)
    mesh = rng.integers(-2, 3, (3000, 3, 3)).astype(np.float32) * np.float32(0.1)
    mesh[1000:] += rng.random((2000, 1, 3)).astype(np.float32)
    mesh[2000:2500, 2] = mesh[2000:2500, 0] + 2 * (mesh[2000:2500, 1] - mesh[2000:2500, 0])
    expected = []
    for triangle in mesh:
        p, q, r = (rational(vertex) for vertex in triangle)
        expected.append(not any(cross(minus(q, p), minus(r, p))))
    found = zero_area(mesh)
    assert found.tolist() == expected and 100 < found.sum() < 2900
    assert zero_area(np.full((1, 3, 3), np.nan, np.float32)).all()
    tiny = np.array([[[0, 0, 0], [1e-45, 0, 0], [0, 1e-45, 0]]], np.float32)
    assert not zero_area(tiny).any()


def test_filter_never_drops_an_exact_hit():
    rng = np.random.default_rng(7)
    mesh = rng.integers(-4, 5, (4000, 3, 3)).astype(np.float32)
    origin = np.array([0.5, -7, 2], np.float32)
    for direction in ([0, 1, 0], [1, 2, -1], [-1, 3, 2]):
        direction = np.array(direction, np.float32)
        kept = may_hit(mesh, origin, direction)
        hit = [exact_hit(triangle, origin, direction, INF) is not None for triangle in mesh]
        assert kept[hit].all() and kept.sum() < 3000


def test_measure_in_local_ulps():
    triangle = np.array([[[0, 0, 1], [1, 0, 1], [0, 1, 1]]], np.float32)
    cases = [(0.25, 0.25, 0.25), (0.25, -0.125, -0.125), (0.5, 0.5, 0.0), (2.0, 0.25, -1.25 / np.sqrt(2))]
    for x, y, inside in cases:
        origin = np.array([[x, y, 0]], np.float32)
        found = measure(triangle, origin, np.array([[0, 0, 2]], np.float32), np.array([INF]))
        reach = np.linalg.norm(triangle[0] - origin, axis=1).max() * 2.0**-24
        assert found.t[0] == 0.5 and found.ulp[0] == pytest.approx(reach)
        assert found.margin[0] * reach == pytest.approx(inside)
        assert found.residual(np.array([0.75]))[0] * reach == pytest.approx(0.5)
    behind = measure(triangle, np.array([[0.25, 0.25, 1.125]], np.float32), np.array([[0, 0, 1.0]]), [INF])
    assert behind.margin[0] * behind.ulp[0] == pytest.approx(-0.125)
    short = measure(triangle, np.array([[0.25, 0.25, 0]], np.float32), np.array([[0, 0, 1.0]]), [0.875])
    assert short.margin[0] * short.ulp[0] == pytest.approx(-0.125)
    flat = measure(np.ones((1, 3, 3), np.float32), np.zeros((1, 3)), np.ones((1, 3)), [INF])
    assert flat.margin[0] == -np.inf and np.isnan(flat.t[0])
