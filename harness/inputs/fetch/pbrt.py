"""The triangles of a pbrt scene: transforms applied, object instances flattened, everything but geometry skipped.

Read are version 3 and 4 files: `plymesh` and `trianglemesh` shapes under their transforms, `Include` and `Import`,
objects and instances. Left out are other shapes (counted) and shapes that emit light, which belong to the
lighting. The numbering is the order of the text: a shape where it stands, an object's shapes at every instance
of it, in the object's order. pbrt's transforms before `WorldBegin` place the camera and move nothing.
"""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from harness.errors import DefrayError
from harness.inputs.fetch.archives import safe_path
from harness.inputs.meshes import mesh_parts

TOKEN = re.compile(r'#[^\n]*|"([^"\n]*)"|([\[\]])|([^\s"\[\]#]+)')
TYPES = frozenset(
    (
        "bool",
        "integer",
        "float",
        "string",
        "texture",
        "point",
        "point2",
        "point3",
        "vector",
        "vector2",
        "vector3",
        "normal",
        "normal3",
        "spectrum",
        "rgb",
        "color",
        "xyz",
        "blackbody",
    )
)
DEPTH = 16  # files that include one another
MOST_TRIANGLES = 100_000_000  # instances multiply: a file may not fill the memory
Mesh = tuple[np.ndarray, np.ndarray]  # vertices float64[v,3], faces int64[t,3]


@dataclass(frozen=True)
class _State:
    """What AttributeBegin saves: the transform float64[4,4] that acts on columns, and whether shapes emit light."""

    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))
    light: bool = False


@dataclass
class PbrtScene:
    """`parts`: meshes in order, in world space. `skipped`: how many shapes of each kind were left out."""

    parts: list[Mesh] = field(default_factory=list)
    skipped: dict[str, int] = field(default_factory=dict)


def read_pbrt(entry: str, open_file: Callable[[str], Path]) -> PbrtScene:
    """Read the scene file `entry`; `open_file(name)` brings any file it names, relative to it, to this machine.

    Raises DefrayError for a name that leads out of the scene's folder, a file that cannot be read, includes or
    blocks nested wrongly, an unknown object, or more than MOST_TRIANGLES triangles.
    """
    reader = _Reader(open_file)
    reader.read_file(entry, 0)
    if not reader.scene.parts:
        raise DefrayError(f"{entry} holds no triangle")
    return reader.scene


def directives(text: str) -> Iterator[tuple[str, list[str]]]:
    """Each directive with its arguments, strings without their quotes, brackets dropped."""
    name, arguments = "", []
    for match in TOKEN.finditer(text):
        string, _, bare = match.groups()
        if bare is not None and bare[0].isalpha() and bare not in ("true", "false"):
            if name:
                yield name, arguments
            name, arguments = bare, []
        elif string is not None or bare is not None:
            arguments.append(string if string is not None else bare)
    if name:
        yield name, arguments


def parameters(arguments: list[str]) -> dict[str, list[str]]:
    """`point3 P` and its like as `{"P": values}`: a shape's parameters by name, whatever their type."""
    found: dict[str, list[str]] = {}
    for argument in arguments:
        words = argument.split()
        if len(words) == 2 and words[0] in TYPES:
            found[words[1]] = current = []
        elif found:
            current.append(argument)
    return found


