"""Scenes by name, real or stand-in, and any mesh file."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import sys
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import scenes
from harness.cache import cache_folder
from harness.data import Scene, View
from harness.errors import DefrayError, known
from scenes import Recipe, recipes

SEED = 1  # of every stand-in
LARGEST, SMALLEST = 1e12, 1e-12  # coordinates and extent: cubes of lengths must neither overflow nor vanish
OBJ_GROUPING = (["usemtl"], ["mtllib"], ["o"], ["g"])
MESH_SUFFIXES = {".npz", ".obj", ".ply", ".stl", ".glb", ".gltf", ".off", ".3mf", ".dae", ".xyz"}


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
    """Raise DefrayError for a scene that is certainly neither known nor a file."""
    if name_or_path not in recipes() and not _looks_like_a_file(name_or_path):
        raise DefrayError(f"{known('scene', name_or_path, recipes())}; or name a mesh file")


def _looks_like_a_file(text: str) -> bool:
    path = Path(text)
    try:
        return path.suffix.lower() in MESH_SUFFIXES or os.sep in text or path.is_file()
    except (OSError, ValueError):  # too long for a path, or not one
        return False


def list_scenes() -> list[SceneStatus]:
    """Every known scene, without loading any geometry."""
    return [_status(recipe) for recipe in recipes().values()]


def _status(recipe: Recipe) -> SceneStatus:
    real = _real_files(recipe)
    if real:
        source, origin = "real", ", ".join(str(path) for path in real)
    elif recipe.stand_in:
        source, origin = "stand-in", "seeded generator"
    else:
        names = ", ".join(name for name, _ in recipe.files) or "its file"
        source, origin = "missing", f"set DEFRAY_SCENES to a folder with {names}"
    return SceneStatus(recipe.name, recipe.triangles, source, origin, recipe.licence, recipe.paper)


def load_scene(name_or_path: str) -> Scene:
    """A known scene by name, or a mesh file by path.

    Real geometry comes from the folder DEFRAY_SCENES; without it the stand-in is generated. Raises DefrayError
    for an unknown name, a missing, unreadable or altered file, an empty mesh, or a vertex that is not finite.
    """
    check_name(name_or_path)
    if name_or_path not in recipes():
        return _from_file(Path(name_or_path))
    recipe = recipes()[name_or_path]
    real = real_scene(recipe)
    if real:
        return real
    if recipe.stand_in:
        return stand_in_scene(recipe)
    raise DefrayError(f"scene {recipe.name} is missing: {_status(recipe).origin}")


# ---------------------------------------------------------------- real geometry


def _real_files(recipe: Recipe) -> list[Path]:
    """The recipe's files under DEFRAY_SCENES, or none if the folder does not hold them all."""
    folder = os.environ.get("DEFRAY_SCENES")
    if not folder or not recipe.files:
        return []
    if not Path(folder).is_dir():
        raise DefrayError(f"DEFRAY_SCENES={folder} is not a folder")
    files = [Path(folder) / name for name, _ in recipe.files]
    return files if all(file.is_file() for file in files) else []


def real_scene(recipe: Recipe) -> Scene | None:
    """The real geometry from the folder DEFRAY_SCENES, or None; raises DefrayError for an altered file."""
    files = _real_files(recipe)
    if not files:
        return None
    for file, (_, expected) in zip(files, recipe.files, strict=True):
        with file.open("rb") as data:
            found = hashlib.file_digest(data, "sha256").hexdigest()
        if found != expected:
            raise DefrayError(f"{file} is not the expected file: SHA-256 {found}, expected {expected}")
    triangles = np.concatenate([_read_npz(file) for file in files])
    return _scene(recipe.name, triangles, recipe.real_views, "real", recipe.licence)


# ---------------------------------------------------------------- stand-ins


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


# ---------------------------------------------------------------- mesh files


def _from_file(path: Path) -> Scene:
    if not path.is_file():
        raise DefrayError(f"scene file {path} " + ("is a folder" if path.is_dir() else "does not exist"))
    triangles = _read_npz(path) if path.suffix.lower() == ".npz" else _read_mesh(path)
    return _scene(path.stem, triangles, automatic_views(triangles), "file", "unknown")


def _read_npz(path: Path) -> np.ndarray:
    try:
        with path.open("rb") as data:
            arrays = np.lib.npyio.NpzFile(data)
            vertices, faces = arrays["vertices"], arrays["faces"]
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise DefrayError(f"{path} cannot be read as npz with vertices and faces: {error}") from error
    except Exception as error:  # a damaged zip raises errors of its own
        raise DefrayError(f"{path} is damaged: {error}") from error
    return _corners(path, vertices, faces)


