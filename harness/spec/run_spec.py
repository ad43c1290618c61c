"""What one run is: scene, rays, grid, tracer, intersector and options, before anything is loaded."""

from __future__ import annotations

import hashlib
import json
import os
import re
from fractions import Fraction
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_serializer, field_validator

from harness.errors import DefrayError
from harness.spec.structure import StructureSpec, structure_spec

STAND_IN = "-stand-in"  # ends the name of a real scene's stand-in, where both are named
SIZES = {text: Fraction(text) for text in ("1/64", "1/16", "1/4", "1", "4")}


def split_size(name: str) -> tuple[str, str]:
    """`crown@1/4` as `("crown", "1/4")`; a name without a size has size `1`. Raises DefrayError for another size."""
    base, mark, size = name.rpartition("@")
    if not mark or os.path.lexists(name):  # a file may have an @ in its name
        return name, "1"
    if size not in SIZES:
        if not re.fullmatch(r"[0-9./]+", size):
            return name, "1"
        raise DefrayError(f"unknown size '{size}' in '{name}'; known: {', '.join(SIZES)}")
    return base, size


UNITS = {"": 1, "k": 1_000, "M": 1_000_000, "G": 1_000_000_000}


def parse_count(text: str | int) -> int:
    """`64k`, `1M`, `2.5M`, `1_000_000` or a number as an integer; decimal units: 1M is 1,000,000."""
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)([kKmMgG]?)", str(text).strip().replace("_", "").replace(",", ""))
    if not match:
        raise DefrayError(f"'{text}' is not a count; write 64k, 1M or 1000000")
    unit = "k" if match[2] in "kK" and match[2] else match[2].upper()
    count = Fraction(match[1]) * UNITS[unit]
    if count.denominator != 1:
        raise DefrayError(f"'{text}' is not a count: not a whole number")
    if count <= 0:
        raise DefrayError(f"a count must be above zero, not '{text}'")
    return int(count)


MOST_RAYS = 1_000_000_000  # a ray set is kept in memory, 28 bytes a ray
RAY_KINDS = ("primary", "diffuse", "ambient-occlusion", "random", "file")
Check = Literal["embree", "exact", "none"]


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
    """One run. `structure` of a tracer that walks none (`brute`, `embree`): that of the runs beside it, if any.

    A structure may be given as a spec, as its text or as its JSON; records and ids call it `grid`.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, populate_by_name=True, serialize_by_alias=True, arbitrary_types_allowed=True
    )

    scene: str
    variant: Variant
    structure: StructureSpec | None = Field(default=None, alias="grid")
    kind: str = "diffuse"
    rays: int = Field(default=1_000_000, gt=0, le=MOST_RAYS)
    seed: int = Field(default=1, ge=0, lt=2**63)
    view: str | None = None
    ray_file: str | None = None
    repetitions: int = Field(default=3, gt=0)
    check: Check = "embree"

    @field_validator("structure", mode="before")
    @classmethod
    def _read_structure(cls, value):
        return None if value is None else structure_spec(value)

    @field_serializer("structure")
    def _structure_to_json(self, structure: StructureSpec | None) -> dict | None:
        return structure.to_json() if structure else None

    @property
    def group(self) -> tuple:
        """Runs with the same group share scene, rays and structure, and are measured interleaved."""
        return (*self.workload, self.structure)

    @property
    def workload(self) -> tuple:
        """Scene and rays."""
        return (self.scene, self.kind, self.rays, self.seed, self.view, self.ray_file)

    @property
    def id(self) -> str:
        """16 hex digits that name this run: equal specs, equal id."""
        text = json.dumps(self.model_dump(), sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
