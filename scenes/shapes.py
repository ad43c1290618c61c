"""Building blocks of the stand-in scenes.

Every shape is float64[n,3,3]: n triangles of three corners, in scene units, y up unless a function says
otherwise. A generator joins shapes and ends with `on_lattice`, which rounds to float32. Sines and products of
matrices are computed so that every machine makes the same bits (see `elementary`).
"""

from __future__ import annotations

import math

import numpy as np

from scenes.elementary import PI, TURN, arctan2, cos, sin

# Directions that no axis of a scene is parallel to: a tube's first frame starts from one of them.
_REFERENCES = np.array([[0.36, 0.48, 0.8], [0.8, -0.6, 0.0]])


# ---------------------------------------------------------------- whole scenes


def join(*parts: np.ndarray) -> np.ndarray:
    """All triangles of float[n_i,3,3] parts, in order."""
    return np.concatenate(parts) if parts else np.zeros((0, 3, 3))


def on_lattice(triangles: np.ndarray, size: float, bits: int = 18) -> np.ndarray:
    """float32[n,3,3] with every coordinate a multiple of a power of two near `size` / 2**`bits`.

    `size`: the scene's largest extent; `bits` at most 22, so that float32 holds every multiple exactly.
    """
    mantissa, exponent = math.frexp(size)
    step = 2.0 ** (exponent - (mantissa == 0.5) - bits)
    rounded = np.empty(triangles.shape, np.float32)
    for first in range(0, len(triangles), 1 << 18):
        rounded[first : first + (1 << 18)] = np.rint(triangles[first : first + (1 << 18)] / step) * step
    return rounded + np.float32(0)  # no negative zero


def proper(triangles: np.ndarray) -> np.ndarray:
    """Without the triangles of which two corners are the same point."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    same = (a == b).all(axis=1) | (b == c).all(axis=1) | (c == a).all(axis=1)
    return triangles[~same]


# ---------------------------------------------------------------- placing


def placement(offset=(0, 0, 0), scale=1.0, yaw=0.0, pitch=0.0, roll=0.0) -> np.ndarray:
    """float64[...,4,4] that scales, then turns about z (roll), x (pitch), y (yaw), then moves.

    `offset` float[...,3]; `scale` a number or float[...,1] or float[...,3]; angles float[...] in radians.
    """
    offset, scale = np.asarray(offset, np.float64), np.asarray(scale, np.float64)
    scale = np.broadcast_to(scale, np.broadcast_shapes(scale.shape, (3,)))
    angles = [np.asarray(a, np.float64) for a in (yaw, pitch, roll)]
    shape = np.broadcast_shapes(offset.shape[:-1], scale.shape[:-1], *(a.shape for a in angles))
    turn = _product(_product(_turn(angles[0], 1), _turn(angles[1], 0)), _turn(angles[2], 2))
    matrix = np.zeros((*shape, 4, 4))
    matrix[..., :3, :3] = turn * scale[..., None, :]
    matrix[..., :3, 3] = offset
    matrix[..., 3, 3] = 1
    return matrix


def _turn(angle: np.ndarray, axis: int) -> np.ndarray:
    """float64[...,3,3] about an axis, right-handed."""
    matrix = np.zeros((*angle.shape, 3, 3))
    b, c = (axis + 1) % 3, (axis + 2) % 3
    matrix[..., axis, axis] = 1
    matrix[..., b, b] = matrix[..., c, c] = cos(angle)
    matrix[..., c, b] = sin(angle)
    matrix[..., b, c] = -sin(angle)
    return matrix


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of matrices [...,3,3], summed in a fixed order."""
    return sum(a[..., :, k, None] * b[..., None, k, :] for k in range(3))


def instances(template: np.ndarray, transforms: np.ndarray) -> np.ndarray:
    """Copies of a template float[n,3,3] under each of float[k,4,4] (or one [4,4]) transforms: [k*n,3,3]."""
    transforms = np.asarray(transforms, np.float64).reshape(-1, 4, 4)
    x, y, z = (np.ascontiguousarray(part) for part in np.asarray(template, np.float64).reshape(-1, 3).T)
    placed = np.empty((len(transforms), len(x), 3))
    for copy, matrix in zip(placed, transforms, strict=True):
        for axis, (a, b, c, moved) in enumerate(matrix[:3]):
            copy[:, axis] = ((a * x + b * y) + c * z) + moved
    return placed.reshape(-1, 3, 3)


