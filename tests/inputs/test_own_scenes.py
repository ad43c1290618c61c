"""Own meshes: what a TOML file beside them may say, views found without it, and every kind of file."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
import trimesh
from rich.console import Console
from shapes import icosphere

from harness import trace
from harness.commands.console import record_table
from harness.data import Rays
from harness.device.machine import machine_description
from harness.errors import DefrayError
from harness.inputs.rays import image_rays
from harness.inputs.scenes_by_name import load_scene
from harness.inputs.viewpoints import find_views
from harness.measure.pipeline import run_group
from harness.measure.scene import Scenes
from harness.records.origin import finish
from harness.records.run_row import Record
from harness.reference.embree_scene import EmbreeScene
from harness.reference.exact import zero_area
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import Uniform
from scenes.shapes import box, sphere, tubes

OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0.5 1\nf 1 2 3 4\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"
VIEW = '[[views]]\nname = "front"\neye = [0, 0, 5]\ntarget = [0, 0, 0]\n'
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]])
TRIANGLES = POINTS[FACES].astype(np.float32)


@pytest.fixture
def pyramid(tmp_path):
    """A mesh file; `pyramid(toml)` puts that text beside it and loads."""
    file = tmp_path / "pyramid.obj"
    file.write_text(OBJ)

    def load(toml: str | None = None):
        if toml is not None:
            file.with_suffix(".toml").write_text(toml)
        return load_scene(str(file))

    return load


def load_text(path, text: str) -> np.ndarray:
    """Triangles of a file with this content."""
    path.write_text(text)
    return load_scene(str(path)).triangles


def test_a_toml_file_gives_views_scale_up_axis_and_licence(pyramid):
    scene = pyramid(f'up = "x"\nscale = 0.5\nlicence = "CC BY 4.0"\n{VIEW}fov_degrees = 30\n')
    (view,) = scene.views
    assert scene.licence == "CC BY 4.0" and scene.views_from == "given in pyramid.toml"
    assert scene.triangles.max() == 0.5
    assert (view.name, view.eye, view.target, view.fov_degrees) == ("front", (0, 0, 2.5), (0, 0, 0), 30)


def test_the_up_axis_turns_the_views_and_not_the_geometry(pyramid):
    plain, turned = pyramid(), pyramid('up = "-z"\n')
    assert np.array_equal(plain.triangles, turned.triangles)
    assert {view.up for view in plain.views} == {(0, 1, 0)}
    assert {view.up for view in turned.views} == {(0, 0, -1)}


def test_views_without_a_name_are_numbered_and_may_have_their_own_up(pyramid):
    scene = pyramid("[[views]]\neye = [0, 5, 0]\ntarget = [0, 0, 0]\nup = [0, 0, 1]\n" + VIEW)
    assert [(view.name, view.up) for view in scene.views] == [("view 1", (0, 0, 1)), ("front", (0, 1, 0))]


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ("scale = 0", "scale: input should be greater than 0"),
        ("scale = nan", "scale: "),
        ("scale = 1e30", "reach 1e+30; scale it"),
        ("scale = 1e-30", "large; scale it up"),
        ('up = "upwards"', "up: input should be 'x', 'y'"),
        ("colour = 3", "colour: unknown key"),
        ("[[views]]\neye = [0, 0, 1]", "views.0.target: missing key"),
        ("[[views]]\neye = [0, 0]\ntarget = [0, 0, 0]", "views.0.eye.2: missing key"),
        ("[[views]]\neye = [0, inf, 0]\ntarget = [0, 0, 0]", "views.0.eye.1: input should be a finite number"),
        ("[[views]]\neye = [1, 1, 1]\ntarget = [1, 1, 1]", "eye and target are the same point"),
        ("[[views]]\neye = [0, 5, 0]\ntarget = [0, 0, 0]", "'view 1' looks along its up axis"),
        (VIEW + "up = [0, 0, 0]", "points nowhere"),
        (VIEW + "fov_degrees = 180", "views.0.fov_degrees: input should be less than 180"),
        (VIEW + VIEW, "two views are named 'front'"),
        ("views = 3", "views: "),
        ("up = ", "not TOML"),
    ],
)
def test_a_faulty_toml_file_is_refused_in_one_line(pyramid, toml, message):
    with pytest.raises(DefrayError) as caught:
        pyramid(toml)
    assert message in str(caught.value) and "\n" not in str(caught.value) and "pyramid" in str(caught.value)


def room() -> np.ndarray:
    """A box seen from inside, with two boxes of furniture."""
    walls = box((-5, 0, -8), (5, 3, 8))[:, ::-1]
    return np.concatenate([walls, box((1, 0, 1), (2, 1, 3)), box((-3, 0, -6), (-2, 2, -4))]).astype(np.float32)


def test_a_room_is_seen_from_inside_and_an_object_from_outside():
    inside = find_views(room())
    assert inside.room and inside.views[0].name == "inside" and inside.reason.startswith("inside, a room: ")
    eye = np.array(inside.views[0].eye)
    assert (np.abs(eye) < [5, 3, 8]).all() and eye[1] > 0
    for solid in (icosphere(3), box((0, 0, 0), (1, 2, 3)).astype(np.float32)):
        outside = find_views(solid)
        assert not outside.room and outside.views[0].name == "outside"
        assert outside.reason.startswith("outside, an object: 0% of ")


def test_a_ball_of_hair_is_an_object_though_its_middle_is_enclosed():
    random = np.random.default_rng(3)
    ends = random.normal(size=(2, 3000, 3))
    ends /= np.linalg.norm(ends, axis=2, keepdims=True)
    paths = np.stack([ends[0], ends[1]], axis=1)
    hair = np.concatenate([tubes(path, 0.02, 3) for path in paths]).astype(np.float32)
    assert not find_views(hair).room


@pytest.mark.parametrize("up", ["x", "y", "z", "-y"])
def test_found_views_show_something_whatever_the_up_axis(up):
    turn = {"x": [1, 0, 2], "y": [0, 1, 2], "z": [0, 2, 1], "-y": [0, 1, 2]}[up]
    for mesh in (room(), sphere(2.0, 12, 24)):
        triangles = np.ascontiguousarray(mesh[:, :, turn], np.float32)
        triangles = triangles[:, ::-1] if turn != [0, 1, 2] else triangles  # a swap of axes mirrors
        found = find_views(np.ascontiguousarray(triangles), up)
        seen = EmbreeScene(triangles).trace(image_rays(found.views[0], 32, 32)).primitive
        assert (seen >= 0).mean() > (0.95 if found.room else 0.15)


def test_the_same_mesh_always_gets_the_same_views():
    assert find_views(room()) == find_views(room())


def test_a_scene_of_one_point_still_loads(tmp_path):
    np.savez(tmp_path / "point.npz", vertices=np.zeros((3, 3), np.float32), faces=[[0, 1, 2]])
    assert "single point" in load_scene(str(tmp_path / "point.npz")).views_from


def test_trace_says_which_view_was_chosen_and_why(tmp_path, device):
    np.savez(tmp_path / "room.npz", vertices=room().reshape(-1, 3), faces=np.arange(len(room()) * 3).reshape(-1, 3))
    variant = Variant(tracer="forward", intersector="ray-space")
    file = str(tmp_path / "room.npz")
    spec = RunSpec(scene=file, variant=variant, structure=Uniform(2, 8), rays=100, repetitions=1)
    (_, body), *_ = run_group([spec], Scenes(device))
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(record_table(finish(Record, body, machine_description(device), id=spec.id)))
    assert "inside (inside, a room: " in console.export_text()


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb", "gltf", "3mf", "dae"])
def test_every_format_that_can_be_written_gives_its_triangles_in_order(tmp_path, suffix):
    if suffix == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.Trimesh(POINTS, FACES))).items():
            (tmp_path / name.replace("model", "mesh")).write_bytes(data)
    else:
        trimesh.Trimesh(POINTS, FACES, process=False).export(tmp_path / f"mesh.{suffix}")
    assert np.array_equal(load_scene(str(tmp_path / f"mesh.{suffix}")).triangles, TRIANGLES)


def test_an_archive_of_a_mesh_is_read(tmp_path):
    with zipfile.ZipFile(tmp_path / "mesh.zip", "w") as archive:
        archive.writestr("mesh.off", trimesh.Trimesh(POINTS, FACES, process=False).export(file_type="off"))
    assert np.array_equal(load_scene(str(tmp_path / "mesh.zip")).triangles, TRIANGLES)


def test_xaml_is_read(tmp_path):
    text = (
        '<ModelVisual3D xmlns="http://schemas.microsoft.com/winfx/2006/xaml/presentation"><ModelVisual3D.Content>'
        '<GeometryModel3D><GeometryModel3D.Geometry><MeshGeometry3D Positions="0 0 0 1 0 0 0 1 0" '
        'Normals="0 0 1 0 0 1 0 0 1" TriangleIndices="0 1 2"/></GeometryModel3D.Geometry></GeometryModel3D>'
        "</ModelVisual3D.Content></ModelVisual3D>"
    )
    assert load_text(tmp_path / "mesh.xaml", text).tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]


@pytest.mark.parametrize(("suffix", "package"), [("step", "cascadio"), ("ctm", "OpenCTM")])
def test_a_format_that_needs_more_software_names_it(tmp_path, suffix, package):
    (tmp_path / f"part.{suffix}").write_bytes(b"anything")
    with pytest.raises(DefrayError, match=f"files need .*{package}"):
        load_scene(str(tmp_path / f"part.{suffix}"))


def test_a_nested_graph_is_flattened_with_its_transforms_and_mirrors(tmp_path):
    graph, mesh = trimesh.Scene(), trimesh.Trimesh(POINTS, FACES, process=False)
    shift, mirror = trimesh.transformations.translation_matrix([10, 0, 0]), np.diag([1.0, 1, -1, 1])
    graph.add_geometry(mesh, node_name="a", geom_name="mesh", transform=shift)
    graph.graph.update(frame_from="a", frame_to="b", matrix=mirror, geometry="mesh")
    graph.export(tmp_path / "graph.glb")
    triangles = load_scene(str(tmp_path / "graph.glb")).triangles
    assert len(triangles) == 6
    assert {tuple(p) for p in triangles[:3].reshape(-1, 3)} == {tuple(p) for p in POINTS + [10, 0, 0]}
    assert {tuple(p) for p in triangles[3:].reshape(-1, 3)} == {tuple(p) for p in (POINTS + [10, 0, 0]) * [1, 1, -1]}


def test_many_meshes_in_one_file_are_joined_each_in_its_order(tmp_path):
    graph = trimesh.Scene()
    for number in range(5):
        graph.add_geometry(trimesh.Trimesh(POINTS + 10 * number, FACES, process=False), geom_name=f"m{number}")
    graph.export(tmp_path / "many.glb")
    triangles = load_scene(str(tmp_path / "many.glb")).triangles
    offsets = [mesh.min() for mesh in triangles.reshape(5, -1)]
    assert sorted(offsets) == [0, 10, 20, 30, 40]
    assert np.array_equal(triangles, np.concatenate([TRIANGLES + np.float32(n) for n in offsets]))
    assert np.array_equal(triangles, load_scene(str(tmp_path / "many.glb")).triangles)


def test_solids_of_one_stl_file_are_joined(tmp_path):
    facet = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {1} 0 0\nvertex {0} 1 0\nendloop\nendfacet\n"
    solids = "".join(f"solid s{n}\n{facet.format(n, n + 1)}endsolid s{n}\n" for n in range(3))
    assert load_text(tmp_path / "solids.stl", solids)[:, 0, 0].tolist() == [0, 1, 2]


@pytest.mark.parametrize("suffix", ["obj", "off", "ply"])
def test_polygons_become_triangles_that_cover_them(tmp_path, suffix):
    corners = [(0, 0), (2, 0), (3, 1), (2, 2), (0, 2)]
    listed = "".join(f"{x} {y} 0\n" for x, y in corners)
    text = {
        "obj": "".join(f"v {x} {y} 0\n" for x, y in corners) + "f 1 2 3 4 5\nf 1 2 5\n",
        "off": f"OFF\n5 2 0\n{listed}5 0 1 2 3 4\n3 0 1 4\n",
        "ply": "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face 2\nproperty list uchar int vertex_indices\nend_header\n{listed}5 0 1 2 3 4\n3 0 1 4\n",
    }[suffix]
    triangles = load_text(tmp_path / f"polygon.{suffix}", text).astype(float)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1) / 2
    assert len(triangles) == 4 and area.sum() == pytest.approx(5 + 2)


def test_polygons_and_triangles_of_an_off_file_keep_their_order(tmp_path):
    text = "OFF 4 3 0  # a comment\n\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n4 0 1 2 3  200 0 0\n3 1 2 3\n"
    triangles = load_text(tmp_path / "mixed.off", text)
    assert triangles[:, :, :2].tolist()[3] == [[1, 0], [1, 1], [0, 1]]
    assert triangles[:, :, :2].tolist()[:2] == [[[0, 0], [1, 0], [1, 1]]] * 2


def test_duplicate_and_unreferenced_vertices_change_nothing(tmp_path):
    text = "v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 0\nv 1 0 0\nv 0 0 1\nv 7 7 7\nf 2 3 4\nf 5 6 7\nf 2 3 4\n"
    triangles = load_text(tmp_path / "doubled.obj", text)
    first = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert triangles.tolist() == [first, [[0, 0, 0], [1, 0, 0], [0, 0, 1]], first]


@pytest.mark.parametrize("suffix", ["obj", "off", "ply", "stl", "glb"])
def test_triangles_without_area_keep_their_numbers(tmp_path, suffix):
    faces = np.array([[0, 0, 1], [0, 1, 2], [1, 1, 1], [0, 2, 3]])
    trimesh.Trimesh(POINTS, faces, process=False).export(tmp_path / f"flat.{suffix}")
    triangles = load_scene(str(tmp_path / f"flat.{suffix}")).triangles
    assert np.array_equal(triangles, POINTS[faces].astype(np.float32))
    assert zero_area(triangles).tolist() == [True, False, True, False]


@pytest.mark.parametrize("tracer", ["deferred", "forward", "brute", "embree"])
def test_triangles_without_area_are_never_hit(tmp_path, device, tracer):
    # A sliver lies right on the way of every ray, before a wall; a point lies in the wall.
    vertices = np.array([[0, 0, 1], [1, 1, 1], [0.5, 0.5, 1], [-9, -9, 0], [9, -9, 0], [0, 9, 0]], np.float32)
    np.savez(tmp_path / "sliver.npz", vertices=vertices, faces=[[0, 1, 2], [2, 2, 2], [3, 4, 5], [0, 2, 1]])
    scene = load_scene(str(tmp_path / "sliver.npz"))
    along = np.linspace(0, 1, 65, dtype=np.float32)
    origins = np.stack([along, along, np.full(65, 3, np.float32)], axis=1)
    rays = Rays(origins, np.tile(np.float32([0, 0, -1]), (65, 1)), np.full(65, np.inf, np.float32))
    hits = trace(scene, rays, tracer=tracer, structure=Uniform(2, 4), device=device)
    assert (hits.primitive == 2).all() and (hits.t == 3).all()
