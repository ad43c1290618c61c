"""Fetching real scenes, against a server on the loopback address that misbehaves in every way."""

from __future__ import annotations

import errno
import hashlib
import io
import shutil
import socket
import tarfile
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from loopback import Server
from made_up_archives import OBJ, tarred, zipped

import scenes
from harness.commands import fetch as fetch_command
from harness.commands.fetch import run_fetch
from harness.data import View
from harness.errors import DefrayError
from harness.inputs import scenes_by_name as scene_module
from harness.inputs.fetch import download as download_module
from harness.inputs.fetch import fetched as fetch_module
from harness.inputs.fetch.archives import Archive
from harness.inputs.fetch.download import Unreachable
from harness.inputs.fetch.fetched import Ask, fetch
from harness.inputs.scenes_by_name import list_scenes, load_scene

TRIANGLES = [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[1, 1, 0], [0, 1, 0], [0, 0, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]


@pytest.fixture
def server():
    server = Server()
    yield server
    server.http.shutdown()
    server.http.server_close()


@pytest.fixture
def place(monkeypatch, tmp_path, server):
    """Fetch `small` from the server into tmp_path/cache: `place(body, key=value)`; what was said is `place.said`."""
    recipe = scenes.Recipe("small", "Small", 3, (), (View((0, 0, 5), (0, 0, 0)),), stand_in=lambda seed: None)
    monkeypatch.setattr(scene_module, "recipes", lambda: {"small": recipe})
    monkeypatch.setattr(fetch_command, "recipes", lambda: {"small": recipe})
    monkeypatch.setattr(scenes, "recipes", lambda: {"small": recipe})
    monkeypatch.setenv("DEFRAY_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("DEFRAY_SCENES", raising=False)

    class Place:
        folder, said, asked, recipe = tmp_path / "cache" / "scenes", [], [], None
        accept = True

        def archive(self, body: bytes, name: str = "small.zip", **change) -> Archive:
            server.files[f"/{name}"] = body
            known = {"size": len(body), "sha256": hashlib.sha256(body).hexdigest(), "files": ("small.obj",)}
            return Archive(**({"url": server.url + name, "licence": "CC BY 4.0, Ann Author"} | known | change))

        def __call__(self, archive: Archive):
            def confirm(question: str) -> bool:
                self.asked.append(question)
                return self.accept

            return fetch(recipe, Ask(self.said.append, confirm), archive)

        def refused(self, archive: Archive, kind: type = DefrayError) -> str:
            with pytest.raises(kind) as caught:
                self(archive)
            assert "\n" not in str(caught.value)
            assert not (self.folder / "small.npz").exists() and not (self.folder / "lock.json").exists()
            return str(caught.value)

    return Place()


WHOLE = zipped({"readme.txt": b"hello", "small/small.obj": OBJ})
LARGE = zipped({"small.obj": OBJ + b"# " + np.random.default_rng(0).bytes(300_000).hex().encode()})


def test_a_fetched_scene_is_loaded_in_place_of_the_stand_in(place):
    pin = place(place.archive(WHOLE))
    scene = load_scene("small")
    assert scene.source == "real" and scene.licence == "CC BY 4.0, Ann Author"
    assert scene.triangles.tolist() == TRIANGLES
    assert scene.views[0].eye == (0, 0, 5)
    with np.load(place.folder / "small.npz") as arrays:
        assert arrays["vertices"].dtype == np.float32 and arrays["faces"].dtype == np.int32
    assert pin.triangles == 3
    assert sorted(path.name for path in place.folder.iterdir()) == [".lock", "lock.json", "small.npz"]
    (status,) = list_scenes()
    assert status.source == "real" and status.origin.startswith("fetched from http://127.0.0.1")


def test_the_licence_is_shown_before_anything_is_fetched(place, server):
    place.accept = False
    assert "licence was not accepted" in place.refused(place.archive(WHOLE))
    assert place.said[-1] == "licence: CC BY 4.0, Ann Author" and len(place.asked) == 1 and not server.asked


def test_what_is_there_is_not_fetched_again(place, server):
    archive = place.archive(WHOLE)
    place(archive)
    asked = len(server.asked)
    place(archive)
    assert len(server.asked) == asked and len(place.asked) == 1


def test_the_folder_of_real_scenes_comes_before_what_was_fetched(place, monkeypatch, tmp_path):
    place(place.archive(WHOLE))
    monkeypatch.setenv("DEFRAY_SCENES", str(tmp_path))
    assert load_scene("small").source == "real"  # the folder has no file of this scene
    monkeypatch.setenv("DEFRAY_SCENES", "/nowhere")
    recipe = scenes.Recipe("small", "Small", 3, (("small.npz", "0" * 64),))
    monkeypatch.setattr(scene_module, "recipes", lambda: {"small": recipe})
    with pytest.raises(DefrayError, match="is not a folder"):
        load_scene("small")


def test_a_difference_in_size_is_said(place):
    place(place.archive(zipped({"small.obj": OBJ + b"f 1 2 4\n"}), triangles=5))
    assert "4 triangles, not the 5 this archive is known to hold, " in place.said[-1]
    assert "1 more than the recipe's 3 (+33.3%): another copy of the scene" in place.said[-1]


def test_several_files_are_joined_in_the_order_given(place):
    other = b"v 5 5 5\nv 6 5 5\nv 5 6 5\nf 1 2 3\n"
    place(place.archive(zipped({"b.obj": other, "a.obj": OBJ}), files=("a.obj", "b.obj")))
    assert load_scene("small").triangles.tolist() == [*TRIANGLES, [[5, 5, 5], [6, 5, 5], [5, 6, 5]]]


def test_a_tar_archive_is_read(place):
    place(place.archive(tarred((tarfile.TarInfo("x/small.obj"), OBJ)), "small.tar.gz"))
    assert load_scene("small").triangles.tolist() == TRIANGLES


def test_without_a_published_hash_the_first_fetch_pins_it(place):
    archive = place.archive(WHOLE, sha256=None, size=None)
    pin = place(archive)
    assert pin.sha256 == hashlib.sha256(WHOLE).hexdigest()
    assert any(line.startswith("no SHA-256 of it was published") and pin.sha256 in line for line in place.said)
    (place.folder / "small.npz").unlink()
    place.archive(zipped({"small.obj": OBJ + b"f 1 2 4\n"}), sha256=None)
    with pytest.raises(DefrayError, match=f"is not the expected archive: SHA-256 .*, expected {pin.sha256}"):
        place(archive)


def test_a_damaged_scene_is_refused_and_fetched_again(place):
    archive = place.archive(WHOLE)
    place(archive)
    file = place.folder / "small.npz"
    whole = file.read_bytes()
    file.write_bytes(whole[:-9] + b"123456789")
    with pytest.raises(DefrayError, match=r"is damaged: SHA-256 .* repair it with: defray scenes fetch small"):
        load_scene("small")
    place(archive)
    assert file.read_bytes() == whole


def test_a_damaged_lock_file_is_one_line(place):
    place(place.archive(WHOLE))
    (place.folder / "lock.json").write_text("{")
    with pytest.raises(DefrayError, match=r"lock\.json is damaged"):
        load_scene("small")


def test_a_connection_that_breaks_is_taken_up_where_it_ended(place, server):
    server.cut = 100_000
    archive = place.archive(LARGE)
    place(archive)
    ranges = [start for _, start in server.asked]
    assert ranges[:3] == [None, "bytes=100000-", "bytes=200000-"]
    assert load_scene("small").triangles.tolist() == TRIANGLES


def test_a_truncated_download_is_refused_and_the_next_call_goes_on(place, server):
    server.cut = 10_000
    archive = place.archive(LARGE)
    message = place.refused(archive)
    assert f"ended after 40,000 of {len(LARGE):,} bytes; the same command goes on from there" in message
    server.cut = None
    place(archive)
    assert server.asked[-1] == ("/small.zip", "bytes=40000-")


def test_a_file_of_unknown_length_that_ends_early_is_not_taken_for_whole(place, server):
    server.chunked = True
    message = place.refused(place.archive(LARGE, size=None, sha256=None))
    assert "the connection broke after" in message


def test_a_server_without_ranges_starts_anew(place, server):
    archive = place.archive(LARGE)
    (place.folder / "small.download").mkdir(parents=True)
    (place.folder / "small.download" / "small.zip.part").write_bytes(LARGE[:5000])
    server.ranges = False
    place(archive)
    assert load_scene("small").triangles.tolist() == TRIANGLES


def test_a_part_of_something_else_is_found_out(place, server):
    archive = place.archive(LARGE)
    (place.folder / "small.download").mkdir(parents=True)
    (place.folder / "small.download" / "small.zip.part").write_bytes(b"x" * 5000)
    assert "is not the expected archive" in place.refused(archive)
    place(archive)  # the part is gone
    assert server.asked[-1] == ("/small.zip", None)


def test_a_wrong_hash_is_refused_and_nothing_is_kept(place):
    message = place.refused(place.archive(WHOLE, sha256="0" * 64))
    assert "is not the expected archive: SHA-256" in message and "expected 0000" in message
    assert not list((place.folder / "small.download").iterdir())


def test_a_corrupted_archive_is_refused_by_its_hash(place, server):
    archive = place.archive(WHOLE)
    server.files["/small.zip"] = WHOLE[:50] + bytes([WHOLE[50] ^ 1]) + WHOLE[51:]
    assert "is not the expected archive" in place.refused(archive)


def test_another_size_is_refused_before_it_is_fetched(place, server):
    assert f"has {len(WHOLE):,} bytes, expected 7" in place.refused(place.archive(WHOLE, size=7))


def test_a_missing_file_is_one_line(place, server):
    archive = place.archive(WHOLE)
    server.files.clear()
    assert place.refused(archive) == f"{server.url}small.zip: HTTP 404 Not Found"


def test_a_refused_connection_is_one_line(place):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    archive = place.archive(WHOLE, url=f"http://127.0.0.1:{port}/small.zip")
    assert place.refused(archive, Unreachable) == f"no connection to 127.0.0.1:{port}: Connection refused"


def test_no_network_is_one_line_that_names_the_stand_ins(place, monkeypatch):
    def refuse(*_, **__):
        raise OSError(errno.ENETUNREACH, "Network is unreachable")

    monkeypatch.setattr(download_module.urllib.request, "urlopen", refuse)
    for module in (fetch_module, fetch_command):
        monkeypatch.setattr(module, "archives", lambda: {"small": place.archive(WHOLE)})
    with pytest.raises(DefrayError, match="Network is unreachable; without it the stand-ins will be used"):
        run_fetch("all", yes=True)


def test_too_little_room_is_said_before_the_download(place, server, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(total=10, used=5, free=5))
    message = place.refused(place.archive(WHOLE))
    assert "small.zip needs 0 MB in" in message and "0 MB are free" in message and not server.asked


class FullDisk(io.FileIO):
    """A file that takes 1000 bytes and no more."""

    def write(self, data):
        if self.tell() + len(data) > 1000:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)


def test_a_disk_that_fills_up_during_the_download_is_one_line(place, monkeypatch):
    path_open = download_module.Path.open

    def full(self, mode="r", *rest, **named):
        return path_open(self, mode, *rest, **named) if "r" in mode else FullDisk(self, mode)

    monkeypatch.setattr(download_module.Path, "open", full)
    assert "is full; make room, and the same command goes on" in place.refused(place.archive(LARGE))


def test_a_disk_that_fills_up_during_the_conversion_is_one_line(place, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(fetch_module.np, "savez", full)
    assert place.refused(place.archive(WHOLE)).endswith(": the disk is full")
    assert not list(place.folder.glob("*.npz*"))


@pytest.mark.parametrize("name", ["../evil.obj", "/etc/evil.obj", "a/../../evil.obj", "..\\evil.obj", "C:/evil.obj"])
def test_a_name_that_leads_out_of_the_folder_is_refused(place, name):
    assert "leads out of its folder: refused" in place.refused(place.archive(zipped({name: OBJ, "small.obj": OBJ})))
    assert not list(place.folder.parent.rglob("evil.obj"))


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b"not an archive at all", "is damaged: File is not a zip file"),
        (zipped({"other.obj": OBJ}), "holds no small.obj"),
        (zipped({"a/small.obj": OBJ, "b/small.obj": OBJ}), "holds 2 files named small.obj"),
        (zipped({"small.obj": b"nothing"}), "holds no triangle"),
        (zipped({"small.obj": b"v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n"}), "vertex 1 is not finite"),
        (WHOLE.replace(zipped({"x": OBJ})[31:60], b"\xff" * 29), "is damaged"),
    ],
)
def test_a_faulty_archive_is_refused(place, body, message):
    assert message in place.refused(place.archive(body))


