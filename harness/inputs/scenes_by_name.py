"""Scenes by name, real or stand-in, and any mesh file."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import zipfile
import zlib
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

import scenes
from harness.data import Scene, View, check_scale
from harness.errors import DefrayError, known
from harness.files import cache_folder
from harness.inputs import sizes
from harness.inputs.fetch.download import hash_of
from harness.inputs.fetch.fetched import Pin, fetched_file
from harness.inputs.mesh_settings import Sidecar, read_sidecar, sidecar_path
from harness.inputs.meshes import MESH_SUFFIXES, corners, read_mesh, read_npz
from harness.inputs.sizes import resized
from harness.inputs.viewpoints import find_views
from harness.spec.run_spec import SIZES, split_size
from scenes import Recipe, recipes

SEED = 1  # of every stand-in


@dataclass(frozen=True)
class SceneStatus:
    """A known scene: `source` is `real`, `stand-in` or `missing`; `origin` says where its geometry comes from."""

    name: str
    triangles: int
    source: str
    origin: str
    licence: str
    paper: bool


def check_name(name_or_path: str) -> None:
    """Raise DefrayError for a scene that is certainly neither known nor a file, or a size of it that is not made."""
    name, size = split_size(name_or_path)
    if name not in recipes() and not _looks_like_a_file(name):
        raise DefrayError(f"{known('scene', name, recipes())}; or name a mesh file")
    if SIZES[size] > 1 and not enlargeable(name):
        raise DefrayError(f"{name_or_path}: only stand-ins are enlarged; smaller sizes are made of any scene")


def enlargeable(name: str) -> bool:
    """Whether a scene is made in more than its own size: stand-ins are, real scenes and mesh files are not."""
    return name in recipes() and _status(recipes()[name]).source == "stand-in"


def expected_triangles(name_or_path: str) -> int | None:
    """About how many triangles a scene has, size suffix included, before it is loaded; None for a file."""
    name, size = split_size(name_or_path)
    return int(_status(recipes()[name]).triangles * SIZES[size]) if name in recipes() else None


def _looks_like_a_file(text: str) -> bool:
    path = Path(text)
    try:
        return path.suffix.lower() in MESH_SUFFIXES or os.sep in text or path.is_file()
    except (OSError, ValueError):  # too long for a path, or not one
        return False


def list_scenes() -> list[SceneStatus]:
    """Every known scene, without loading any geometry."""
    return [_status(recipe) for recipe in recipes().values()]


def is_real(recipe: Recipe) -> bool:
    """Whether the recipe's real geometry is at hand, without loading it."""
    return _status(recipe).source == "real"


def _status(recipe: Recipe) -> SceneStatus:
    triangles, real, fetched = recipe.triangles, _real_files(recipe), fetched_file(recipe.name)
    if real:
        source, origin = "real", ", ".join(str(path) for path in real)
    elif fetched:
        source, origin, triangles = "real", f"fetched from {fetched[1].url}", fetched[1].triangles
    elif recipe.stand_in:
        source, origin = "stand-in", "seeded generator"
    else:
        names = ", ".join(name for name, _ in recipe.files) or "its file"
        source, origin = "missing", f"set DEFRAY_SCENES to a folder with {names}"
    return SceneStatus(recipe.name, triangles, source, origin, recipe.licence, recipe.paper)


def load_scene(name_or_path: str) -> Scene:
    """A known scene by name, or a mesh file by path; `@1/4` and its like after either give it another size.

    Real geometry comes from the folder DEFRAY_SCENES, else from what `defray scenes fetch` brought; without either
    the stand-in is generated. Raises DefrayError for an unknown name, a missing, unreadable or altered file, an empty
    mesh, or a vertex that is not finite.
    """
    check_name(name_or_path)
    name, size = split_size(name_or_path)
    return _whole(name) if SIZES[size] == 1 else _resized(_whole(name), size)


def _whole(name: str) -> Scene:
    """A scene in its full size."""
    if name not in recipes():
        return _from_file(Path(name))
    recipe = recipes()[name]
    real = real_scene(recipe)
    if real:
        return real
    if recipe.stand_in:
        return stand_in_scene(recipe)
    raise DefrayError(f"scene {recipe.name} is missing: {_status(recipe).origin}")


def _real_files(recipe: Recipe) -> list[Path]:
    """The recipe's files under DEFRAY_SCENES, or none if the folder does not hold them all."""
    folder = os.environ.get("DEFRAY_SCENES")
    if not folder or not recipe.files:
        return []
    if not Path(folder).is_dir():
        raise DefrayError(f"DEFRAY_SCENES={folder} is not a folder")
    files = [Path(folder) / name for name, _ in recipe.files]
    return files if all(file.is_file() for file in files) else []


def carried_files(name: str) -> list[Path]:
    """The files under DEFRAY_SCENES of a scene's real geometry; raises DefrayError where it is not there."""
    check_name(name)
    recipe = recipes().get(name)
    files = _real_files(recipe) if recipe else []
    if not files:
        raise DefrayError(f"no real geometry of {name} in the folder DEFRAY_SCENES={os.environ.get('DEFRAY_SCENES')}")
    return files


