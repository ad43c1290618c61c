"""One ray and one triangle: measured in float64, filtered with a proven error bound, decided in integers.

All inputs are float32. Every finite float32 is a whole multiple of 2^-149, so scaled by 2^149 the predicates
are integer arithmetic: no rounding, no tolerance, never undecided.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

_SCALE = 2.0**149  # makes every finite float32 an integer; the product is exact in float64
_CHUNK = 1 << 18  # triangles handled at once where a whole mesh is scanned
# An edge function in float64 takes 7 roundings a term and 6 terms: 42 * 2^-53, rounded up generously.
_EDGE_ERROR = 2.0**-47
_ULP = 2.0**-24  # half the spacing of float32 at 1: the relative rounding error of one operation


def integers(values: np.ndarray) -> list[int]:
    """The values of a finite float32 array times 2^149, flattened, as Python integers."""
    return [int(value) for value in (np.asarray(values, np.float64).ravel() * _SCALE)]


def exact_hit(triangle, origin, direction, t_max) -> Fraction | None:
    """Exact t of one ray with one closed triangle, or None.

    `triangle` float32[3,3], `origin`, `direction` float32[3], `t_max` a float32 (inf allowed). A hit has
    0 < t <= t_max; edges and vertices belong to the triangle; a coplanar ray never hits, and nothing hits a
    zero-area triangle.
    """
    if not (np.isfinite(triangle).all() and np.isfinite(origin).all() and np.isfinite(direction).all()):
        return None
    ox, oy, oz = integers(origin)
    dx, dy, dz = integers(direction)
    ax, ay, az, bx, by, bz, cx, cy, cz = integers(triangle)
    ax, ay, az, bx, by, bz, cx, cy, cz = (
        ax - ox, ay - oy, az - oz, bx - ox, by - oy, bz - oz, cx - ox, cy - oy, cz - oz,
    )  # fmt: skip
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    edge_a = dx * nx + dy * ny + dz * nz
    edge_b = dx * (cy * az - cz * ay) + dy * (cz * ax - cx * az) + dz * (cx * ay - cy * ax)
    edge_c = dx * (ay * bz - az * by) + dy * (az * bx - ax * bz) + dz * (ax * by - ay * bx)
    if min(edge_a, edge_b, edge_c) < 0 < max(edge_a, edge_b, edge_c):
        return None
    determinant = edge_a + edge_b + edge_c
    if determinant == 0:
        return None
    t = Fraction(ax * nx + ay * ny + az * nz, determinant)
    inside = t > 0 and (t_max == np.inf or (t_max > 0 and t <= Fraction(float(t_max))))
    return t if inside else None


def may_hit(triangles: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """bool[m]: False only where two edge functions certainly have opposite signs, so the ray's line misses.

    `triangles` float32[m,3,3], `origin`, `direction` float32[3]. Float64 with a proven bound: a triangle that
    the exact test hits is never dropped.
    """
    corners = np.ascontiguousarray(triangles.transpose(1, 2, 0), np.float64)
    corners -= np.asarray(origin, np.float64)[None, :, None]
    dx, dy, dz = (float(value) for value in direction)
    size = np.abs(corners).max(axis=1)
    size *= np.sqrt(_EDGE_ERROR * max(abs(dx), abs(dy), abs(dz)))
    positive = negative = False
    for i, j in ((1, 2), (2, 0), (0, 1)):
        (ax, ay, az), (bx, by, bz) = corners[i], corners[j]
        edge = dx * (ay * bz - az * by) + dy * (az * bx - ax * bz) + dz * (ax * by - ay * bx)
        bound = size[i] * size[j]
        positive = positive | (edge > bound)
        negative = negative | (edge < -bound)
    return ~(positive & negative)


def zero_area(triangles: np.ndarray) -> np.ndarray:
    """bool[n]: triangles of exactly zero area; `triangles` float32[n,3,3]. Non-finite ones count as such."""
    result = np.zeros(len(triangles), bool)
    for first in range(0, len(triangles), _CHUNK):
        part = triangles[first : first + _CHUNK]
        flat = result[first : first + _CHUNK]
        p, q, r = part[:, 0], part[:, 1], part[:, 2]
        flat |= ~np.isfinite(part).all(axis=(1, 2))
        flat |= (p == q).all(axis=1) | (q == r).all(axis=1) | (r == p).all(axis=1)
        for row in np.flatnonzero(_may_be_flat(part) & ~flat):
            flat[row] = _is_flat(part[row])
    return result


def _may_be_flat(triangles: np.ndarray) -> np.ndarray:
    """bool[m]: True wherever the cross product of the edges could be exactly zero."""
    with np.errstate(invalid="ignore"):
        base = triangles[:, 0].astype(np.float64)
        ux, uy, uz = (triangles[:, 1] - base).T
        vx, vy, vz = (triangles[:, 2] - base).T
        flat = True
        for a, b, c, d in ((uy, vz, uz, vy), (uz, vx, ux, vz), (ux, vy, uy, vx)):
            left, right = a * b, c * d
            flat = flat & (np.abs(left - right) <= 2.0**-49 * (np.abs(left) + np.abs(right)))
    return flat


def _is_flat(triangle: np.ndarray) -> bool:
    """Whether one finite triangle float32[3,3] has exactly zero area."""
    px, py, pz, qx, qy, qz, rx, ry, rz = integers(triangle)
    ux, uy, uz, vx, vy, vz = qx - px, qy - py, qz - pz, rx - px, ry - py, rz - pz
    return uy * vz == uz * vy and uz * vx == ux * vz and ux * vy == uy * vx


@dataclass(frozen=True, eq=False)
class Measure:
    """How m rays lie to m triangles, one each, in float64[m].

    `ulp`: the local ulp, 2^-24 * max|vertex - origin|, in scene units. `t`: of the triangle's plane (NaN
    where the ray is parallel to it). `margin`, in ulp: by how much the ray truly hits, the least of its
    distances to the three edge lines, to t = 0 and to t = t_max; negative: by how much it misses; -inf for a
    zero-area triangle. `conditioned`: the same with each distance divided by the condition it has in float32,
    longest edge / (edge * sine of its angle with the ray), and `aspect` for the limits of t. `sine`: scene
    units off the plane per unit of t. `offset`: distance of the origin from the plane along the ray's side,
    scene units. `aspect`: longest edge squared over twice the area, 1.15 if equilateral, large for a sliver.
    """

    t: np.ndarray
    margin: np.ndarray
    conditioned: np.ndarray
    sine: np.ndarray
    offset: np.ndarray
    ulp: np.ndarray
    aspect: np.ndarray

    def residual(self, t: np.ndarray) -> np.ndarray:
        """Distance of the points at `t` from the plane in local ulp: well-conditioned at grazing too."""
        return np.abs(t * self.sine - self.offset) / self.ulp


def measure(triangles: np.ndarray, origins: np.ndarray, directions: np.ndarray, t_max: np.ndarray) -> Measure:
    """Measure ray i against triangle i: float32[m,3,3], [m,3], [m,3], [m]."""
    with np.errstate(all="ignore"):
        corners = np.ascontiguousarray(triangles.transpose(1, 2, 0), np.float64)
        corners -= np.ascontiguousarray(origins.T, np.float64)
        ray = np.ascontiguousarray(directions.T, np.float64)
        edges = [corners[(k + 1) % 3] - corners[k] for k in range(3)]
        ulp = _ULP * np.sqrt(np.max([_dot(corner, corner) for corner in corners], axis=0))
        normal = _cross(edges[0], edges[1])
        length = np.sqrt(_dot(normal, normal))
        slope = _dot(normal, ray) / length
        sine, offset = np.abs(slope), _dot(normal, corners[0]) * np.sign(slope) / length
        longest = np.max([_dot(edge, edge) for edge in edges], axis=0)
        aspect = longest / length
        limit = np.asarray(t_max, np.float64)
        along = np.minimum(offset, np.where(np.isinf(limit), np.inf, limit * sine - offset))
        plain, conditioned = _inside(corners, edges, ray, np.sqrt(longest))
        margin = np.minimum(plain, along) / ulp
        conditioned = np.minimum(conditioned, along / aspect) / ulp
        flat = ~(length > 0) | np.isnan(margin)
        margin[flat] = conditioned[flat] = -np.inf
        t = np.where(sine > 0, offset / sine, np.nan)
        t[~np.isfinite(t)] = np.nan
    return Measure(t, margin, conditioned, sine, offset, ulp, aspect)


def _inside(corners, edges, ray, longest) -> tuple[np.ndarray, np.ndarray]:
    """Distance of the ray's line inside the nearest edge line, scene units: plain and by condition."""
    speed = np.sqrt(_dot(ray, ray)) * longest
    plain, conditioned = [], []
    for corner, edge in zip(corners, edges, strict=True):
        moment = _cross(ray, edge)
        volume, across = _dot(corner, moment), np.sqrt(_dot(moment, moment))
        plain.append(np.where(across > 0, volume / across, 0.0))
        conditioned.append(volume / speed)
    # whichever orientation the ray sees
    return tuple(np.maximum(np.min(sides, axis=0), -np.max(sides, axis=0)) for sides in (plain, conditioned))


def _dot(a, b) -> np.ndarray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a, b) -> tuple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