PLY = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]], process=False).export(file_type="ply")


@pytest.fixture
def pbrt(place, server):
    """A pbrt scene of three files."""
    server.files["/p/main.pbrt"] = b'WorldBegin Include "geometry/a.pbrt" Shape "sphere" "float radius" 3'
    server.files["/p/geometry/a.pbrt"] = b'Shape "plymesh" "string filename" "geometry/a.ply"\n' * 3
    server.files["/p/geometry/a.ply"] = PLY
    return Archive(url=f"{server.url}p/", entry="main.pbrt", licence="ask the author")


def test_each_loose_file_is_fetched_once_and_the_list_of_hashes_is_pinned(place, pbrt, server):
    pin = place(pbrt)
    assert load_scene("small").triangles.tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]]] * 3
    assert sorted(path for path, _ in server.asked) == ["/p/geometry/a.pbrt", "/p/geometry/a.ply", "/p/main.pbrt"]
    assert "left out: 1 shapes of kind sphere" in place.said
    (place.folder / "small.npz").unlink()
    assert place(pbrt).sha256 == pin.sha256
    (place.folder / "small.npz").unlink()
    server.files["/p/geometry/a.pbrt"] += b"\n"
    with pytest.raises(DefrayError, match="is not what was pinned"):
        place(pbrt)


