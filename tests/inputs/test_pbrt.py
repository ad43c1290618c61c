"""pbrt scene files: transforms, instances, what is left out, and one line for what is wrong."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
import trimesh

from harness.errors import DefrayError
from harness.inputs.fetch import pbrt as pbrt_module
from harness.inputs.fetch.pbrt import directives, parameters, read_pbrt

MAIN = """
Scale -1 1 1  # the camera alone
LookAt 0 0 5  0 0 0  0 1 0
WorldBegin
AttributeBegin
  AreaLightSource "diffuse" "rgb L" [ 9 9 9 ]
  Shape "trianglemesh" "integer indices" [0 1 2] "point3 P" [ 0 0 0 1 0 0 0 1 0 ]
AttributeEnd
Shape "sphere" "float radius" [100]
Include "geometry/leaf.pbrt"
AttributeBegin
  Translate 10 0 0
  Shape "trianglemesh" "point3 P" [ 0 0 0 1 0 0 0 1 0 ] "integer indices" [ 0 1 2 0 2 1 ] "bool two" true
AttributeEnd
Shape "plymesh" "string filename" [ "geometry/quad.ply" ] "texture alpha" [ "a b" ]
"""
LEAF = """
AttributeBegin
  ObjectBegin "leaf"
    Scale 2 2 2
    Shape "plymesh" "string filename" "geometry/quad.ply"
  ObjectEnd
AttributeEnd
AttributeBegin
  Transform [ 1 0 0 0 0 1 0 0 0 0 1 0 0 0 7 1 ]
  ObjectInstance "leaf"
AttributeEnd
AttributeBegin
  Rotate 90 0 0 1
  ObjectInstance "leaf"
AttributeEnd
"""
QUAD = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]], process=False).export(file_type="ply")


@pytest.fixture
def scene(tmp_path):
    """Read a scene from tmp_path; `scene(text)` is its main file."""
    (tmp_path / "geometry").mkdir()
    (tmp_path / "geometry" / "leaf.pbrt").write_text(LEAF)
    (tmp_path / "geometry" / "quad.ply").write_bytes(QUAD)

    def read(text: str):
        (tmp_path / "main.pbrt").write_text(text)
        found = read_pbrt("main.pbrt", lambda name: tmp_path / name)
        return np.concatenate([vertices[faces] for vertices, faces in found.parts]), found.skipped

    return read


def test_a_scene_is_flattened_in_the_order_of_its_text(scene):
    triangles, skipped = scene(MAIN)
    assert triangles[0].tolist() == [[0, 0, 7], [2, 0, 7], [2, 2, 7]]
    assert np.allclose(triangles[1], [[0, 0, 0], [0, 2, 0], [-2, 2, 0]])
    assert triangles[2].tolist() == [[10, 0, 0], [11, 0, 0], [10, 1, 0]]
    assert triangles[3].tolist() == [[10, 0, 0], [10, 1, 0], [11, 0, 0]]
    assert triangles[4].tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]] and len(triangles) == 5
    assert skipped == {"light": 1, "sphere": 1}


def test_coordinate_systems_are_named_and_used(scene):
    shape = 'Shape "trianglemesh" "point3 P" [ 0 0 0 1 0 0 0 1 0 ]\n'
    text = 'Translate 0 0 3\nCoordinateSystem "up"\nIdentity\nCoordSysTransform "up"\n' + shape
    assert scene(text)[0][0, :, 2].tolist() == [3, 3, 3]
    # LookAt carries the eye to the origin, and what it looks at on to the positive z axis.
    seen = scene("LookAt 1 2 3 1 2 9 0 1 0\n" + shape.replace("0 0 0 1 0 0 0 1 0", "1 2 3 1 2 5 1 4 5"))[0]
    assert np.allclose(seen[0], [[0, 0, 0], [0, 0, 2], [0, 2, 2]])


def test_packed_files_are_unpacked(scene, tmp_path):
    (tmp_path / "geometry" / "q.ply.gz").write_bytes(gzip.compress(QUAD))
    (tmp_path / "more.pbrt.gz").write_bytes(gzip.compress(b'Shape "plymesh" "string filename" "geometry/q.ply.gz"'))
    assert scene('Include "more.pbrt.gz"')[0].tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]]]


def test_instances_cannot_fill_the_memory(scene, monkeypatch):
    monkeypatch.setattr(pbrt_module, "MOST_TRIANGLES", 4)
    with pytest.raises(DefrayError, match="more than 4 triangles with its instances"):
        scene(MAIN)


def test_the_text_is_taken_apart():
    text = 'Shape "plymesh" "string filename" [ "a b.ply" ] # a "comment"\n"bool two" true "float x" [1 2]'
    text += "Translate 1 2 3"
    (name, arguments), (other, numbers) = directives(text)
    assert (name, other, numbers) == ("Shape", "Translate", ["1", "2", "3"])
    assert parameters(arguments[1:]) == {"filename": ["a b.ply"], "two": ["true"], "x": ["1", "2"]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('Include "../../secret.pbrt"', "names '../../secret.pbrt', which leads out of its folder"),
        ('Shape "plymesh" "string filename" "/etc/passwd"', "leads out of its folder"),
        ('Include "main.pbrt"', "deep"),
        ("AttributeEnd", "ends what was not begun"),
        ('ObjectInstance "nothing"', "ObjectInstance nothing: 'nothing'"),
        ("Translate 1 2", "Translate 1 2: cannot reshape"),
        ('Shape "sphere"', "holds no triangle"),
        ('ObjectBegin "a" ObjectBegin "b"', "an object inside another"),
        ('Shape "plymesh" "string filename" "geometry/leaf.pbrt"', "cannot be read as a mesh"),
    ],
)
def test_a_faulty_scene_is_refused_in_one_line(scene, text, message):
    with pytest.raises(DefrayError) as caught:
        scene(text)
    assert message in str(caught.value) and "\n" not in str(caught.value)