def real_scene(recipe: Recipe) -> Scene | None:
    """The real geometry from the folder DEFRAY_SCENES, else what was fetched, or None.

    Raises DefrayError for an altered file.
    """
    files = _real_files(recipe)
    if not files:
        fetched = fetched_file(recipe.name)
        return _fetched(recipe, *fetched) if fetched else None
    for file, (_, expected) in zip(files, recipe.files, strict=True):
        found = hash_of(file)
        if found != expected:
            raise DefrayError(f"{file} is not the expected file: SHA-256 {found}, expected {expected}")
    triangles = np.concatenate([corners(file, *read_npz(file)) for file in files])
    return _scene(recipe.name, triangles, recipe.real_views, "real", recipe.licence)


def _fetched(recipe: Recipe, path: Path, pin: Pin) -> Scene:
    """What was fetched, if it is still what was converted then."""
    found = hash_of(path)
    if found != pin.npz_sha256:
        raise DefrayError(f"{path} is damaged: SHA-256 {found}; repair it with: defray scenes fetch {recipe.name}")
    triangles = corners(path, *read_npz(path))
    views = recipe.real_views or find_views(triangles, pin.up).views
    return _scene(recipe.name, triangles, views, "real", pin.licence)


def stand_in_scene(recipe: Recipe) -> Scene:
    """The stand-in: generated, or read from the cache what the same generator made before."""
    file = cache_folder() / f"{recipe.name}-{_generator_hash(recipe)}.npz"
    triangles = _kept(file)
    if triangles is None:
        triangles = np.ascontiguousarray(recipe.stand_in(SEED), np.float32)
        _keep(file, triangles)
    return _scene(recipe.name, triangles, recipe.stand_in_views, "stand-in", "generated, MIT")


def _generator_hash(recipe: Recipe) -> str:
    """Of the sources the generator is made of: an edited generator never meets an old cache."""
    own = Path(sys.modules[recipe.stand_in.__module__].__file__)
    blocks = [Path(scenes.__file__).with_name(name) for name in scenes.BUILDING_BLOCKS]
    parts = [*(file.read_bytes() for file in (own, *blocks)), np.__version__.encode(), bytes([SEED])]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


def _kept(file: Path) -> np.ndarray | None:
    """What `_keep` wrote, or None where it is absent or damaged: the archive's checksum tells."""
    try:
        with file.open("rb") as data:
            triangles = np.lib.npyio.NpzFile(data)["triangles"]
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error):
        return None
    usable = triangles.dtype == np.float32 and triangles.shape[1:] == (3, 3) and len(triangles)
    return triangles if usable else None


def _keep(file: Path, triangles: np.ndarray) -> None:
    """Write whole or not at all; a cache that cannot be written costs only time."""
    part = file.with_name(f"{file.name}.{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as out:
            np.savez(out, triangles=triangles)
        part.replace(file)
    except OSError:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def _resized(scene: Scene, size: str) -> Scene:
    """A scene in another size, with the views of the full one; made once, then read from the cache."""
    recipe = recipes().get(scene.name) if scene.source == "stand-in" else None
    generated = recipe and recipe.smaller and SIZES[size] < 1
    parts = [Path(sizes.__file__).read_bytes(), scene.sha256, size, version("fast-simplification")]
    parts += [_generator_hash(recipe)] if generated else []
    digest = hashlib.sha256(b"\0".join(part if isinstance(part, bytes) else part.encode() for part in parts))
    # A slash is no part of a file's name.
    file = cache_folder() / f"{scene.name}-{size.replace('/', 'of')}-{digest.hexdigest()[:16]}.npz"
    triangles = _kept(file)
    if triangles is None:
        triangles = recipe.smaller(SEED, float(SIZES[size])) if generated else resized(scene.triangles, size)
        _keep(file, triangles)
    return _scene(f"{scene.name}@{size}", triangles, scene.views, scene.source, scene.licence, scene.views_from)


def _from_file(path: Path) -> Scene:
    """A mesh with what its TOML file says of it; views that it does not give are found from the geometry."""
    triangles = read_mesh(path)
    beside = read_sidecar(path) or Sidecar()
    if beside.scale != 1:
        with np.errstate(over="ignore"):
            triangles = (triangles * np.float64(beside.scale)).astype(np.float32)
    check_scale(triangles, path.stem)
    views, found_by = beside.scaled_views(), f"given in {sidecar_path(path).name}"
    if not views:
        found = find_views(triangles, beside.up)
        views, found_by = found.views, found.reason
    return _scene(path.stem, triangles, views, "file", beside.licence, found_by)


def _scene(
    name: str, triangles: np.ndarray, views: tuple[View, ...], source: str, licence: str, found_by: str = ""
) -> Scene:
    triangles = np.ascontiguousarray(triangles, np.float32)
    check_scale(triangles, name)
    digest = hashlib.sha256(triangles.astype("<f4", copy=False).tobytes()).hexdigest()
    return Scene(name, triangles, views, source, digest, licence, found_by)