def scatter(template: np.ndarray, offsets: np.ndarray, scales=1.0, yaws=0.0) -> np.ndarray:
    """Copies of a template at float[k,3] offsets, scaled by float[k] (or [k,3]), turned by float[k] about y."""
    offsets = np.asarray(offsets, np.float64).reshape(-1, 3)
    scales = np.asarray(scales, np.float64)
    return instances(template, placement(offsets, scales[:, None] if scales.ndim == 1 else scales, yaws))


# ---------------------------------------------------------------- flat shapes


def box(lower, upper) -> np.ndarray:
    """Twelve triangles of the axis-parallel box between two corners float[3], seen from outside."""
    lower, upper = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
    bit = (np.arange(8)[:, None] >> np.arange(3)) & 1
    corners = np.where(bit == 1, upper, lower)
    quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    return corners[np.array([q[:3] for q in quads] + [[q[0], q[2], q[3]] for q in quads])]


def boxes(lowers: np.ndarray, uppers: np.ndarray) -> np.ndarray:
    """Boxes between corners float[k,3]: [12*k,3,3]."""
    return join(*(box(lower, upper) for lower, upper in zip(lowers, uppers, strict=True)))


def quad(origin, u, v, columns: int = 1, rows: int = 1) -> np.ndarray:
    """A parallelogram from `origin` along edges `u` and `v` (float[3]), in 2*columns*rows triangles."""
    s, t = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    return grid(np.asarray(origin, np.float64) + s[..., None] * np.asarray(u) + t[..., None] * np.asarray(v))


# ---------------------------------------------------------------- curved shapes


def grid(points: np.ndarray, wrap_rows: bool = False, wrap_columns: bool = False) -> np.ndarray:
    """Quads between neighbours of float[...,r,c,3] points, two triangles each; leading axes are more grids.

    Wrapping joins the last row (or column) to the first. The front is where rows and columns turn left.
    """
    points = np.asarray(points, np.float64)
    if wrap_rows:
        points = np.concatenate([points, points[..., :1, :, :]], axis=-3)
    if wrap_columns:
        points = np.concatenate([points, points[..., :1, :]], axis=-2)
    a, b = points[..., :-1, :-1, :], points[..., :-1, 1:, :]
    d, c = points[..., 1:, :-1, :], points[..., 1:, 1:, :]
    return np.stack([np.stack([a, b, c], -2), np.stack([a, c, d], -2)], -3).reshape(-1, 3, 3)


def surface(function, rows: int, columns: int, wrap_rows=False, wrap_columns=False) -> np.ndarray:
    """The grid of `function(s, t)` -> three arrays x, y, z; t over rows and s over columns, both in [0, 1].

    Up to 2*rows*columns triangles; the samples of a wrapped axis leave out 1.
    """
    t = np.linspace(0, 1, rows, endpoint=False) if wrap_rows else np.linspace(0, 1, rows + 1)
    s = np.linspace(0, 1, columns, endpoint=False) if wrap_columns else np.linspace(0, 1, columns + 1)
    s, t = np.meshgrid(s, t)
    return grid(np.stack(np.broadcast_arrays(*function(s, t)), axis=-1), wrap_rows, wrap_columns)


def revolve(profile: np.ndarray, sides: int) -> np.ndarray:
    """float[m,2] points (radius, y) turned about the y axis, in `sides` steps; upward profiles face outwards.

    2*(m-1)*sides triangles, fewer where the radius is exactly 0.
    """
    profile = np.asarray(profile, np.float64)
    angle = -TURN * np.arange(sides) / sides
    x, z = (profile[:, :1] * trig(angle) for trig in (cos, sin))
    y = np.broadcast_to(profile[:, 1:], x.shape)
    return proper(grid(np.stack([x, y, z], axis=-1), wrap_columns=True))


def resampled(profile: np.ndarray, count: int) -> np.ndarray:
    """`count` points float64[count,m] spread over the corners of a polyline float[k,m], the ends included."""
    profile = np.asarray(profile, np.float64)
    at = (len(profile) - 1) * np.arange(count) / (count - 1)
    first = np.minimum(at.astype(np.int64), len(profile) - 2)
    return profile[first] + (at - first)[:, None] * (profile[first + 1] - profile[first])


def sphere(radius: float = 1.0, rings: int = 8, sides: int = 16, centre=(0, 0, 0)) -> np.ndarray:
    """A closed sphere of 2*sides*(rings-1) triangles."""
    angle = PI * np.arange(rings + 1) / rings
    profile = np.stack([radius * sin(angle), -radius * cos(angle)], axis=1)
    profile[[0, -1], 0] = 0
    return revolve(profile, sides) + np.asarray(centre, np.float64)


