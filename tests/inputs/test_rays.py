"""Ray sets: the same bits for a seed, the right distribution, clear errors."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import icosphere

from harness.data import Rays, Scene, View
from harness.errors import DefrayError
from harness.inputs import rays as rays_module
from harness.inputs.rays import (
    OCCLUSION_REACH,
    checked,
    image_rays,
    make_rays,
    offset_origin,
    primary_rays,
    read_rays,
    sphere_points,
)

INSIDE = View((0.1, 0.0, 0.0), (1.0, 0.2, 0.1), name="inside")
AWAY = View((0.0, 0.0, 5.0), (0.0, 0.0, 9.0), name="away")
SCENE = Scene("ball", icosphere(3), (INSIDE, AWAY))


@pytest.mark.parametrize("kind", ["primary", "diffuse", "ambient-occlusion", "random"])
def test_a_seed_gives_the_same_bits_and_another_seed_others(kind):
    first, again, other = (make_rays(SCENE, kind, 1000, seed) for seed in (1, 1, 2))
    assert len(first) == 1000 and first.kind == kind
    for name in ("origins", "directions", "t_max"):
        assert getattr(first, name).dtype == np.float32
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()
    assert not np.array_equal(first.directions, other.directions)


def test_diffuse_rays_are_cosine_weighted_about_the_normal_that_faces_the_eye():
    floor = Scene("floor", np.array([[[-9, 0, -9], [9, 0, -9], [0, 0, 18]]], np.float32),
                  (View((0, 2, 0), (0, 0, 0.01), fov_degrees=20),))  # fmt: skip
    rays = make_rays(floor, "diffuse", 40_000)
    cosine = rays.directions[:, 1]
    assert (cosine >= 0).all()
    assert np.linalg.norm(rays.directions, axis=1) == pytest.approx(1, abs=1e-6)
    # For a density proportional to the cosine: mean 2/3, mean square 1/2.
    assert cosine.mean() == pytest.approx(2 / 3, abs=0.01)
    assert (cosine**2).mean() == pytest.approx(1 / 2, abs=0.01)
    assert (rays.origins[:, 1] > 0).all() and (rays.origins[:, 1] < 1e-3).all()


def test_points_on_the_sphere_are_uniform():
    points = sphere_points(50_000, seed=3)
    assert np.linalg.norm(points, axis=1) == pytest.approx(1, abs=1e-12)
    assert points.mean(axis=0) == pytest.approx(0, abs=0.01)
    assert (points**2).mean(axis=0) == pytest.approx(1 / 3, abs=0.01)


@pytest.mark.parametrize("kind", ["primary", "diffuse"])
def test_rays_made_piece_by_piece_are_the_same(monkeypatch, kind):
    outside = View((0, 0, 3), (0, 0, 0), fov_degrees=60.0)  # half of the image is empty: several passes over it
    ball = Scene("ball", icosphere(), views=(outside,))
    whole = make_rays(ball, kind, 5001)
    monkeypatch.setattr(rays_module, "PIECE", 700)
    pieces = make_rays(ball, kind, 5001)
    for column in ("origins", "directions", "t_max"):
        assert getattr(pieces, column).tobytes() == getattr(whole, column).tobytes()


def test_origins_move_off_the_surface_by_about_256_ulp():
    points = np.array([[100, -100, 0.001]], np.float32).repeat(2, axis=0)
    normals = np.array([[1, 0, 0], [0, 1, 1]], np.float32) / np.float32([[1], [np.sqrt(2)]])
    moved = offset_origin(points, normals)
    assert moved[0, 0] - 100 == pytest.approx(256 * np.spacing(np.float32(100)), rel=0.01)
    assert moved[0, 1] == -100
    assert moved[1, 1] > -100
    assert moved[1, 2] - np.float32(0.001) == pytest.approx(np.sqrt(0.5) / 65536, rel=0.01)


def test_the_image_is_upright_and_its_middle_looks_at_the_target():
    rays = image_rays(View((0, 0, 5), (0, 0, 0), fov_degrees=90), 5, 3)
    assert rays.directions[7] == pytest.approx([0, 0, -1])
    assert rays.directions[0][0] < 0 < rays.directions[4][0]
    assert rays.directions[0][1] > 0 > rays.directions[10][1]
    assert len(primary_rays(INSIDE, 12345, seed=1)) == 12345


def test_occlusion_rays_have_a_reach():
    rays = make_rays(SCENE, "ambient-occlusion", 100)
    assert rays.t_max == pytest.approx(OCCLUSION_REACH * np.sqrt(12), rel=0.01)


def test_rays_from_files(tmp_path):
    rays = make_rays(SCENE, "random", 50)
    both = np.concatenate([rays.origins, rays.directions], axis=1).astype("<f4")
    (tmp_path / "a.rays").write_bytes(both.tobytes())
    np.savez(tmp_path / "b.npz", origins=rays.origins, directions=rays.directions, t_max=np.full(50, 2.0))
    raw, packed = (make_rays(SCENE, "file", 1000, ray_file=str(tmp_path / name)) for name in ("a.rays", "b.npz"))
    for read in (raw, packed):
        assert (read.origins == rays.origins).all() and (read.directions == rays.directions).all()
    assert np.isinf(raw.t_max).all() and (packed.t_max == 2).all()
    assert len(make_rays(SCENE, "file", 7, ray_file=str(tmp_path / "a.rays"))) == 7


def bad_rays(origin=(0, 0, 0), direction=(1, 0, 0), t_max=1.0) -> Rays:
    rays = make_rays(SCENE, "random", 5)
    rays.origins[3], rays.directions[3], rays.t_max[3] = origin, direction, t_max
    return rays


@pytest.mark.parametrize(
    ("rays", "message"),
    [
        ({"direction": (0, 0, 0)}, "ray 3 has a direction of zero length"),
        ({"direction": (0, -0.0, 0)}, "ray 3 has a direction of zero length"),
        ({"origin": (np.nan, 0, 0)}, "ray 3 has an origin or direction that is not finite"),
        ({"direction": (np.inf, 0, 0)}, "ray 3 has an origin or direction that is not finite"),
        ({"t_max": np.nan}, "ray 3 has a negative t_max"),
        ({"t_max": -1}, "ray 3 has a negative t_max"),
    ],
)
def test_the_first_bad_ray_is_named(rays, message):
    with pytest.raises(DefrayError, match=message):
        checked(bad_rays(**rays))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("curved", 10), "unknown kind of rays 'curved'; known: ambient-occlusion, diffuse"),
        (("diffuse", 0), "at least one ray"),
        (("diffuse", 10, 1, "side"), "unknown view of ball 'side'; known: away, inside"),
        (("diffuse", 10, 1, "away"), "view away of scene ball sees no triangle"),
        (("file", 10), "--ray-file"),
        (("file", 10, 1, None, "missing.rays"), "missing.rays does not exist"),
    ],
)
def test_what_cannot_be_made_is_refused(arguments, message):
    with pytest.raises(DefrayError, match=message):
        make_rays(SCENE, *arguments)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("short.rays", b"\0" * 25, "no whole number of rays"),
        ("text.npz", b"hello", "cannot be read"),
        ("empty.rays", b"", "at least one ray"),
    ],
)
def test_a_bad_ray_file_is_refused(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DefrayError, match=message):
        make_rays(SCENE, "file", 10, ray_file=str(tmp_path / name))


def test_a_ray_file_without_directions_is_refused(tmp_path):
    np.savez(tmp_path / "half.npz", origins=np.zeros((4, 3)))
    with pytest.raises(DefrayError, match="array 'directions' is missing"):
        read_rays(str(tmp_path / "half.npz"))
