"""Scenes by name and from files, and one clear line for whatever is wrong with them."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import scenes
from harness.data import View
from harness.errors import DefrayError
from harness.inputs import scenes_by_name as scene_module
from harness.inputs.scenes_by_name import list_scenes, load_scene
from harness.inputs.viewpoints import find_views

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]], np.int32)
CORNERS = POINTS[FACES]


def refused(text: str) -> str:
    """The message of the DefrayError that loading raises, always one line."""
    with pytest.raises(DefrayError) as caught:
        load_scene(text)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.fixture
def recipe(monkeypatch, tmp_path):
    """A small scene with a file and a stand-in, in place of all others; its cache lies in tmp_path/cache."""
    file = tmp_path / "real" / "small.npz"
    file.parent.mkdir()
    np.savez(file, vertices=POINTS, faces=FACES)
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    made = []

    def stand_in(seed):
        made.append(seed)
        return CORNERS + np.float32(5)

    stand_in.__module__ = "scenes.shapes"
    entry = scenes.Recipe("small", "Small", 3, (("small.npz", digest),), (View((0, 0, 5), (0, 0, 0)),), (), stand_in)
    known = {"small": entry, "bare": replace(entry, name="bare", stand_in=None)}
    monkeypatch.setattr(scene_module, "recipes", lambda: known)
    monkeypatch.setenv("DEFRAY_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("DEFRAY_SCENES", raising=False)
    return {"made": made, "real": file, "cache": tmp_path / "cache"}


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb"])
def test_every_common_format_gives_its_triangles_in_order(tmp_path, suffix):
    file = tmp_path / f"three.{suffix}"
    trimesh.Trimesh(POINTS, FACES, process=False).export(file)
    scene = load_scene(str(file))
    assert scene.triangles.dtype == np.float32 and scene.source == "file" and scene.name == "three"
    assert np.array_equal(scene.triangles, CORNERS)
    assert scene.sha256 == hashlib.sha256(CORNERS.tobytes()).hexdigest()
    assert [view.name for view in scene.views] == ["outside", "inside"]


def test_npz_with_vertices_and_faces(tmp_path):
    np.savez(tmp_path / "a.npz", vertices=POINTS.astype(np.float64), faces=FACES.astype(np.uint8))
    assert np.array_equal(load_scene(str(tmp_path / "a.npz")).triangles, CORNERS)


def test_a_scene_graph_is_flattened_with_its_transforms(tmp_path):
    graph, mesh = trimesh.Scene(), trimesh.Trimesh(POINTS, FACES, process=False)
    for offset in (0, 10):
        graph.add_geometry(mesh, transform=trimesh.transformations.translation_matrix([offset, 0, 0]))
    graph.export(tmp_path / "two.glb")
    triangles = load_scene(str(tmp_path / "two.glb")).triangles
    assert len(triangles) == 6
    assert sorted(np.unique(triangles[:, :, 0]).tolist()) == [0, 1, 10, 11]


def test_quads_become_triangles_and_materials_do_not_reorder(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl b\nf 1 2 3 4\nusemtl a\nf 1 2 3\nusemtl b\nf 2 3 4\n"
    (tmp_path / "quad.obj").write_text(text)
    triangles = load_scene(str(tmp_path / "quad.obj")).triangles
    assert len(triangles) == 4
    assert triangles[3].tolist() == [[1, 0, 0], [1, 1, 0], [0, 1, 0]]


def test_zero_area_triangles_and_unused_vertices_stay_in_the_numbering(tmp_path):
    faces = np.array([[0, 1, 2], [1, 1, 1], [0, 1, 3]])
    np.savez(tmp_path / "z.npz", vertices=np.concatenate([POINTS, POINTS + 9]), faces=faces)
    triangles = load_scene(str(tmp_path / "z.npz")).triangles
    assert np.array_equal(triangles, POINTS[faces])


def test_the_outside_view_encloses_the_bounds():
    outside, inside = find_views(CORNERS + np.float32(100)).views
    assert np.linalg.norm(np.array(outside.eye) - 100.5) > 1.5
    assert np.array(inside.eye) == pytest.approx([100.5] * 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vertices": np.where(np.eye(4, 3) == 1, np.nan, POINTS)}, "vertex 0 is not finite in float32: [nan, 0.0"),
        ({"vertices": np.where(np.arange(4)[:, None] == 2, np.inf, POINTS)}, "vertex 2 is not finite"),
        ({"vertices": POINTS.astype(np.float64) * 1e300}, "is not finite in float32"),
        ({"faces": FACES + 2}, "names a vertex outside 0..3"),
        ({"faces": -FACES}, "names a vertex outside 0..3"),
        ({"faces": FACES[:0]}, "holds no triangle"),
        ({"faces": FACES.astype(float)}, "integers"),
        ({"vertices": POINTS[:, :2]}, "must be [v,3] and [n,3]"),
        ({"faces": None}, "faces"),
    ],
)
def test_a_faulty_npz_is_refused(tmp_path, change, message):
    arrays = {"vertices": POINTS, "faces": FACES, **change}
    np.savez(tmp_path / "bad.npz", **{name: array for name, array in arrays.items() if array is not None})
    assert message in refused(str(tmp_path / "bad.npz"))


@pytest.mark.parametrize("suffix", ["npz", "ply", "glb", "stl", "obj", "off"])
@pytest.mark.parametrize("content", [b"", b"\x00\xff not a mesh \xfe" * 30])
def test_garbage_is_refused(tmp_path, suffix, content):
    (tmp_path / f"garbage.{suffix}").write_bytes(content)
    assert f"garbage.{suffix}" in refused(str(tmp_path / f"garbage.{suffix}"))


def test_a_missing_file_a_folder_and_an_unknown_name_are_refused(tmp_path, recipe):
    assert "missing.obj does not exist" in refused("missing.obj")
    assert "is a folder" in refused(f"{tmp_path}/")
    assert refused("sponsa") == "unknown scene 'sponsa'; known: bare, small; or name a mesh file"


def test_a_name_too_long_for_a_path_is_an_unknown_scene(recipe):
    assert refused("x" * 5000).startswith("unknown scene")


def test_a_truncated_file_is_refused(tmp_path):
    np.savez(tmp_path / "whole.npz", vertices=POINTS, faces=FACES)
    (tmp_path / "cut.npz").write_bytes((tmp_path / "whole.npz").read_bytes()[:-40])
    assert "cut.npz" in refused(str(tmp_path / "cut.npz"))


def test_real_geometry_is_preferred_and_verified(recipe, monkeypatch):
    monkeypatch.setenv("DEFRAY_SCENES", str(recipe["real"].parent))
    scene = load_scene("small")
    assert scene.source == "real" and scene.title == "small" and np.array_equal(scene.triangles, CORNERS)
    np.savez(recipe["real"], vertices=POINTS * 2, faces=FACES)
    message = refused("small")
    assert "small.npz is not the expected file: SHA-256" in message and "expected" in message


def test_a_folder_that_is_not_there_is_an_error(recipe, monkeypatch):
    monkeypatch.setenv("DEFRAY_SCENES", "/nowhere/at/all")
    assert refused("small") == "DEFRAY_SCENES=/nowhere/at/all is not a folder"


def test_a_stand_in_is_made_once_and_says_what_it_is(recipe):
    first, second = load_scene("small"), load_scene("small")
    assert recipe["made"] == [scene_module.SEED]
    assert first.title == "small (stand-in)" and first.source == "stand-in"
    assert first.sha256 == second.sha256


@pytest.mark.parametrize("damage", [b"", b"nonsense", None])
def test_a_damaged_cache_is_made_again(recipe, damage):
    whole = load_scene("small")
    (file,) = recipe["cache"].iterdir()
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0x40
    file.write_bytes(bytes(content) if damage is None else damage)
    assert load_scene("small").sha256 == whole.sha256
    assert len(recipe["made"]) == 2


def test_a_cache_that_cannot_be_written_costs_only_time(recipe):
    recipe["cache"].write_text("a file where the folder should be")
    assert len(load_scene("small")) == 3


def test_without_file_or_stand_in_the_scene_is_missing(recipe):
    assert refused("bare") == "scene bare is missing: set DEFRAY_SCENES to a folder with small.npz"


def test_the_list_says_where_each_scene_comes_from(recipe, monkeypatch):
    assert [(s.name, s.source) for s in list_scenes()] == [("small", "stand-in"), ("bare", "missing")]
    monkeypatch.setenv("DEFRAY_SCENES", str(recipe["real"].parent))
    assert {s.source for s in list_scenes()} == {"real"}


@pytest.mark.parametrize(("scale", "message"), [(1e30, "reach 1e+30; scale it"), (1e-20, "large; scale it up")])
def test_a_scale_that_float32_cannot_trace_is_refused(tmp_path, scale, message):
    np.savez(tmp_path / "scaled.npz", vertices=POINTS * np.float32(scale), faces=FACES)
    assert message in refused(str(tmp_path / "scaled.npz"))
