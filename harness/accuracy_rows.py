"""Rows of `accuracy.jsonl`: the rate of one variant on one scene, and its errors beside it.

Unlike a record, a row of a variant that is known to be inaccurate has a rate; a rate without errors does not exist.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from harness.data import CLASSES
from harness.digest import check_schema
from harness.errors import DefrayError
from harness.machines import key_of
from harness.record import RecordFile, first_problem
from harness.record_schema import Agreement, Part, Provenance, Rate, RayFacts, RelativeError

SCHEMA = 2  # 1 had no digests; `defray migrate` brings it here
FILE = "accuracy.jsonl"
PRECISION_FILE = "precision.jsonl"


class GridPlace(Part):
    """Resolution of the grid, as `harness.data.GridSpec` has it."""

    top: int
    leaf: int
    reading: str
    density: float | None = None


class AimedCounts(Part):
    """Aimed rays traced, those let through, and those of them aimed at vertices; see `harness/aimed.py`.

    A variant is given no more rays once it has leaked a thousand. `seed`: of the rays.
    """

    rays: int = Field(gt=0)
    leaks: int = Field(ge=0)
    at_vertices: int = Field(ge=0)
    vertex_leaks: int = Field(ge=0)
    seed: int

    @model_validator(mode="after")
    def _parts_of_the_whole(self) -> AimedCounts:
        edges, edge_leaks = self.rays - self.at_vertices, self.leaks - self.vertex_leaks
        if self.vertex_leaks > self.at_vertices or not 0 <= edge_leaks <= edges:
            raise ValueError("more leaks than rays")
        return self


class AccuracyRow(Provenance):
    """One variant on one scene.

    `variant` names tracer, intersector, options and binning in one text. `seconds`: from diffuse rays to hits, each
    repetition; `rate`: rays a second. `t_error`: of the diffuse rays' t, relative to the plane of the triangle that
    was hit, in float64; `residual_p99_ulp`: the same as a distance from the plane, in local ulp. `distance_rmse`:
    of the hit distance against the reference, over the scene's diagonal, at which a miss is counted.
    """

    variant: str
    tracer: str
    intersector: str | None
    contraction: Literal["off", "on"] | None
    options: dict[str, str]
    grid: GridPlace | None
    binning: str | None
    rays: RayFacts
    repetitions: int = Field(gt=0)
    seconds: list[float] = Field(min_length=1)
    rate: Rate
    aimed: AimedCounts
    t_error: RelativeError
    residual_p99_ulp: float | None
    distance_rmse: float = Field(ge=0)
    agreement: Agreement
    valid: bool

    @model_validator(mode="after")
    def _no_rate_without_errors(self) -> AccuracyRow:
        if self.agreement.reference not in ("embree", "exact"):
            raise ValueError("a rate needs hits that were compared with a reference")
        if sum(getattr(self.agreement, name) for name in CLASSES) != self.rays.count:
            raise ValueError("the classes of agreement must add up to the rays")
        if len(self.seconds) != self.repetitions:
            raise ValueError("there must be a time for each repetition")
        return self


def accuracy_row(row: Any, where: str) -> dict:
    """`row` in the schema's key order; raises DefrayError naming `where` and the first bad key."""
    return checked_row(AccuracyRow, SCHEMA, row, where)


def checked_row(model: type[Part], schema: int, row: Any, where: str) -> dict:
    """`row` as `model`, a Part with a key `schema`, has it; raises DefrayError naming `where` and the bad key."""
    if not isinstance(row, dict):
        raise DefrayError(f"{where}: not a JSON object")
    check_schema(row, schema, where)
    try:
        return model.model_validate(row).model_dump(mode="json", by_alias=True)
    except ValidationError as error:
        raise DefrayError(f"{where}: {first_problem(error)}") from None


def accuracy_file(folder: Path, **options) -> RecordFile:
    """The rows of a folder as an append-only file; `options` as RecordFile takes them."""
    return RecordFile(Path(folder) / FILE, validate=accuracy_row, **options)


class PrecisionRow(Provenance):
    """Error and rate of one value of one knob on one scene: how much accuracy a rate costs.

    `knob`: `grid` (leaf cells an axis), `precision` (`half` vertices, `float`, `double` intersector) or `samples`
    (occlusion rays a pixel). `error`: of the first two the root mean square error of the hit distance over the
    scene's diagonal; of `samples`, and in `image_error` of `precision`, that of an ambient occlusion image, of which
    1 is white, against one with many rays a pixel. `differing`: rays that hit another triangle than the reference.
    `rays`: behind `rate`.
    """

    knob: Literal["grid", "precision", "samples"]
    value: str
    variant: str
    rays: int = Field(gt=0)
    seconds: list[float] = Field(min_length=1)
    rate: Rate
    error: float = Field(ge=0)
    image_error: float | None = Field(default=None, ge=0)
    differing: int | None = Field(default=None, ge=0)


def precision_row(row: Any, where: str) -> dict:
    """`row` in the schema's key order; raises DefrayError naming `where` and the first bad key."""
    return checked_row(PrecisionRow, SCHEMA, row, where)


def precision_file(folder: Path, **options) -> RecordFile:
    """The precision rows of a folder as an append-only file; `options` as RecordFile takes them."""
    return RecordFile(Path(folder) / PRECISION_FILE, validate=precision_row, **options)


def identity(**facts: Any) -> str:
    """16 hex digits that name a row by what was measured: equal facts, equal id."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()[:16]


def latest_rows(rows: list[dict]) -> list[dict]:
    """The last row of each measurement on each machine and geometry: one measured again replaces the earlier one."""
    return list({(row["id"], key_of(row["machine"]), *source_of(row["scene"])): row for row in rows}.values())


def source_of(scene: dict) -> tuple[str, str]:
    """What tells a scene from another of its name: real, stand-in or file, and the SHA-256 of its triangles."""
    return scene["source"], scene["sha256"]
