"""What one run is: scene, rays, grid, tracer, intersector and options, before anything is loaded."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_serializer, field_validator

from harness.data import AUTO, GridSpec
from harness.errors import DefrayError, known

READINGS = ("total", "per-cell", "adaptive")
MOST_RAYS = 1_000_000_000  # a ray set is kept in memory, 28 bytes a ray
MOST_TOP = 256  # cells per axis of the first level, which is stored whole
MOST_CELLS = 1 << 16  # leaf cells per axis; beyond, float32 cannot tell neighbours apart
MOST_ADAPTIVE_TOP = 512  # top cells along the longest axis of an adaptive grid
ADAPTIVE_LEAVES = (1, 2, 4, 8, 16, 32, 64, 128)
MOST_DENSITY = 1000
RAY_KINDS = ("primary", "diffuse", "ambient-occlusion", "random", "file")
Check = Literal["embree", "exact", "none"]


def check_grid(grid: GridSpec) -> GridSpec:
    """`grid` itself; raises DefrayError for a resolution that makes no grid."""
    if grid == AUTO:
        return grid
    if grid.reading not in READINGS:
        raise known("reading", grid.reading, READINGS)
    if grid.reading == "adaptive":
        return _check_adaptive(grid)
    if grid.density is not None:
        raise DefrayError(f"a density belongs to reading 'adaptive', not to '{grid.reading}'")
    if grid.top < 1 or grid.leaf < 1:
        raise DefrayError(f"a grid needs at least one cell per axis, not {grid.top}/{grid.leaf}")
    if grid.reading == "total" and grid.leaf % grid.top:
        below, above = grid.leaf // grid.top * grid.top, (grid.leaf // grid.top + 1) * grid.top
        fitting = f"{below} or {above}" if below else str(above)
        raise DefrayError(
            f"leaf {grid.leaf} is not a multiple of top {grid.top}, as reading 'total' needs; {fitting} would do"
        )
    if grid.top > MOST_TOP:
        raise DefrayError(f"a grid has at most {MOST_TOP} top cells per axis, not {grid.top}")
    if grid.resolution > MOST_CELLS:
        raise DefrayError(f"grid {grid} has {grid.resolution} leaf cells per axis; at most {MOST_CELLS} make sense")
    return grid


def _check_adaptive(grid: GridSpec) -> GridSpec:
    if not 0 <= grid.top <= MOST_ADAPTIVE_TOP:
        raise DefrayError(f"an adaptive grid has 0 (automatic) to {MOST_ADAPTIVE_TOP} top cells, not {grid.top}")
    if grid.leaf not in ADAPTIVE_LEAVES:
        allowed = ", ".join(map(str, ADAPTIVE_LEAVES))
        raise DefrayError(f"leaf of an adaptive grid must be one of {allowed}, not {grid.leaf}")
    if grid.density is not None and not 0 < grid.density <= MOST_DENSITY:
        raise DefrayError(f"density must be above 0 and at most {MOST_DENSITY}, not {grid.density}")
    return grid


class Variant(BaseModel):
    """A tracer with its intersector and options, written `tracer:intersector[:option=value...]`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    tracer: str
    intersector: str | None = None
    options: dict[str, str] = Field(default_factory=dict)

    @field_validator("options", mode="before")
    @classmethod
    def _as_text(cls, options):
        """A TOML `wave = 4` and a command-line `wave=4` are the same option."""
        return {str(k): str(v).lower() if isinstance(v, bool) else str(v) for k, v in dict(options).items()}

    @classmethod
    def parse(cls, text: str) -> Variant:
        """Read `deferred:ray-space:wave=4`; raises DefrayError for a malformed option."""
        tracer, *rest = text.split(":")
        intersector = rest.pop(0) if rest and "=" not in rest[0] else None
        options = {}
        for part in rest:
            key, equals, value = part.partition("=")
            if not equals or not key or not value:
                raise DefrayError(f"option '{part}' in '{text}' is not of the form option=value")
            options[key] = value
        return cls(tracer=tracer, intersector=intersector, options=options)

    def __str__(self) -> str:
        parts = [self.tracer] + ([self.intersector] if self.intersector else [])
        return ":".join(parts + [f"{key}={value}" for key, value in sorted(self.options.items())])


class RunSpec(BaseModel):
    """One run. `grid` of a tracer that uses none (`brute`, `embree`): that of the runs it stands beside, if any."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    scene: str
    variant: Variant
    grid: GridSpec | None = None
    kind: str = "diffuse"
    rays: int = Field(default=1_000_000, gt=0, le=MOST_RAYS)
    seed: int = Field(default=1, ge=0, lt=2**63)
    view: str | None = None
    ray_file: str | None = None
    repetitions: int = Field(default=3, gt=0)
    check: Check = "embree"

    @field_serializer("grid")
    def _without_default_density(self, grid: GridSpec | None) -> dict | None:
        """Without `density` where it is None: an id names the same run as before there was one."""
        if grid is None:
            return None
        return {key: value for key, value in asdict(grid).items() if key != "density" or value is not None}

    @property
    def group(self) -> tuple:
        """Runs with the same group share scene, rays and grid, and are measured interleaved."""
        return (*self.workload, self.grid)

    @property
    def workload(self) -> tuple:
        """Scene and rays."""
        return (self.scene, self.kind, self.rays, self.seed, self.view, self.ray_file)

    @property
    def id(self) -> str:
        """16 hex digits that name this run: equal specs, equal id."""
        text = json.dumps(self.model_dump(), sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
