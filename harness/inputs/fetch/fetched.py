"""`defray scenes fetch`: a real scene from its author's archive, verified, converted and kept in the cache.

`CACHE/scenes/NAME.npz` holds `vertices` float32[v,3] and `faces` int32[t,3], geometry alone. Faces are numbered as
the archive's file lists them, file after file, instances flattened where they stand (`pbrt.py` beside this); polygons
become triangles in place. `CACHE/scenes/lock.json` pins what was fetched: the SHA-256 of the archive (for loose
files, of the list of their hashes) and of the npz file, which is verified each time the scene is loaded.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout

from harness.data import Strict
from harness.errors import DefrayError
from harness.files import cache_folder, now_utc
from harness.inputs.fetch.archives import Archive, archives, extract
from harness.inputs.fetch.download import FULL, Progress, download, hash_of
from harness.inputs.fetch.pbrt import read_pbrt
from harness.inputs.meshes import corners, mesh_parts
from scenes import Recipe

FIRST_FETCH = "no SHA-256 of it was published: pinned what came, for every later fetch, in"


class Pin(Strict):
    """One entry of lock.json; `sha256` is the archive's, `npz_sha256` the converted file's."""

    url: str
    sha256: str
    npz_sha256: str
    triangles: int
    up: str
    licence: str
    fetched_utc: str


@dataclass(frozen=True)
class Ask:
    """How fetching talks: `say` a line, `confirm` a question, and `progress` of a download."""

    say: Callable[[str], None]
    confirm: Callable[[str], bool]
    progress: Progress | None = None


def scenes_folder() -> Path:
    """Where fetched scenes lie; it need not exist."""
    return cache_folder() / "scenes"


def fetched_file(name: str) -> tuple[Path, Pin] | None:
    """The converted file of a fetched scene and its pin, or None; its hash is not yet verified."""
    path, pin = scenes_folder() / f"{name}.npz", _pins().get(name)
    return (path, pin) if pin and path.is_file() else None


def fetch(recipe: Recipe, ask: Ask, archive: Archive | None = None) -> Pin:
    """Fetch one scene, unless it is there; returns its pin.

    Raises DefrayError where nothing is known to fetch, the licence is not accepted, the archive is not the expected
    one, is damaged or unsafe, the disk is full, or another fetch is at work; Unreachable where there is no network.
    """
    archive = archive or archives().get(recipe.name)
    if archive is None:
        raise DefrayError(f"no archive of scene {recipe.name} is known; known: {', '.join(archives())}")
    have = fetched_file(recipe.name)
    if have and hash_of(have[0]) == have[1].npz_sha256:
        ask.say(f"{recipe.name}: fetched {have[1].fetched_utc[:10]}, {have[1].triangles:,} triangles, in {have[0]}")
        return have[1]
    ask.say(f"{recipe.title}, from {archive.url}" + (f", {archive.size / 1e6:,.0f} MB" if archive.size else ""))
    ask.say(f"licence: {archive.licence}")
    if not ask.confirm("fetch it under this licence?"):
        raise DefrayError(f"scene {recipe.name} was not fetched: its licence was not accepted")
    folder = scenes_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder / ".lock", timeout=0):
            return _fetch(recipe, archive, folder, ask)
    except Timeout:
        raise DefrayError("another fetch is at work; wait for it") from None
    except OSError as error:
        full = "the disk is full" if error.errno in FULL else error.strerror
        raise DefrayError(f"cannot fetch {recipe.name} into {folder}: {full}") from None


def _fetch(recipe: Recipe, archive: Archive, folder: Path, ask: Ask) -> Pin:
    """Download, convert, pin; what was downloaded goes once the converted file is there."""
    work = folder / f"{recipe.name}.download"
    work.mkdir(exist_ok=True)
    before = _pins().get(recipe.name)
    expected = archive.sha256 or (before.sha256 if before and before.url == archive.url else None)
    parts, found = (_loose if archive.entry else _packed)(archive, work, expected, ask)
    if archive.entry and expected and found != expected:
        shutil.rmtree(work)
        raise DefrayError(f"{archive.url} is not what was pinned: SHA-256 {found}, expected {expected}")
    path = folder / f"{recipe.name}.npz"
    triangles = _convert(parts, path)
    pin = Pin(
        url=archive.url,
        sha256=found,
        npz_sha256=hash_of(path),
        triangles=triangles,
        up=archive.up,
        licence=archive.licence,
        fetched_utc=now_utc(),
    )
    _write_pins(_pins() | {recipe.name: pin})
    shutil.rmtree(work)
    if not expected:
        ask.say(f"{FIRST_FETCH} {folder / 'lock.json'}: {found}")
    ask.say(f"{recipe.name}: {triangles:,} triangles{compared(triangles, archive, recipe)}; in {path}")
    return pin


def compared(triangles: int, archive: Archive, recipe: Recipe) -> str:
    """How a fetched scene's size compares with what the archive should hold, and with the recipe's scene."""
    text = ""
    if archive.triangles and archive.triangles != triangles:
        text += f", not the {archive.triangles:,} this archive is known to hold"
    if recipe.triangles == triangles:
        return text + ", as in the recipe"
    more = "more" if triangles > recipe.triangles else "fewer"
    change = triangles / recipe.triangles - 1
    return text + (
        f", {abs(triangles - recipe.triangles):,} {more} than the recipe's {recipe.triangles:,} "
        f"({change:+.1%}): another copy of the scene"
    )


def _packed(archive: Archive, work: Path, expected: str | None, ask: Ask) -> tuple[list, str]:
    """Meshes of a zip or tar archive's members, and the archive's SHA-256."""
    file = work / Path(archive.url).name
    if not (expected and file.is_file() and hash_of(file) == expected):
        found = download(archive.url, file, archive.size, expected, ask.progress)
    else:
        found = expected
    ask.say("downloaded and verified; converting" if expected else "downloaded; converting")
    members = extract(file, archive.files, work)
    return [part for member in members for part in mesh_parts(member)], found


def _loose(archive: Archive, work: Path, expected: str | None, ask: Ask) -> tuple[list, str]:
    """Meshes of a pbrt scene whose files are fetched one by one, and the SHA-256 of the list of their hashes."""
    hashes: dict[str, str] = {}

    def open_file(name: str) -> Path:
        path = work / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if name not in hashes:
            # A whole file of an earlier, interrupted fetch is kept: the list of hashes covers it as well.
            hashes[name] = hash_of(path) if path.is_file() else download(archive.url + name, path)
            if ask.progress:
                ask.progress(len(hashes), None)
        return path

    scene = read_pbrt(archive.entry, open_file)
    for kind, count in sorted(scene.skipped.items()):
        ask.say(f"left out: {count} shapes of kind {kind}")
    listed = "".join(f"{name} {hashes[name]}\n" for name in sorted(hashes))
    return scene.parts, hashlib.sha256(listed.encode()).hexdigest()


def _convert(parts: list, path: Path) -> int:
    """Write the joined meshes as npz, whole or not at all; returns the number of triangles."""
    if not parts:
        raise DefrayError(f"{path.stem}: the archive holds no triangle")
    lengths = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    vertices = np.concatenate([np.asarray(vertices, np.float64) for vertices, _ in parts]).astype(np.float32)
    faces = np.concatenate([np.asarray(faces) + start for (_, faces), start in zip(parts, lengths)])
    corners(path, vertices, faces)  # for its checks alone
    part = path.with_name(f"{path.name}.part")
    try:
        with part.open("wb") as out:
            np.savez(out, vertices=vertices, faces=faces.astype(np.int32))
        part.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise
    return len(faces)


def _pins() -> dict[str, Pin]:
    path = scenes_folder() / "lock.json"
    try:
        return {name: Pin.model_validate(pin) for name, pin in json.loads(path.read_text()).items()}
    except OSError:  # a cache that is not there or cannot be read holds nothing
        return {}
    except (ValueError, AttributeError):  # pydantic's errors are ValueErrors
        raise DefrayError(f"{path} is damaged; remove it, and fetch again") from None


def _write_pins(pins: dict[str, Pin]) -> None:
    path = scenes_folder() / "lock.json"
    part = path.with_name("lock.json.part")
    part.write_text(json.dumps({name: pins[name].model_dump() for name in sorted(pins)}, indent=2) + "\n")
    os.replace(part, path)
