"""Closed meshes that rays are aimed at, made with additions, products, quotients and square roots only.

IEEE arithmetic rounds those alike everywhere, so the inputs are the same bits on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Mesh:
    """`vertices` float32[v,3]; `faces` int32[t,3]; `edges` int32[e,2], vertices.

    `around_start` int32[v+e+1] and `around` int32[r]: the faces that touch each vertex, and then those that touch
    either end of each edge, ascending.
    """

    vertices: np.ndarray
    faces: np.ndarray
    edges: np.ndarray
    around_start: np.ndarray
    around: np.ndarray

    @property
    def triangles(self) -> np.ndarray:
        """float32[t,3,3]."""
        return self.vertices[self.faces]


def closed_mesh(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
    """A mesh with its neighbourhoods; raises ValueError where an edge has not exactly two faces."""
    faces = np.asarray(faces, np.int32)
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    if not (count == 2).all():
        raise ValueError("the mesh is not closed")
    touching: list[set[int]] = [set() for _ in vertices]
    for number, face in enumerate(faces):
        for corner in face:
            touching[corner].add(number)
    around = [sorted(own) for own in touching] + [sorted(touching[a] | touching[b]) for a, b in edges]
    start = np.concatenate([[0], np.cumsum([len(own) for own in around])]).astype(np.int32)
    return Mesh(vertices.astype(np.float32), faces, edges, start, np.concatenate(around).astype(np.int32))


def icosphere(divisions: int, generator: np.random.Generator, jitter: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Vertices float64[v,3] at radius 1 to 1 + jitter, and faces int[t,3], 20 * 4^divisions of them."""
    g = (1 + np.sqrt(5.0)) / 2
    corners = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g),
               (0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]  # fmt: skip
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2),
             (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11),
             (6, 2, 10), (8, 6, 7), (9, 8, 1)]  # fmt: skip
    vertices = [np.array(corner, np.float64) for corner in corners]
    for _ in range(divisions):
        vertices, faces = _divided(vertices, faces)
    points = unit(np.array(vertices))
    return points * (1 + jitter * generator.random((len(points), 1))), np.array(faces)


def _divided(vertices: list, faces: list) -> tuple[list, list]:
    """Every triangle as four."""
    middles: dict[tuple, int] = {}
    vertices = list(vertices)

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in middles:
            middles[key] = len(vertices)
            vertices.append(unit((vertices[a] + vertices[b])[None])[0])
        return middles[key]

    divided = []
    for a, b, c in faces:
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        divided += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return vertices, divided


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors float64[n,3] over their lengths."""
    x, y, z = vectors.T
    return vectors / np.sqrt(x * x + y * y + z * z)[:, None]


def random_units(count: int, generator: np.random.Generator) -> np.ndarray:
    """Directions float64[count,3] of points in the cube: uniform enough, and free of transcendental functions."""
    return unit(2 * generator.random((count, 3)) - 1 + 1e-9)


def lattice_box(cells: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """The surface of the cube [0, cells]^3 in unit squares: vertices float64[v,3], faces int[t,3].

    Vertices are numbered in the order in which the squares' corners first name them.
    """
    i, j = (values.ravel() for values in np.indices((cells, cells)))
    squares = []
    for axis in range(3):
        for side in (0, cells):
            corners = np.empty((cells * cells, 4, 3), np.int64)
            corners[:, :, axis] = side
            corners[:, :, (axis + 1) % 3] = np.stack([i, i + 1, i + 1, i], axis=1)
            corners[:, :, (axis + 2) % 3] = np.stack([j, j, j + 1, j + 1], axis=1)
            squares.append(corners)
    points = np.concatenate(squares).reshape(-1, 3)
    place = points @ [(cells + 1) ** 2, cells + 1, 1]
    _, first, inverse = np.unique(place, return_index=True, return_inverse=True)
    number = np.argsort(np.argsort(first))[inverse].reshape(-1, 4)
    return points[np.sort(first)].astype(np.float64), number[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def globe(divisions: int) -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere of squares on a cube blown up to the sphere: vertices float64[v,3], faces int[t,3]."""
    vertices, faces = lattice_box(divisions)
    return unit(2 * vertices / divisions - 1), faces
