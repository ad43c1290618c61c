"""A ladder of sizes: `NAME@SIZE` is a scene with 1/64, 1/16, 1/4 or 4 times its triangles, seen by the same views.

Smaller rungs are decimated by quadric error metrics with borders held (Garland & Heckbert 1997, the library
fast-simplification). That stalls on meshes of many small open pieces, leaves, hairs and slats; such a rung is made by
vertex clustering of the full scene instead (Rossignac & Borrel 1993). The rung of 4 cuts every triangle into four at
the middles of its edges: the same surface, and every shared edge is still shared bit for bit. Hairball's generator
makes its smaller rungs itself, for hair neither decimates nor clusters into hair.
"""

from __future__ import annotations

import fast_simplification
import numpy as np
import pandas as pd

from harness.errors import DefrayError
from harness.spec.run_spec import SIZES

SLACK = 0.05  # part of the wanted number of triangles that a rung may have more or fewer
FINEST = 1 << 21  # cells along an axis of the finest lattice; some triangles are as small as that


def resized(triangles: np.ndarray, size: str) -> np.ndarray:
    """float32[n,3,3] with `size` times as many triangles: exactly for 1 and 4, for less within 5 % where the mesh is
    not so regular that clustering has no such number to offer; then fewer.

    The same bytes for the same input. Raises DefrayError where too few triangles are left to speak of.
    """
    factor = SIZES[size]
    if factor == 1:
        return triangles
    if factor > 1:
        return subdivided(triangles)
    wanted = int(len(triangles) * factor)
    if wanted < 4:
        raise DefrayError(f"{size} of {len(triangles):,} triangles is too few to be a scene")
    return decimated(triangles, wanted)


def subdivided(triangles: np.ndarray) -> np.ndarray:
    """Each triangle cut into four: float32[4n,3,3], those of triangle i at 4i to 4i+3, the middle one last."""
    a, b, c = triangles.transpose(1, 0, 2)
    half = np.float32(0.5)
    ab, bc, ca = (a + b) * half, (b + c) * half, (c + a) * half
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    result = np.empty((4 * len(triangles), 3, 3), np.float32)
    for number, part in enumerate(parts):
        for corner, points in enumerate(part):
            result[number::4, corner] = points
    return result


def decimated(triangles: np.ndarray, wanted: int) -> np.ndarray:
    """About `wanted` triangles with the look of float32[n,3,3]."""
    vertices, faces = welded(triangles)
    if len(faces) <= wanted:
        return vertices[faces]
    # Without its borders held, a wall of two triangles is collapsed into nothing at no cost.
    points, fewer = fast_simplification.simplify(
        vertices, faces.astype(np.int32), target_count=wanted, preserve_border=True
    )[:2]
    fewer = distinct(np.asarray(fewer, np.int64))
    if abs(len(fewer) / wanted - 1) > SLACK:
        vertices, fewer = clustered(vertices, faces, wanted)
        return vertices[fewer]
    return np.asarray(points, np.float32)[fewer]


def welded(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices float32[v,3], equal corners made one, and faces int64[t,3] without those that lost a corner by it."""
    corners = triangles.reshape(-1, 3) + np.float32(0)  # -0 becomes 0
    code = pd.factorize(corners[:, 0])[0].astype(np.int64)
    for axis in (1, 2):
        number, values = pd.factorize(corners[:, axis])
        code = pd.factorize(code * len(values) + number)[0].astype(np.int64)
    first = np.empty(int(code.max()) + 1, np.int64)
    first[code[::-1]] = np.arange(len(code) - 1, -1, -1)
    return corners[first], distinct(code.reshape(-1, 3))


def distinct(faces: np.ndarray) -> np.ndarray:
    """The faces with three different vertices."""
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]


def clustered(vertices: np.ndarray, faces: np.ndarray, wanted: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices that share a cell of a regular lattice made one, its mean; the cell is as small as `wanted` allows.

    Faces that become a line, a point or another's double are left out.
    """
    lower, extent = vertices.min(axis=0).astype(float), float(np.ptp(vertices, axis=0).max()) or 1.0
    fine, coarse = float(FINEST), 1.0  # cells along the longest axis: too many triangles, too few
    best = None
    for _ in range(60):
        cells = np.sqrt(fine * coarse)
        keys = np.floor((vertices - lower) / extent * cells).astype(np.int64)
        merged, kept = _merge(keys, faces)
        if len(kept) <= wanted * (1 + SLACK):
            coarse, best = cells, (merged, kept)
            if len(kept) >= wanted * (1 - SLACK):
                break
        else:
            fine = cells
        if fine / coarse < 1 + 1e-6:
            break
    if best is None:
        raise DefrayError(f"no lattice leaves {wanted:,} of {len(faces):,} triangles")
    merged, kept = best
    count = np.bincount(merged)
    sums = [np.bincount(merged, weights=vertices[:, axis]) for axis in range(3)]
    return (np.stack(sums, axis=1) / count[:, None]).astype(np.float32), kept


def _merge(keys: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The number of each vertex's cell, and the distinct faces between cells, each once, in their order."""
    most = int(keys.max()) + 1
    code = keys[:, 0]
    for axis in (1, 2):
        code = pd.factorize(code * most + keys[:, axis])[0].astype(np.int64)
    kept = distinct(code[faces])
    low, middle, high = np.sort(kept, axis=1).T
    pair = pd.factorize(low * len(code) + middle)[0].astype(np.int64)
    first = ~pd.Series(pair * len(code) + high).duplicated().to_numpy()
    return code, kept[first]
