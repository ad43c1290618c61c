"""The ladder of sizes: names, triangles, views, cache, memory, sweeps and the figure's exponent."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import made_up_claims
import numpy as np
import pytest
import trimesh
from shapes import icosphere, soup

import scenes
from harness.analysis.names import scene_and_size
from harness.campaign.plan import expand
from harness.data import View
from harness.errors import DefrayError
from harness.inputs import scenes_by_name as scene_module
from harness.inputs import sizes as ladder_module
from harness.inputs.memory import announcements, check_memory
from harness.inputs.rays import image_rays
from harness.inputs.scenes_by_name import expected_triangles, load_scene
from harness.inputs.sizes import clustered, decimated, resized, subdivided, welded
from harness.inputs.viewpoints import find_views
from harness.measure.scene import Scenes
from harness.reference.embree_scene import EmbreeScene
from harness.report.figures import size_ladder
from harness.spec.run_spec import split_size
from harness.stats import exponent
from scenes import hairball
from scenes.shapes import areas, box, quad

BALL = icosphere(5)  # 20,480 triangles


def edges(triangles: np.ndarray) -> dict:
    """How many triangles share each edge, by the bits of its ends."""
    found: dict = {}
    for triangle in triangles:
        ends = [corner.tobytes() for corner in triangle]
        for one, two in zip(ends, ends[1:] + ends[:1]):
            found[frozenset((one, two))] = found.get(frozenset((one, two)), 0) + 1
    return found


@pytest.fixture
def known(monkeypatch, tmp_path):
    """Two scenes of a ball, one a stand-in and one real; how often the stand-in was made is `known`'s length."""
    made = []

    def stand_in(seed):
        made.append(seed)
        return BALL

    stand_in.__module__ = "scenes.shapes"
    np.savez(tmp_path / "ball.npz", vertices=BALL.reshape(-1, 3), faces=np.arange(3 * len(BALL)).reshape(-1, 3))
    digest = scene_module.hash_of(tmp_path / "ball.npz")
    view = (View((0, 0, 5), (0, 0, 0)),)
    ball = scenes.Recipe("ball", "Ball", len(BALL), (), (), view, stand_in)
    real = scenes.Recipe("real", "Real", len(BALL), (("ball.npz", digest),), view)
    monkeypatch.setattr(scene_module, "recipes", lambda: {"ball": ball, "real": real})
    monkeypatch.setenv("DEFRAY_SCENES", str(tmp_path))
    monkeypatch.setenv("DEFRAY_CACHE", str(tmp_path / "cache"))
    return made


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("crown", ("crown", "1")),
        ("crown@1/16", ("crown", "1/16")),
        ("crown@4", ("crown", "4")),
        ("crown@1", ("crown", "1")),
        ("folder@home/bunny.ply", ("folder@home/bunny.ply", "1")),
        ("bunny.ply@1/4", ("bunny.ply", "1/4")),
    ],
)
def test_a_size_is_split_off_a_name(name, parts):
    assert split_size(name) == parts


@pytest.mark.parametrize("name", ["ball@1/3", "ball@16", "ball@1/", "ball@0.25"])
def test_an_unknown_size_is_refused(known, name):
    with pytest.raises(DefrayError, match=r"unknown size .*; known: 1/64, 1/16, 1/4, 1, 4"):
        load_scene(name)


def test_a_file_with_an_at_sign_in_its_name_is_a_file(tmp_path):
    trimesh.Trimesh(*trimesh.creation.box().triangles.reshape(1, -1, 3), np.arange(36).reshape(-1, 3)).export(
        tmp_path / "box.obj"
    )
    (tmp_path / "box.obj").rename(tmp_path / "box.obj@4")
    assert split_size(str(tmp_path / "box.obj@4"))[1] == "1"


def test_only_stand_ins_are_enlarged(known, tmp_path):
    assert len(load_scene("ball@4")) == 4 * len(BALL)
    for name in ("real@4", str(tmp_path / "ball.npz") + "@4"):
        with pytest.raises(DefrayError, match="only stand-ins are enlarged"):
            load_scene(name)