def test_a_scene_file_cannot_reach_out_of_its_folder(place, pbrt, server):
    server.files["/p/main.pbrt"] = b'Include "../../secret.pbrt"'
    assert "names '../../secret.pbrt', which leads out of its folder" in place.refused(pbrt)
    assert [path for path, _ in server.asked] == ["/p/main.pbrt"]


def test_a_loose_file_that_is_not_there_is_one_line(place, pbrt, server):
    del server.files["/p/geometry/a.ply"]
    assert place.refused(pbrt).endswith("a.ply: HTTP 404 Not Found")


def test_all_goes_on_after_a_failure_and_says_so_in_its_exit_code(place, server, monkeypatch, capsys):
    for module in (fetch_module, fetch_command):
        monkeypatch.setattr(module, "archives", lambda: {"small": place.archive(WHOLE), "other": broken})
    broken = place.archive(b"", "gone.zip", size=None)
    del server.files["/gone.zip"]
    recipe = scenes.Recipe("other", "Other", 3)
    both = {"other": recipe, **scenes.recipes()}
    monkeypatch.setattr(fetch_command, "recipes", lambda: both)
    assert run_fetch("all", yes=True) == 1
    said = capsys.readouterr().err
    assert "error: other: " in said and "HTTP 404" in said and "small: 3 triangles, as in the recipe" in said


def test_without_a_terminal_the_licence_needs_yes(place, monkeypatch):
    for module in (fetch_module, fetch_command):
        monkeypatch.setattr(module, "archives", lambda: {"small": place.archive(WHOLE)})
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    with pytest.raises(DefrayError, match="pass --yes"):
        run_fetch("small", yes=False)
    with pytest.raises(DefrayError, match="unknown scene 'smal'; known: all, small"):
        run_fetch("smal", yes=True)
