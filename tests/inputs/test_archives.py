"""Archives: the committed list, and members taken out of hostile ones."""

from __future__ import annotations

import io
import re
import tarfile
import zipfile

import pytest
from made_up_archives import OBJ, tarred, zipped

import scenes
from harness.errors import DefrayError
from harness.inputs.fetch.archives import Archive, archives, extract


def refused(tmp_path, body: bytes, wanted=("small.obj",)) -> str:
    """The message with which an archive of these bytes is refused; nothing of it may be on disk."""
    (tmp_path / "in").mkdir(exist_ok=True)
    (tmp_path / "out").mkdir(exist_ok=True)
    (tmp_path / "in" / "small.zip").write_bytes(body)
    with pytest.raises(DefrayError) as caught:
        extract(tmp_path / "in" / "small.zip", wanted, tmp_path / "out")
    assert not list((tmp_path / "out").iterdir()) and "\n" not in str(caught.value)
    return str(caught.value)


def test_every_paper_scene_has_an_archive_with_a_licence():
    papers = {name for name, recipe in scenes.recipes().items() if recipe.paper}
    assert papers == set(archives())
    for archive in archives().values():
        assert archive.url.startswith("https://") and len(archive.licence) > 10
        assert archive.sha256 or re.search(r"/[0-9a-f]{40}/", archive.url)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"files": ()}, "either files or entry"), ({"entry": "a.pbrt"}, "either files or entry"),
     ({"files": (), "entry": "a.pbrt"}, "must end in /"), ({"sha256": "abc"}, "pattern"),
     ({"url": "file:///etc/passwd"}, "pattern"), ({"colour": 1}, "Extra inputs")],
)  # fmt: skip
def test_a_faulty_entry_of_the_list_is_an_error(change, message):
    with pytest.raises(ValueError, match=message):
        Archive(**({"url": "https://example.org/a.zip", "licence": "none", "files": ("a.obj",)} | change))


def test_members_come_in_the_order_wanted_whatever_their_folder(tmp_path):
    (tmp_path / "a.zip").write_bytes(zipped({"x/one.obj": b"1", "two.obj": b"2", "three.obj": b"3"}))
    found = extract(tmp_path / "a.zip", ("two.obj", "one.obj"), tmp_path)
    assert [path.read_bytes() for path in found] == [b"2", b"1"] and not (tmp_path / "three.obj").exists()


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE, tarfile.FIFOTYPE])
def test_links_and_devices_in_a_tar_archive_are_refused(tmp_path, kind):
    entry = tarfile.TarInfo("small.obj")
    entry.type, entry.linkname = kind, "/etc/passwd"
    assert "small.obj is a link or no file: refused" in refused(tmp_path, tarred((entry, b"")))


def test_links_in_a_zip_archive_are_refused(tmp_path):
    link = zipfile.ZipInfo("small.obj")
    link.external_attr = 0o120777 << 16
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr(link, "/etc/passwd")
    assert "small.obj is a link or no file: refused" in refused(tmp_path, data.getvalue())


@pytest.mark.parametrize("name", ["../evil.obj", "/etc/evil.obj", "a/../../evil.obj", "..\\evil.obj"])
def test_a_tar_name_that_leads_out_of_the_folder_is_refused(tmp_path, name):
    body = tarred((tarfile.TarInfo(name), OBJ), (tarfile.TarInfo("small.obj"), OBJ))
    assert "leads out of its folder: refused" in refused(tmp_path, body)


def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path):
    bomb = tmp_path / "bomb.zip"
    bomb.write_bytes(zipped({"small.obj": b"\0" * 100_000}))
    with pytest.raises(DefrayError, match="unpacks to more than"):
        extract(bomb, ("small.obj",), tmp_path, largest=50_000)
    lying = bomb.read_bytes().replace((100_000).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    bomb.write_bytes(lying)
    with pytest.raises(DefrayError):
        extract(bomb, ("small.obj",), tmp_path, largest=50_000)
    assert sum(file.stat().st_size for file in tmp_path.glob("0-*")) <= 50_000