def torus(ring: float, radius: float, segments: int, sides: int) -> np.ndarray:
    """A closed torus about the y axis: `ring` radius of its middle line; 2*segments*sides triangles."""
    angle = TURN * np.arange(segments) / segments
    curve = np.stack([ring * cos(angle), np.zeros(segments), ring * sin(angle)], axis=1)
    return tubes(curve, radius, sides, closed=True)


def extrude(profile: np.ndarray, along, closed: bool = True) -> np.ndarray:
    """The side walls of a float[m,3] outline moved along float[3]: 2*m triangles, 2*(m-1) if open."""
    profile = np.asarray(profile, np.float64)
    return grid(np.stack([profile, profile + np.asarray(along, np.float64)]), wrap_columns=closed)


def fan(outline: np.ndarray) -> np.ndarray:
    """A flat star-shaped polygon float[m,3] as m triangles about its mean point."""
    outline = np.asarray(outline, np.float64)
    middle = np.broadcast_to(outline.sum(axis=0) / len(outline), outline.shape)
    return np.stack([middle, outline, np.roll(outline, -1, axis=0)], axis=1)


def tubes(curves: np.ndarray, radius=1.0, sides: int = 6, closed: bool = False) -> np.ndarray:
    """Open-ended tubes along one polyline float[m,3] or many float[k,m,3], curve by curve.

    `radius` broadcasts to float[k,m]. 2*sides*(m-1) triangles a curve, 2*sides*m if `closed` joins the last
    point to the first. Neighbouring points of a curve must differ.
    """
    curves = np.asarray(curves, np.float64)
    curves = curves[None] if curves.ndim == 2 else curves
    radius = np.broadcast_to(np.asarray(radius, np.float64), curves.shape[:2])
    normal, binormal = _frames(curves, closed)
    angle = TURN * np.arange(sides) / sides
    points = np.empty((*curves.shape[:2], sides, 3))
    for side in range(sides):
        spoke = cos(angle[side]) * normal + sin(angle[side]) * binormal
        points[:, :, side] = curves + radius[..., None] * spoke
    return grid(points, wrap_rows=closed, wrap_columns=True)


def _frames(curves: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Normals and binormals float64[k,m,3], carried along without twist; a closed curve spreads what is left."""
    if closed:
        tangent = np.roll(curves, -1, axis=1) - np.roll(curves, 1, axis=1)
    else:
        tangent = np.gradient(curves, axis=1)
    tangent = unit(tangent)
    steep = np.abs((tangent[:, 0] * _REFERENCES[0]).sum(axis=-1)) > 0.9
    carried = np.where(steep[:, None], _REFERENCES[1], _REFERENCES[0])
    normal = np.empty_like(curves)
    for step in range(curves.shape[1]):
        carried = _across(carried, tangent[:, step])
        normal[:, step] = carried
    binormal = np.cross(tangent, normal)
    if closed:
        last = _across(carried, tangent[:, 0])
        sine, cosine = (last * binormal[:, 0]).sum(axis=1), (last * normal[:, 0]).sum(axis=1)
        part = np.linspace(0, 1, curves.shape[1], endpoint=False)[:, None]
        turn = -arctan2(sine, cosine)[:, None, None] * part
        normal, binormal = (
            cos(turn) * normal + sin(turn) * binormal,
            cos(turn) * binormal - sin(turn) * normal,
        )
    return normal, binormal


def _across(vectors: np.ndarray, tangents: np.ndarray) -> np.ndarray:
    """Unit vectors: float64[k,3] without their part along unit tangents."""
    return unit(vectors - (vectors * tangents).sum(axis=-1, keepdims=True) * tangents)


def unit(vectors: np.ndarray) -> np.ndarray:
    """float[...,3] over their lengths."""
    return vectors / np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))


# ---------------------------------------------------------------- measures


def areas(triangles: np.ndarray) -> np.ndarray:
    """float64[n], the area of each triangle."""
    edges = np.asarray(triangles, np.float64)[:, 1:] - np.asarray(triangles, np.float64)[:, :1]
    return np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2


def generator(seed: int, stream: int = 0) -> np.random.Generator:
    """The random numbers of a stand-in: Philox, alike on every machine; another `stream`, other numbers."""
    return np.random.Generator(np.random.Philox(key=[seed, stream]))
