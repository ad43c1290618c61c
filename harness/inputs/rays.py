"""Ray sets, seeded: the same bits for every tracer and for Embree.

Directions use only additions, products, quotients and square roots, which IEEE arithmetic rounds alike
everywhere.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from harness.data import Rays, Scene, View
from harness.errors import DefrayError, known
from harness.reference.embree_scene import EmbreeScene

OCCLUSION_REACH = 0.1  # length of an ambient-occlusion ray over the scene's diagonal
PIECE = 1 << 20  # rays made at a time: making them takes 400 bytes a ray, keeping them 28
EMPTY_PASSES = 8  # passes over the image without a hit before a view is called empty
# Wächter & Binder 2019, "A Fast and Robust Method for Avoiding Self-Intersection", Ray Tracing Gems 6.
_OFFSET_ORIGIN = np.float32(1 / 32)
_OFFSET_FLOAT = np.float32(1 / 65536)
_OFFSET_INTEGER = np.float32(256)


def make_rays(
    scene: Scene,
    kind: str,
    count: int,
    seed: int = 1,
    view: str | None = None,
    ray_file: str | None = None,
    embree: EmbreeScene | None = None,
) -> Rays:
    """`count` rays of a kind: primary, diffuse, ambient-occlusion, random or file.

    `view` names one of the scene's views (the first without it). `embree` saves building the hierarchy that
    finds the primary hits. Raises DefrayError for an unknown kind or view, an empty view, a bad ray file, zero
    rays, or a ray that has no direction.
    """
    if count < 1:
        raise DefrayError("at least one ray is needed, not zero")
    makers: dict[str, Callable[[], Rays]] = {
        "primary": lambda: primary_rays(find_view(scene, view), count, seed),
        "diffuse": lambda: _bounced(scene, kind, count, seed, view, embree),
        "ambient-occlusion": lambda: _bounced(scene, kind, count, seed, view, embree),
        "random": lambda: random_rays(scene, count, seed),
        "file": lambda: read_rays(ray_file, count),
    }
    if kind not in makers:
        raise known("kind of rays", kind, makers)
    return checked(makers[kind]())


def checked(rays: Rays, where: str = "") -> Rays:
    """The rays themselves; raises DefrayError naming the first without a finite origin or direction."""
    if not len(rays):
        raise DefrayError(f"{where}at least one ray is needed, not zero")
    finite = np.isfinite(rays.origins).all(axis=1) & np.isfinite(rays.directions).all(axis=1)
    if not finite.all():
        raise DefrayError(f"{where}ray {int(np.argmin(finite))} has an origin or direction that is not finite")
    moving = rays.directions.any(axis=1)
    if not moving.all():
        raise DefrayError(f"{where}ray {int(np.argmin(moving))} has a direction of zero length")
    limited = rays.t_max >= 0
    if not limited.all():
        raise DefrayError(f"{where}ray {int(np.argmin(limited))} has a negative t_max or one that is not a number")
    return rays


def find_view(scene: Scene, name: str | None) -> View:
    """A view by name, the first without one."""
    if not scene.views:
        raise DefrayError(f"scene {scene.name} has no view")
    by_name = {view.name: view for view in scene.views}
    if name is None:
        return scene.views[0]
    if name not in by_name:
        raise known(f"view of {scene.name}", name, by_name)
    return by_name[name]


def image_rays(view: View, width: int, height: int, jitter: np.ndarray | None = None, first: int = 0) -> Rays:
    """One primary ray a pixel, rows from the top; `jitter` float64[n,2] in [0,1) within pixels (else centres), of the
    pixels from `first` on where it has fewer than the image.
    """
    eye, target, up = (np.array(v, np.float64) for v in (view.eye, view.target, view.up))
    forward = _unit(target - eye)
    right = _unit(np.cross(forward, up))
    above = np.cross(right, forward)
    half = np.tan(np.radians(view.fov_degrees) / 2)
    within = np.full((width * height, 2), 0.5) if jitter is None else jitter
    row, column = np.divmod(np.arange(first, first + len(within)), width)
    x = (2 * (column + within[:, 0]) / width - 1) * half * width / height
    y = (1 - 2 * (row + within[:, 1]) / height) * half
    directions = forward + x[:, None] * right + y[:, None] * above
    return _rays(np.broadcast_to(eye, directions.shape), _unit(directions), np.inf, "primary", 0)


def primary_rays(view: View, count: int, seed: int, turn: int = 0) -> Rays:
    """`count` jittered primary rays of a 4:3 image with about that many pixels, in rows."""
    return _joined(primary_pieces(view, count, seed, turn), count, "primary", seed)


def primary_pieces(view: View, count: int, seed: int, turn: int = 0) -> Iterator[Rays]:
    """The rays of `primary_rays`, PIECE at a time."""
    height = max(1, int(np.ceil(np.sqrt(count * 3 / 4))))
    width = -(-count // height)
    generator = np.random.Generator(np.random.Philox(key=[seed, turn]))
    for first in range(0, count, PIECE):
        rays = image_rays(view, width, height, generator.random((min(PIECE, count - first), 2)), first)
        yield Rays(rays.origins, rays.directions, rays.t_max, "primary", seed)


def _joined(pieces: Iterable[Rays], count: int, kind: str, seed: int) -> Rays:
    """The first `count` rays of all pieces."""
    parts = list(pieces)
    columns = (np.concatenate([getattr(p, n) for p in parts])[:count] for n in ("origins", "directions", "t_max"))
    return Rays(*columns, kind, seed)


def _bounced(scene: Scene, kind: str, count: int, seed: int, view_name: str | None, embree) -> Rays:
    """Diffuse or ambient-occlusion rays from the first hits of primary rays, pass after pass over the image."""
    view = find_view(scene, view_name)
    embree = embree or EmbreeScene(scene.triangles)
    parts, found, turn = [], 0, 0
    while found < count:
        points = SpherePoints(seed, turn)
        for primary in primary_pieces(view, count, seed, turn):
            part, _ = bounce(scene, primary, embree.trace(primary).primitive, kind, seed, points=points)
            parts.append(part)
            found += len(part)
            if found >= count:
                break
        turn += 1
        if turn >= EMPTY_PASSES and not found:
            raise DefrayError(f"view {view.name} of scene {scene.name} sees no triangle")
    return _joined(parts, count, kind, seed)


def bounce(
    scene: Scene,
    primary: Rays,
    primitive: np.ndarray,
    kind: str,
    seed: int,
    turn: int = 0,
    points: SpherePoints | None = None,
) -> tuple[Rays, np.ndarray]:
    """One ray from each primary hit, cosine-weighted about the normal that faces the eye, and int64[m], whose.

    `primitive` int32[n] of the primary rays, -1 = miss: those give no ray, nor do hits along the surface. The hit
    point is computed in float64. `points`: where directions come from, those of `seed` and `turn` without.
    """
    hit = np.flatnonzero(primitive >= 0)
    corners = scene.triangles[primitive[hit]].astype(np.float64)
    origin, direction = primary.origins[hit].astype(np.float64), primary.directions[hit].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.einsum("ij,ij->i", normal, direction)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.einsum("ij,ij->i", normal, corners[:, 0] - origin) / facing
        normal = _unit(normal * -np.sign(facing)[:, None])
        point = origin + t[:, None] * direction
    directions = normal + (points or SpherePoints(seed, turn)).take(len(hit))
    usable = np.isfinite(point).all(axis=1) & (np.abs(directions).max(axis=1) > 1e-6)
    point, normal, directions = point[usable], normal[usable], directions[usable]
    reach = np.inf
    if kind == "ambient-occlusion":
        reach = OCCLUSION_REACH * float(np.linalg.norm(np.ptp(scene.triangles.reshape(-1, 3), axis=0)))
    origins = offset_origin(point.astype(np.float32), normal.astype(np.float32))
    return _rays(origins, _unit(directions), reach, kind, seed), hit[usable]


class SpherePoints:
    """Points uniform on the unit sphere, in an endless sequence (Marsaglia 1972, which needs no sine)."""

    def __init__(self, seed: int, turn: int = 0):
        self._generator = np.random.Generator(np.random.Philox(key=[seed, (1 << 32) + turn]))
        self._left = np.empty((0, 2))

    def take(self, count: int) -> np.ndarray:
        """float64[count,3], the next points: the same whether taken at once or piece by piece."""
        points = self._left
        while len(points) < count:
            square = 2 * self._generator.random((count - len(points) + 64, 2)) - 1
            points = np.concatenate([points, square[(square**2).sum(axis=1) < 1]])
        self._left = points[count:].copy()
        a, b = points[:count, 0], points[:count, 1]
        s = a * a + b * b
        root = 2 * np.sqrt(1 - s)
        return np.stack([a * root, b * root, 1 - 2 * s], axis=1)


def sphere_points(count: int, seed: int, turn: int = 0) -> np.ndarray:
    """float64[count,3], uniform on the unit sphere."""
    return SpherePoints(seed, turn).take(count)


def offset_origin(point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Move float32[n,3] points off a surface along float32[n,3] unit normals (Wächter & Binder 2019)."""
    steps = (_OFFSET_INTEGER * normal).astype(np.int32)
    moved = (point.view(np.int32) + np.where(point < 0, -steps, steps)).view(np.float32)
    near = np.abs(point) < _OFFSET_ORIGIN
    return np.where(near, point + _OFFSET_FLOAT * normal, moved).astype(np.float32)