def test_four_times_the_triangles_are_the_same_surface():
    fine = subdivided(BALL)
    assert len(fine) == 4 * len(BALL) and fine.dtype == np.float32
    assert areas(fine).sum() == pytest.approx(areas(BALL).sum(), rel=1e-5)
    assert areas(fine).reshape(-1, 4).sum(axis=1) == pytest.approx(areas(BALL), rel=1e-3)
    small = subdivided(icosphere(2))
    assert set(edges(small).values()) == {2}, "an edge that two triangles shared is no longer shared"


@pytest.mark.parametrize("size", ["1/64", "1/16", "1/4"])
@pytest.mark.parametrize("mesh", ["ball", "soup", "tiles"])
def test_a_smaller_rung_has_its_share_of_triangles(mesh, size):
    triangles = {
        "ball": BALL,
        "soup": soup(20_000, size=0.02),  # nothing to collapse: every triangle stands alone
        "tiles": np.concatenate([quad((0, 0, z), (1, 0, 0), (0, 1, 0), 60, 60) for z in range(3)]).astype(np.float32),
    }[mesh]
    small = resized(triangles, size)
    assert small.dtype == np.float32 and small.shape[1:] == (3, 3)
    most = 0.15 if mesh == "tiles" else 0.06  # a regular mesh in a regular lattice leaves few numbers to choose from
    assert len(small) == pytest.approx(len(triangles) * float(ladder_module.SIZES[size]), rel=most)
    assert np.abs(small).max() <= np.abs(triangles).max() * 1.01
    assert resized(triangles, size).tobytes() == small.tobytes()


def test_walls_survive_decimation():
    # Detailed furniture in a room of twelve triangles: decimation without borders held drops the walls first.
    room = np.concatenate([box((-5, -5, -5), (5, 5, 5)), BALL, icosphere(4, 0.5, (2, 2, 2))]).astype(np.float32)
    for wanted in (len(room) // 4, len(room) // 64):
        small = decimated(room, wanted)
        seen = EmbreeScene(small).trace(image_rays(View((4, 4, 4), (-4, -4, -4), fov_degrees=90.0), 48, 48))
        assert (seen.primitive >= 0).all()


def test_welding_joins_equal_corners_and_drops_what_loses_its_area():
    vertices, faces = welded(np.concatenate([box((0, 0, 0), (1, 1, 1)), np.zeros((1, 3, 3))]).astype(np.float32))
    assert len(vertices) == 8 and len(faces) == 12
    assert vertices[faces].tolist() == box((0, 0, 0), (1, 1, 1)).tolist()
    assert len(welded(np.float32([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[-0.0, 0, 0], [1, 0, 0], [0, 0, 1]]]))[0]) == 4


def test_clustering_leaves_no_triangle_twice():
    vertices, faces = clustered(*welded(BALL), 400)
    doubled = np.unique(np.sort(faces, axis=1), axis=0)
    assert len(doubled) == len(faces) == pytest.approx(400, rel=0.06)
    assert np.linalg.norm(vertices, axis=1).max() <= 1.0001


def test_too_few_triangles_are_no_scene():
    with pytest.raises(DefrayError, match="1/64 of 12 triangles is too few"):
        resized(box((0, 0, 0), (1, 1, 1)).astype(np.float32), "1/64")


def test_a_rung_shares_the_views_and_says_its_size(known):
    whole, small = load_scene("ball"), load_scene("ball@1/16")
    assert small.name == "ball@1/16" and small.title == "ball@1/16 (stand-in)" and small.views == whole.views
    assert load_scene("ball@1").name == "ball" and load_scene("real@1/4").source == "real"
    assert small.sha256 != whole.sha256 and len(small) == pytest.approx(len(BALL) / 16, rel=0.05)


def test_a_rung_of_a_mesh_file_keeps_the_views_found_for_the_whole(tmp_path, known):
    scene = load_scene(str(tmp_path / "ball.npz") + "@1/4")
    assert scene.views == find_views(BALL).views and scene.name == "ball@1/4"


