"""Embree as the reference tracer: conventions, limits, threads."""

import numpy as np

from harness.data import MISS, Rays
from harness.reference.embree_scene import EmbreeScene

STACK = np.array([[[0, 0, z], [1, 0, z], [0, 1, z]] for z in (3, 1, 2)], np.float32)


def down_z(count, t_max=np.inf):
    return Rays(
        np.tile(np.array([0.25, 0.5, 0], np.float32), (count, 1)),
        np.tile(np.array([0, 0, 2], np.float32), (count, 1)),
        np.full(count, t_max, np.float32),
    )


def test_first_hit_and_barycentrics():
    hits = EmbreeScene(STACK).trace(down_z(3))
    assert hits.primitive.tolist() == [1, 1, 1] and hits.primitive.dtype == np.int32
    assert np.allclose(hits.t, 0.5) and hits.t.dtype == np.float32
    assert np.allclose(hits.u, 0.25) and np.allclose(hits.v, 0.5)  # P = (1-u-v) v0 + u v1 + v v2


def test_t_max_is_honoured_and_kept():
    rays = down_z(4)
    rays.t_max[:] = [0.25, np.inf, np.nan, -1]
    before = rays.t_max.copy()
    hits = EmbreeScene(STACK).trace(rays)
    assert hits.primitive.tolist() == [MISS, 1, MISS, MISS]
    assert np.isinf(hits.t[[0, 2, 3]]).all()
    assert np.array_equal(rays.t_max, before, equal_nan=True)


def test_inactive_triangles_keep_their_numbers():
    active = np.array([True, False, True])
    assert EmbreeScene(STACK, active=active).trace(down_z(1)).primitive.tolist() == [2]
    assert EmbreeScene(STACK, active=np.zeros(3, bool)).trace(down_z(1)).primitive.tolist() == [MISS]


def test_threads_and_modes_agree():
    rng = np.random.default_rng(1)
    mesh = rng.random((500, 3, 3)).astype(np.float32)
    rays = Rays(
        rng.random((200_001, 3)).astype(np.float32),
        rng.normal(size=(200_001, 3)).astype(np.float32),
        np.full(200_001, np.inf, np.float32),
    )
    scene = EmbreeScene(mesh)
    assert scene.build_seconds > 0
    one, two = scene.trace(rays, threads=1), scene.trace(rays, threads=2)
    assert one.tobytes() == two.tobytes()
    fast = EmbreeScene(mesh, robust=False).trace(rays)
    assert np.mean(fast.primitive == one.primitive) > 0.999


def test_no_rays():
    assert len(EmbreeScene(STACK).trace(down_z(0))) == 0
