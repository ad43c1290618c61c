"""The data that flows through the pipeline: scene, grid, rays, hits, counters, timings.

Every array field states its dtype and shape. Nothing here imports another module of the package.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.errors import DefrayError

MISS = -1  # primitive index of a ray that hits nothing
STRICT = ConfigDict(extra="forbid", allow_inf_nan=False, revalidate_instances="always")
CLASSES = ("same", "tie", "t_off", "wrong", "missed", "phantom")  # of a hit beside the reference's


class Strict(BaseModel):
    """Base of all data that files hold: an undeclared key or a number that is not finite is an error.

    A part that was changed after it was made is checked again when it is put into a whole.
    """

    model_config = STRICT


@dataclass(frozen=True)
class View:
    """A pinhole camera. `eye`, `target` in scene units; `fov_degrees` is the vertical field of view."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov_degrees: float = 60.0
    name: str = "default"


@dataclass(frozen=True, eq=False)
class Scene:
    """Triangles and the views that show them.

    `triangles`: float32[n,3,3], vertex positions in scene units, numbering as in the source.
    `source`: `real`, `stand-in` or `file`. `sha256`: of the triangles' bytes (little-endian float32).
    `views_from`: where the views of a mesh file come from, for people; empty for known scenes.
    """

    name: str
    triangles: np.ndarray
    views: tuple[View, ...] = ()
    source: str = "file"
    sha256: str = ""
    licence: str = ""
    views_from: str = ""

    @property
    def title(self) -> str:
        """Name for people; a stand-in is called a stand-in."""
        return f"{self.name} (stand-in)" if self.source == "stand-in" else self.name

    def __len__(self) -> int:
        return len(self.triangles)


@dataclass(frozen=True, eq=False)
class Rays:
    """`origins`, `directions`: float32[n,3]; `t_max`: float32[n] in units of the direction's length."""

    origins: np.ndarray
    directions: np.ndarray
    t_max: np.ndarray
    kind: str = "file"
    seed: int = 0

    def __len__(self) -> int:
        return len(self.origins)

    def __getitem__(self, rows) -> Rays:
        """The rays selected by a slice or an index array."""
        return Rays(self.origins[rows], self.directions[rows], self.t_max[rows], self.kind, self.seed)


@dataclass(frozen=True, eq=False)
class Hits:
    """First hits: `t` float32[n] (inf = miss), `primitive` int32[n] (-1 = miss), `u`, `v` float32[n].

    The hit point is (1-u-v) v0 + u v1 + v v2.
    """

    t: np.ndarray
    primitive: np.ndarray
    u: np.ndarray
    v: np.ndarray

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, rows) -> Hits:
        return Hits(self.t[rows], self.primitive[rows], self.u[rows], self.v[rows])

    def tobytes(self) -> bytes:
        """All four arrays' bytes: equal exactly when the hits are equal bit for bit."""
        return b"".join(array.tobytes() for array in (self.t, self.primitive, self.u, self.v))


def differing(a: Hits, b: Hits) -> int:
    """Rays whose t or primitive differ in any bit."""
    return int(((a.t.view(np.int32) != b.t.view(np.int32)) | (a.primitive != b.primitive)).sum())


class Counters(Strict, strict=True):
    """Exact work counts of an instrumented build.

    `steps`: cells stepped through (empty or not, either level). `pairs`: ray-cell encounters stored or
    visited. `tests`: ray-triangle tests asked for. `lane_tests`: tests executed, idle lanes included.
    `waves`: intersection waves. `finished_per_wave`: rays that finished in each wave. `padding`: unused
    pair slots that fill bins up to a whole number of lanes.
    """

    steps: int = 0
    pairs: int = 0
    tests: int = 0
    lane_tests: int = 0
    waves: int = 0
    finished_per_wave: list[int] = Field(default_factory=list)
    padding: int = 0


class Samples(Strict, strict=True):
    """Seconds of each repetition, stage by stage; a stage that a tracer does not have stays empty.

    Stages are device time between event markers, waits of the host for a count included; `total` is wall clock
    from rays to hits on the device. Of the two-pass arrangement, both walks are `traverse`, packing included; of
    the recording one, ranking and scattering are `arrange`. Writing t, u and v is in the total alone.
    """

    traverse: list[float] = Field(default_factory=list)
    arrange: list[float] = Field(default_factory=list)
    intersect: list[float] = Field(default_factory=list)
    compact: list[float] = Field(default_factory=list)
    total: list[float] = Field(default_factory=list)


STAGES = ("traverse", "arrange", "intersect", "compact", "total")
LARGEST, SMALLEST = 1e12, 1e-12  # coordinates and extent: cubes of lengths must neither overflow nor vanish


def check_scale(triangles: np.ndarray, name: str = "the scene") -> None:
    """Raise DefrayError where float32 arithmetic on the triangles would overflow or vanish."""
    largest = float(np.abs(triangles).max())
    extent = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    if not largest <= LARGEST:  # not a number, too
        raise DefrayError(f"coordinates of {name} reach {largest:.3g}; scale it so that they stay below {LARGEST:g}")
    if 0 < extent < SMALLEST:
        raise DefrayError(f"{name} is only {extent:.3g} large; scale it up to at least {SMALLEST:g}")