def test_a_rung_is_made_once(known, monkeypatch):
    first = load_scene("ball@1/4")
    monkeypatch.setattr(scene_module, "resized", lambda *_: pytest.fail("made again"))
    assert load_scene("ball@1/4").sha256 == first.sha256


def test_a_generator_that_makes_smaller_scenes_itself_is_asked(known, monkeypatch):
    small = replace(scene_module.recipes()["ball"], smaller=lambda seed, size: BALL[: int(size * len(BALL))])
    monkeypatch.setattr(scene_module, "recipes", lambda: {"ball": small})
    assert np.array_equal(load_scene("ball@1/16").triangles, BALL[: len(BALL) // 16])
    assert np.array_equal(load_scene("ball@4").triangles, subdivided(BALL))


@pytest.mark.parametrize("size", ["1/64", "1/16", "1/4"])
def test_hairballs_smaller_rungs_are_hair_of_the_same_opacity(size):
    small = hairball.smaller(1, float(ladder_module.SIZES[size]))
    assert len(small) == hairball.RECIPE.triangles * ladder_module.SIZES[size]
    assert small.dtype == np.float32 and np.abs(small).max() < 1.2
    rays = image_rays(hairball.RECIPE.stand_in_views[0], 64, 64)
    assert (EmbreeScene(small).trace(rays).primitive >= 0).mean() == pytest.approx(0.65, abs=0.03)


def test_a_rung_of_other_content_is_made_anew(known, monkeypatch):
    first = load_scene("real@1/4")
    recipes = scene_module.recipes()

    def other(seed):
        return BALL * np.float32(2)

    other.__module__ = "scenes.shapes"
    changed = replace(recipes["ball"], name="real", stand_in=other)
    monkeypatch.setattr(scene_module, "recipes", lambda: {"real": changed})
    assert load_scene("real@1/4").sha256 != first.sha256


class Memory(NamedTuple):
    """What is asked of a device here."""

    name: str
    memory_bytes: int
    max_allocation_bytes: int


def test_large_rungs_are_announced(monkeypatch, tmp_path):
    monkeypatch.setenv("DEFRAY_CACHE", str(tmp_path))  # without a fetched copy of another size
    assert expected_triangles("san-miguel@4") == 4 * 9_388_826 and expected_triangles("bunny.ply@1/4") is None
    (line,) = announcements([("small", 1000), ("file", None), ("san-miguel@4", 37_555_304)])
    assert line == "san-miguel@4: about 37,555,304 triangles, 2.8 GiB on the device, 10.1 GiB of main memory"


def test_a_rung_beyond_the_devices_memory_is_refused_before_it_is_made(known, monkeypatch):
    small = Memory("a small device", 10**6, 10**9)
    with pytest.raises(DefrayError, match=r"ball@4 of about 81,920 triangles needs .* a small device has 0\.0 GiB"):
        Scenes(small).load("ball@4")
    assert not known
    check_memory("ball", 1000, small)
    with pytest.raises(DefrayError, match="one buffer of a small device"):
        check_memory("ball", 30_000, Memory("a small device", 10**9, 10**6))
    with pytest.raises(DefrayError, match="this machine has"):
        check_memory("ball", 10**12, None)


SWEEP = """
[[tiers.paper.sweeps]]
name = "ladder"
scenes = {scenes}
sizes = {sizes}
grids = "2/8"
rays = 100
variants = "forward:ray-space"
"""


@pytest.fixture
def plan(tmp_path):
    def scenes_of(names: str, sizes: str) -> list[str]:
        file = tmp_path / "sweep.toml"
        file.write_text(SWEEP.format(scenes=names, sizes=sizes))
        return [spec.scene for spec in expand(file, "paper")]

    return scenes_of


def test_a_sweep_runs_every_size_there_is(known, plan):
    assert plan('["ball", "real"]', '["1/4", "1", "4"]') == ["ball@1/4", "ball", "ball@4", "real@1/4", "real"]
    assert plan('["ball@1/64"]', '"1"') == ["ball@1/64"]


def test_a_sweep_with_an_unknown_size_is_refused(known, plan):
    with pytest.raises(DefrayError, match="sweep 'ladder': unknown size '1/2'"):
        plan('["ball"]', '["1/2"]')
    with pytest.raises(DefrayError, match="sweep 'ladder': real@4: only stand-ins"):
        plan('["real@4"]', '["1"]')


def test_an_exponent_is_found_with_a_factor_for_each_group():
    sizes = [1e3, 1e4, 1e5, 1e6] * 2
    values = [7 * size**-0.5 for size in sizes[:4]] + [900 * size**-0.5 for size in sizes[4:]]
    fit = exponent(sizes, values, ["a"] * 4 + ["b"] * 4)
    assert (fit.median, fit.low, fit.high) == pytest.approx((-0.5, -0.5, -0.5))
    noisy = exponent(sizes, np.array(values) * [1, 2, 1, 1, 1, 1, 0.5, 1], ["a"] * 4 + ["b"] * 4)
    assert noisy.low < -0.5 < noisy.high and noisy.high - noisy.low > 0.02


@pytest.mark.parametrize(
    ("sizes", "values"), [([5, 5], [1, 2]), ([1, 2], [0, 1]), ([1, 2, 3], [1, 2]), ([1, float("nan")], [1, 2])]
)
def test_an_exponent_of_nothing_is_an_error(sizes, values):
    with pytest.raises(DefrayError):
        exponent(sizes, values, ["a"] * len(sizes))


def record(name: str, source: str, triangles: int, tracer: str, seconds: float) -> dict:
    """A record with three repetitions of so many seconds."""
    made = made_up_claims.record(f"{tracer}:ray-space", "crown", [seconds, seconds * 1.01, seconds * 0.99])
    rate = {"median": 1000 / seconds, "low": 990 / seconds, "high": 1010 / seconds}
    scene = {"name": name, "source": source, "triangles": triangles, "sha256": ""}
    return made | {
        "id": f"{name}-{tracer}",
        "scene": scene,
        "rate": made["rate"] | {"intersect": rate, "total": rate},
    }


@pytest.fixture
def runs(tmp_path):
    """A real ladder whose rate goes as the power -1/2, and whose speed-up grows as 1/4; a stand-in's of -1."""
    records = []
    for size, count in (("1/64", 1e4), ("1/16", 4e4), ("1/4", 16e4), ("1", 64e4)):
        name = "sponza" if size == "1" else f"sponza@{size}"
        records.append(record(name, "real", int(count), "deferred", count**0.5))
        records.append(record(name, "real", int(count), "work-optimal", count**0.75))
        name = "hairball" if size == "1" else f"hairball@{size}"
        records.append(record(name, "stand-in", int(count) * 9, "deferred", count))
    records.append(record("crown", "real", 99, "deferred", 1.0))
    return made_up_claims.results(records, tmp_path)


def test_the_figure_tells_real_from_stand_in_and_fits_each(runs):
    numbers = size_ladder.select(runs)
    assert set(numbers["scene"]) == {"sponza", "hairball"}, "a scene in one size is no ladder"
    real = numbers[numbers["kind"] == size_ladder.REAL].iloc[0]
    assert real["rate_mrays_per_s_exponent"] == pytest.approx(-0.5)
    assert real["speedup_exponent"] == pytest.approx(0.25)
    stand_in = numbers[numbers["kind"] == size_ladder.STAND_IN].iloc[0]
    assert stand_in["rate_mrays_per_s_exponent"] == pytest.approx(-1) and np.isnan(stand_in["speedup_exponent"])
    caption = size_ladder.caption(runs, numbers)
    assert "−0.50 (−0.50 to −0.50) for real geometry and −1.00 (−1.00 to −1.00) for stand-ins" in caption
    for narrow in (False, True):
        labels = size_ladder.draw(runs, numbers, narrow).axes[0].get_legend_handles_labels()[1]
        assert sorted(labels) == ["Hairball (stand-in)", "Sponza"]


def test_other_figures_leave_the_rungs_out(runs):
    assert set(runs.every_diffuse["scene"]) == {"sponza", "hairball", "crown"}
    assert runs.scene_title("sponza@1/4") == "Sponza at 1/4" and scene_and_size("a@b") == ("a@b", "1")
