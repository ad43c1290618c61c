"""What every stored row says: its identity, where it comes from, on which scene; and how a row is read.

A row is a body, what the measuring side fills, with an origin (`harness.records.origin.finish`). Its class declares
every key: one that is missing or unknown is an error.
"""

from __future__ import annotations

import hashlib
import json
import re
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeVar

from pydantic import BeforeValidator, ConfigDict, Field, ValidationError, model_serializer, model_validator

from harness.data import Counters, Strict
from harness.errors import DefrayError, first_problem
from harness.records.digest import check_schema
from harness.spec.structure import GRID_READINGS

SCHEMA = 2  # of every file of rows
StoredType = TypeVar("StoredType", bound="Stored")


class Stored(Strict):
    """A part of a row, or a whole one; values are of the declared type, as JSON has it, never converted."""

    model_config = ConfigDict(strict=True, validate_by_name=True, validate_by_alias=True, serialize_by_alias=True)

    def as_json(self) -> dict[str, Any]:
        """Plain JSON types under the keys that files have, in their order."""
        return self.model_dump(mode="json", by_alias=True)


def checked(model: type[StoredType], row: Any, where: str, schema: int = SCHEMA) -> StoredType:
    """The JSON object `row` as `model` has it; raises DefrayError naming `where` and the first bad key."""
    if not isinstance(row, dict):
        raise DefrayError(f"{where}: not a JSON object")
    check_schema(row, schema, where)
    try:
        return model.model_validate(row)
    except ValidationError as error:
        raise DefrayError(f"{where}: {first_problem(error)}") from None


class MachineKey(NamedTuple):
    """What tells one machine from another: processor, cores, OpenCL platform and device."""

    cpu: str | None
    cores: int | None
    platform: str | None
    device: str | None

    @classmethod
    def read(cls, machine: dict) -> Self:
        """The key of a machine as JSON has it; what it does not say is None."""
        return cls(*(machine.get(name) for name in cls._fields))

    @property
    def file_name(self) -> str:
        """In names of files: the device or processor and four digits of the key, `pthread-amd-epyc-1f3c`."""
        words = re.sub(r"[^a-z0-9]+", "-", str(self.device or self.cpu or "machine").lower())
        return f"{words.strip('-')[:40].strip('-')}-{hashlib.sha256(json.dumps(self).encode()).hexdigest()[:4]}"

    @property
    def title(self) -> str:
        """For people: device, processor where the device does not name it, and cores."""
        parts = [
            self.device or "no OpenCL device",
            self.cpu if self.cpu and self.cpu not in (self.device or "") else "",
            f"{self.cores} cores" if self.cores else "",
            self.platform or "",
        ]
        return ", ".join(part for part in parts if part)

    def holds(self, other: MachineKey) -> bool:
        """Whether a row of `other` was measured here: on this device, or, without any device, on this processor."""
        return other == self or (other.device is None and other[:2] == self[:2])


class Machine(Stored):
    """Where a run was measured.

    `environment` holds the variables that steer OpenCL runtimes. `device`, `platform` and `driver` are None
    for a machine without OpenCL.
    """

    cpu: str
    cores: int
    memory_bytes: int | None = None
    os: str
    kernel: str | None = None
    governor: str | None = None
    device: str | None
    platform: str | None
    driver: str | None
    versions: dict[str, str | None]
    environment: dict[str, str] = Field(default_factory=dict)

    @property
    def key(self) -> MachineKey:
        """What tells it from another."""
        return MachineKey(self.cpu, self.cores, self.platform, self.device)


class SceneFacts(Stored):
    """The scene's name, `real`, `stand-in` or `file`, the SHA-256 of its triangles, and how views were found."""

    name: str
    source: str
    triangles: int
    sha256: str
    views: str = ""

    @property
    def geometry(self) -> tuple[str, str]:
        """What tells it from another scene of its name."""
        return self.source, self.sha256

    @property
    def is_stand_in(self) -> bool:
        """Whether generated geometry stands in for the original's."""
        return self.source == "stand-in"


class RayFacts(Stored):
    """Kind, number and seed of the rays."""

    kind: str
    count: int
    seed: int


class StructurePlace(Stored):
    """Which structure it is.

    `reading`: how the paper's 128 is read, or the structure's name. `top`, `leaf`: of grids; `options`: of others.
    """

    optional: ClassVar[tuple[str, ...]] = ("top", "leaf", "options")  # keys that are of some structures alone

    top: int | None = None
    leaf: int | None = None
    reading: str
    options: dict[str, str] | None = None

    @model_validator(mode="after")
    def _grids_have_a_resolution(self) -> Self:
        for name in ("top", "leaf"):
            if self.reading in GRID_READINGS and getattr(self, name) is None:
                raise ValueError(f"missing key {name}")
        return self

    @model_serializer(mode="wrap")
    def _without_absent(self, serialize) -> dict:
        """Without the keys that are of some structures where they say nothing."""
        return {key: value for key, value in serialize(self).items() if key not in self.optional or value is not None}


class GridFacts(StructurePlace):
    """The structure and its size; `bytes` is the whole structure's, `build_seconds` wall clock.

    Of an adaptive grid alone: `density`, leaf cells wanted per triangle, and `resolution`, top cells along x, y, z.
    Of one that was chosen: why, the seconds of choosing and of building the grid on trial (0: it is the one chosen).
    """

    optional: ClassVar[tuple[str, ...]] = (
        *StructurePlace.optional,
        *("density", "resolution", "chosen", "choosing_seconds", "trial_build_seconds"),
    )

    cells: int
    nonempty: int
    references: int
    bytes: int
    build_seconds: float
    density: float | None = None
    resolution: list[int] | None = None
    chosen: str | None = None
    choosing_seconds: float | None = None
    trial_build_seconds: float | None = None


def every_key(model: type[Strict]) -> BeforeValidator:
    """A stored `model` has all of its keys, those with a default too."""

    def whole(value: Any) -> Any:
        lacking = sorted(set(model.model_fields) - set(value)) if isinstance(value, dict) else ()
        if lacking:
            raise ValueError(f"missing key {lacking[0]}")
        return value

    return BeforeValidator(whole)


StoredCounters = Annotated[Counters, every_key(Counters)]


class Body(Stored):
    """What a measurement yields, still without identity and origin."""

    schema_: int = Field(default=SCHEMA, alias="schema")
    scene: SceneFacts


class Row(Stored):
    """What every stored row says of itself: schema, identity, when, by which command of which commit, where."""

    schema_: int = Field(default=SCHEMA, alias="schema")
    id: str
    time_utc: str
    command: str
    commit: str
    dirty: bool
    machine: Machine
    scene: SceneFacts

    @property
    def measurement(self) -> tuple:
        """What a later row replaces: the same measurement on the same machine and geometry."""
        return self.id, self.machine.key, *self.scene.geometry