def random_rays(scene: Scene, count: int, seed: int) -> Rays:
    """Origins uniform in the scene's bounds, directions uniform on the sphere."""
    corners = scene.triangles.reshape(-1, 3).astype(np.float64)
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    generator = np.random.Generator(np.random.Philox(key=[seed, 2 << 32]))
    origins = lower + generator.random((count, 3)) * (upper - lower)
    return _rays(origins, sphere_points(count, seed), np.inf, "random", seed)


def read_rays(path: str | None, count: int | None = None) -> Rays:
    """Rays from `.npz` (origins, directions, optional t_max) or raw little-endian 6 x float32 a ray."""
    if not path:
        raise DefrayError("rays of kind 'file' need a file: --ray-file PATH")
    file = Path(path)
    if not file.is_file():
        raise DefrayError(f"ray file {path} does not exist")
    try:
        rays = _read_npz(file) if file.suffix == ".npz" else _read_raw(file)
    except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile) as error:
        raise DefrayError(f"ray file {path} cannot be read: {error}") from error
    return checked(rays[:count] if count else rays, f"{path}: ")


def _read_npz(file: Path) -> Rays:
    if not zipfile.is_zipfile(file):
        raise ValueError("it is no .npz archive")
    with np.load(file) as data:
        missing = [name for name in ("origins", "directions") if name not in data]
        if missing:
            raise ValueError(f"array '{missing[0]}' is missing")
        origins, directions = data["origins"], data["directions"]
        if origins.shape != directions.shape or origins.shape[1:] != (3,):
            raise ValueError(f"origins {origins.shape} and directions {directions.shape} must both be [n,3]")
        t_max = data.get("t_max", np.inf)
        if np.ndim(t_max) and np.shape(t_max) != origins.shape[:1]:
            raise ValueError(f"t_max {np.shape(t_max)} must be [n]")
    return _rays(origins, directions, t_max, "file", 0)


def _read_raw(file: Path) -> Rays:
    if file.stat().st_size % 24:
        raise ValueError(f"{file.stat().st_size} bytes are no whole number of rays of 24 bytes")
    values = np.fromfile(file, "<f4").reshape(-1, 6)
    return _rays(values[:, :3], values[:, 3:], np.inf, "file", 0)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors over their lengths, without the square overflowing."""
    largest = np.abs(vectors).max(axis=-1, keepdims=True)
    scaled = vectors / largest
    return scaled / np.sqrt((scaled * scaled).sum(axis=-1, keepdims=True))


def _rays(origins, directions, t_max, kind: str, seed: int) -> Rays:
    origins = np.ascontiguousarray(origins, np.float32)
    limit = np.ascontiguousarray(np.broadcast_to(np.asarray(t_max, np.float32), len(origins)))
    return Rays(origins, np.ascontiguousarray(directions, np.float32), limit, kind, seed)
