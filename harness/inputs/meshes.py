"""Mesh files of any kind as triangles: nothing merged, nothing removed, the numbering of the file kept."""

from __future__ import annotations

import io
import itertools
from pathlib import Path

import numpy as np
import trimesh

from harness.errors import DefrayError

OBJ_GROUPING = (["usemtl"], ["mtllib"], ["o"], ["g"], ["s"])
MESH_SUFFIXES = frozenset(
    (
        ".npz",
        ".obj",
        ".ply",
        ".stl",
        ".glb",
        ".gltf",
        ".off",
        ".3mf",
        ".dae",
        ".zae",
        ".xaml",
        ".3dxml",
        ".xyz",
        ".stp",
        ".step",
        ".ctm",
    )
)
NEEDS = {".stp": "the Python package cascadio", ".step": "the Python package cascadio", ".ctm": "the library OpenCTM"}


def read_mesh(path: Path) -> np.ndarray:
    """float32[n,3,3] of a mesh file: `.npz` with `vertices` and `faces`, or any format trimesh reads.

    Scene graphs are flattened with their transforms, mesh after mesh in the order in which trimesh walks the graph
    (of the children of a glTF node, the last comes first). Polygons become triangles where they stand, but for PLY
    files that mix triangles with larger polygons: there triangles come first. Duplicate and unreferenced vertices
    change nothing; triangles without area keep their numbers.
    Raises DefrayError for a file that cannot be read, holds no triangle, or has a vertex that is not finite.
    """
    if not path.is_file():
        raise DefrayError(f"scene file {path} " + ("is a folder" if path.is_dir() else "does not exist"))
    if path.suffix.lower() == ".npz":
        return corners(path, *read_npz(path))
    parts = mesh_parts(path)
    if not parts:
        raise DefrayError(f"{path} holds no triangle")
    return np.concatenate([corners(path, vertices, faces) for vertices, faces in parts])


def read_npz(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Arrays `vertices` and `faces` of an npz file, not yet checked; raises DefrayError where they are not there."""
    try:
        with path.open("rb") as data:
            arrays = np.lib.npyio.NpzFile(data)
            return arrays["vertices"], arrays["faces"]
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise DefrayError(f"{path} cannot be read as npz with vertices and faces: {error}") from error
    except Exception as error:  # a damaged zip raises errors of its own
        raise DefrayError(f"{path} is damaged: {error}") from error


def mesh_parts(path: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Vertices and faces of every mesh in the file, not yet checked, through trimesh; raises DefrayError."""
    suffix = path.suffix.lower()
    try:
        if suffix in REWRITTEN:
            text = REWRITTEN[suffix](path.read_text(encoding="utf-8", errors="replace"))
            loaded = trimesh.load(io.StringIO(text), file_type=suffix[1:], process=False, maintain_order=True)
        else:
            loaded = trimesh.load(path, process=False)
        meshes = loaded.dump() if isinstance(loaded, trimesh.Scene) else [loaded]
        return [(m.vertices, m.faces) for m in meshes if isinstance(m, trimesh.Trimesh)]
    except Exception as error:  # trimesh's readers raise whatever their parsers do
        if isinstance(error, ImportError) and suffix in NEEDS:
            raise DefrayError(f"{path}: {suffix[1:].upper()} files need {NEEDS[suffix]}") from error
        reason = "" if isinstance(error, ImportError) else " ".join(str(error).split())[:200]
        reason = reason or f"damaged, or no {suffix[1:].upper()} at all"
        raise DefrayError(f"{path} cannot be read as a mesh: {reason}") from error


def _ungrouped_obj(text: str) -> str:
    """OBJ without materials and groups, by which trimesh would reorder the faces."""
    lines = text.splitlines(keepends=True)
    return "".join(line for line in lines if line.split(None, 1)[:1] not in OBJ_GROUPING)


def _fanned_off(text: str) -> str:
    """OFF with every polygon cut into triangles where it stands, which trimesh does for quads alone, and last."""
    lines = [line for line in (line.split("#")[0].strip() for line in text.splitlines()) if line]
    rest = lines[0].partition("OFF")[2].split() or lines.pop(1).split()
    vertices, faces = int(rest[0]), int(rest[1])
    polygons = [line.split() for line in lines[1 + vertices : 1 + vertices + faces]]
    if not lines[0].partition(" ")[0].endswith("OFF") or len(polygons) < faces:
        raise ValueError("no OFF file, or cut short")
    fans = []
    for count, *numbers in polygons:
        ring = numbers[: int(count)]
        fans += [f"3 {ring[0]} {b} {c}" for b, c in itertools.pairwise(ring[1:])]
    return "\n".join(["OFF", f"{vertices} {len(fans)} 0", *lines[1 : 1 + vertices], *fans])


REWRITTEN = {".obj": _ungrouped_obj, ".off": _fanned_off}


def corners(path: Path, vertices, faces) -> np.ndarray:
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
