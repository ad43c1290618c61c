"""Rows of `accuracy.jsonl`: the rate of one variant on one scene, and its errors beside it.

Unlike a record, a row of a variant that is known to be inaccurate has a rate; a rate without errors does not exist.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from harness.data import CLASSES
from harness.records.agreement import RelativeError, StoredAgreement
from harness.records.record_file import RecordFile
from harness.records.schema import Body, RayFacts, Row, Stored, StructurePlace
from harness.stats import Interval

FILE = "accuracy.jsonl"


class GridPlace(StructurePlace):
    """The structure that was asked for."""

    density: float | None = None


class AimedCounts(Stored):
    """Aimed rays traced, those let through, and those of them aimed at vertices; see `harness/inputs/aimed_rays.py`.

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


class AccuracyBody(Body):
    """One variant on one scene, as measured.

    `variant` names tracer, intersector, options and overlap test in one text. `seconds`: from diffuse rays to hits,
    each repetition; `rate`: rays a second. `t_error`: of the diffuse rays' t, relative to the plane of the triangle
    that was hit, in float64; `residual_p99_ulp`: the same as a distance from the plane, in local ulp.
    `distance_rmse`: of the hit distance against the reference, over the scene's diagonal, at which a miss is counted.
    """

    variant: str
    tracer: str
    intersector: str | None
    contraction: Literal["off", "on"] | None
    options: dict[str, str]
    grid: GridPlace | None
    overlap: str | None = Field(alias="binning")  # schema 2 calls the overlap test that, in variants' texts too
    rays: RayFacts
    repetitions: int = Field(gt=0)
    seconds: list[float] = Field(min_length=1)
    rate: Interval
    aimed: AimedCounts
    t_error: RelativeError
    residual_p99_ulp: float | None
    distance_rmse: float = Field(ge=0)
    agreement: StoredAgreement
    valid: bool

    @model_validator(mode="after")
    def _no_rate_without_errors(self) -> AccuracyBody:
        if not self.agreement.is_checked:
            raise ValueError("a rate needs hits that were compared with a reference")
        if sum(getattr(self.agreement, name) for name in CLASSES) != self.rays.count:
            raise ValueError("the classes of agreement must add up to the rays")
        if len(self.seconds) != self.repetitions:
            raise ValueError("there must be a time for each repetition")
        return self


class AccuracyRow(AccuracyBody, Row):
    """One variant on one scene, as stored."""


def accuracy_file(folder: Path, **options) -> RecordFile[AccuracyRow]:
    """The rows of a folder as an append-only file; `options` as RecordFile takes them."""
    return RecordFile(Path(folder) / FILE, AccuracyRow, **options)