def _read_mesh(path: Path) -> np.ndarray:
    """Through trimesh: scene graphs flattened with their transforms, nothing merged or removed.

    The numbering is the file's, mesh after mesh in trimesh's order of the graph; in PLY files that mix triangles
    and quads, triangles come first.
    """
    import trimesh

    try:
        if path.suffix.lower() == ".obj":
            # Materials and groups would reorder the faces; comments are often not UTF-8.
            lines = path.read_text(encoding="utf-8", errors="replace").splitlines(keepends=True)
            text = "".join(line for line in lines if line.split(None, 1)[:1] not in OBJ_GROUPING)
            loaded = trimesh.load(io.StringIO(text), file_type="obj", process=False, maintain_order=True)
        else:
            loaded = trimesh.load(path, process=False)
        meshes = loaded.dump() if isinstance(loaded, trimesh.Scene) else [loaded]
        parts = [(m.vertices, m.faces) for m in meshes if isinstance(m, trimesh.Trimesh)]
    except Exception as error:  # trimesh's readers raise whatever their parsers do
        reason = "" if isinstance(error, ImportError) else " ".join(str(error).split())[:200]
        reason = reason or f"damaged, or no {path.suffix[1:].upper()} at all"
        raise DefrayError(f"{path} cannot be read as a mesh: {reason}") from error
    if not parts:
        raise DefrayError(f"{path} holds no triangle")
    return np.concatenate([_corners(path, vertices, faces) for vertices, faces in parts])


def _corners(path: Path, vertices, faces) -> np.ndarray:
    """float32[n,3,3] from float[v,3] and int[n,3]; raises DefrayError naming what is wrong."""
    vertices, faces = np.asarray(vertices), np.asarray(faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise DefrayError(f"{path}: vertices {vertices.shape} and faces {faces.shape} must be [v,3] and [n,3]")
    if not len(faces):
        raise DefrayError(f"{path} holds no triangle")
    if faces.dtype.kind not in "iu" or vertices.dtype.kind not in "fiu":
        raise DefrayError(f"{path}: vertices {vertices.dtype} must be numbers and faces {faces.dtype} integers")
    if faces.min() < 0 or faces.max() >= len(vertices):
        bad = int(np.flatnonzero((faces < 0).any(axis=1) | (faces >= len(vertices)).any(axis=1))[0])
        raise DefrayError(f"{path}: face {bad} {faces[bad].tolist()} names a vertex outside 0..{len(vertices) - 1}")
    with np.errstate(over="ignore"):
        vertices = vertices.astype(np.float32)
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise DefrayError(f"{path}: vertex {bad} is not finite in float32: {vertices[bad].tolist()}")
    return vertices[faces]


def check_scale(triangles: np.ndarray, name: str = "the scene") -> None:
    """Raise DefrayError where float32 arithmetic on the triangles would overflow or vanish."""
    largest = float(np.abs(triangles).max())
    extent = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    if not largest <= LARGEST:  # not a number, too
        raise DefrayError(f"coordinates of {name} reach {largest:.3g}; scale it so that they stay below {LARGEST:g}")
    if 0 < extent < SMALLEST:
        raise DefrayError(f"{name} is only {extent:.3g} large; scale it up to at least {SMALLEST:g}")


def automatic_views(triangles: np.ndarray) -> tuple[View, ...]:
    """A three-quarter view from outside that holds the whole bounds, and one from the middle of them."""
    corners = triangles.reshape(-1, 3)
    lower, upper = corners.min(axis=0).astype(float), corners.max(axis=0).astype(float)
    centre, radius = (lower + upper) / 2, max(float(np.linalg.norm(upper - lower)) / 2, 1e-6)
    eye = centre + np.array([0.6, 0.45, 1.0]) / np.linalg.norm([0.6, 0.45, 1.0]) * radius * 2.7
    ahead = centre + np.array([1.0, 0.0, 0.0]) * radius
    return (
        View(tuple(eye), tuple(centre), fov_degrees=45.0, name="outside"),
        View(tuple(centre), tuple(ahead), fov_degrees=75.0, name="inside"),
    )


def _scene(name: str, triangles: np.ndarray, views: tuple[View, ...], source: str, licence: str) -> Scene:
    triangles = np.ascontiguousarray(triangles, np.float32)
    check_scale(triangles, name)
    digest = hashlib.sha256(triangles.astype("<f4", copy=False).tobytes()).hexdigest()
    return Scene(name, triangles, views, source, digest, licence)