class _Reader:
    """The walk through the files of one scene."""

    def __init__(self, open_file: Callable[[str], Path]):
        self.scene = PbrtScene()
        self._open = open_file
        self._state, self._saved = _State(), []
        self._named: dict[str, np.ndarray] = {}
        self._objects: dict[str, list[Mesh]] = {}
        self._object: str | None = None
        self._triangles = 0
        self._meshes: dict[str, Mesh] = {}

    def read_file(self, name: str, depth: int) -> None:
        """Carry out every directive of a file."""
        if depth > DEPTH:
            raise DefrayError(f"{name}: files include one another more than {DEPTH} deep")
        path = self._fetch(name)
        data = path.read_bytes()
        text = (gzip.decompress(data) if name.endswith(".gz") else data).decode("utf-8", errors="replace")
        for directive, arguments in directives(text):
            try:
                if directive in ("Include", "Import"):
                    self.read_file(arguments[0], depth + 1)
                else:
                    self._carry_out(directive, arguments)
            except (IndexError, ValueError, KeyError) as error:
                raise DefrayError(f"{name}: {directive} {' '.join(arguments)[:60]}: {error}") from None

    def _fetch(self, name: str) -> Path:
        return self._open(str(safe_path(name, "the scene")))

    def _carry_out(self, directive: str, arguments: list[str]) -> None:
        if directive in TRANSFORMS:
            matrix = TRANSFORMS[directive](np.array(arguments, float))
            # Transform and Identity replace what was there, all others add to it.
            fresh = directive in ("Transform", "Identity")
            self._state = replace(self._state, matrix=matrix if fresh else self._state.matrix @ matrix)
        elif directive == "WorldBegin":
            self._named["camera"] = np.linalg.inv(self._state.matrix)
            self._state = _State()
        elif directive in ("AttributeBegin", "TransformBegin"):
            self._saved.append(self._state)
        elif directive in ("AttributeEnd", "TransformEnd"):
            self._state = self._restored()
        elif directive == "CoordinateSystem":
            self._named[arguments[0]] = self._state.matrix
        elif directive == "CoordSysTransform":
            self._state = replace(self._state, matrix=self._named[arguments[0]])
        elif directive == "AreaLightSource":
            self._state = replace(self._state, light=True)
        elif directive == "ObjectBegin":
            if self._object is not None:
                raise ValueError("an object inside another")
            self._object = arguments[0]
            self._objects[self._object] = []
            self._saved.append(self._state)
        elif directive == "ObjectEnd":
            self._object, self._state = None, self._restored()
        elif directive == "ObjectInstance":
            for vertices, faces in self._objects[arguments[0]]:
                self._keep(vertices, faces)
        elif directive == "Shape":
            self._shape(arguments[0], parameters(arguments[1:]))

    def _restored(self) -> _State:
        if not self._saved:
            raise ValueError("ends what was not begun")
        return self._saved.pop()

    def _shape(self, kind: str, values: dict[str, list[str]]) -> None:
        if self._state.light or kind not in ("plymesh", "trianglemesh"):
            kind = "light" if self._state.light else kind
            self.scene.skipped[kind] = self.scene.skipped.get(kind, 0) + 1
        elif kind == "plymesh":
            self._keep(*self._ply(values["filename"][0]))
        else:
            vertices = np.array(values["P"], float).reshape(-1, 3)
            faces = np.array(values["indices"], np.int64) if "indices" in values else np.arange(len(vertices))
            self._keep(vertices, faces.reshape(-1, 3))

    def _ply(self, name: str) -> Mesh:
        """A PLY file, read once however often it is named."""
        if name not in self._meshes:
            path = self._fetch(name)
            if name.endswith(".gz"):
                unpacked = path.with_suffix("")
                unpacked.write_bytes(gzip.decompress(path.read_bytes()))
                path = unpacked
            parts = mesh_parts(path)
            if len(parts) != 1:
                raise ValueError("is no mesh of triangles")
            self._meshes = {name: (np.asarray(parts[0][0], float), np.asarray(parts[0][1], np.int64))}
        return self._meshes[name]

    def _keep(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """Put a mesh where the current transform wants it: into the object being defined, or into the world."""
        matrix = self._state.matrix
        placed = vertices @ matrix[:3, :3].T + matrix[:3, 3], faces
        if self._object is not None:
            self._objects[self._object].append(placed)
            return
        self._triangles += len(faces)
        if self._triangles > MOST_TRIANGLES:
            raise DefrayError(f"the scene has more than {MOST_TRIANGLES:,} triangles with its instances")
        self.scene.parts.append(placed)


def _matrix(numbers: np.ndarray) -> np.ndarray:
    return numbers.reshape(4, 4).T  # pbrt writes them column by column


def _translation(numbers: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = numbers.reshape(3)
    return matrix


def _scaling(numbers: np.ndarray) -> np.ndarray:
    return np.diag([*numbers.reshape(3), 1.0])


def _rotation(numbers: np.ndarray) -> np.ndarray:
    """By degrees about an axis (Rodrigues)."""
    angle, axis = np.radians(numbers[0]), numbers[1:4] / np.linalg.norm(numbers[1:4])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def _look_at(numbers: np.ndarray) -> np.ndarray:
    """World to camera; pbrt's camera looks along +z, with x to the right of a left-handed frame."""
    eye, target, up = numbers.reshape(3, 3)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(up / np.linalg.norm(up), ahead)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    matrix[:3, 3] = eye
    return np.linalg.inv(matrix)


TRANSFORMS = {
    "Identity": lambda numbers: np.eye(4),
    "Transform": _matrix,
    "ConcatTransform": _matrix,
    "Translate": _translation,
    "Scale": _scaling,
    "Rotate": _rotation,
    "LookAt": _look_at,
}
