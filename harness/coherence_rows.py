"""Rows of `coherence.jsonl`: how well the rays of one scene and grid share vectors of 8 and 32 lanes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from harness.accuracy_rows import checked_row
from harness.record import RecordFile
from harness.record_schema import GridFacts, Part, Provenance, RayFacts

SCHEMA = 2
FILE = "coherence.jsonl"


class CoherenceCounts(Part):
    """The fields of `harness.coherence.Coherence`, exact integers."""

    model: Literal["forward", "deferred", "deferred-packed"]
    lanes: int = Field(gt=0)
    steps: int = Field(ge=0)
    step_trips: int = Field(ge=0)
    uneven_step_trips: int = Field(ge=0)
    tests: int = Field(ge=0)
    test_trips: int = Field(ge=0)
    uneven_test_trips: int = Field(ge=0)
    line_trips: int = Field(ge=0)
    line_tests: int = Field(ge=0)
    lines_64: int = Field(ge=0)
    lines_128: int = Field(ge=0)

    @model_validator(mode="after")
    def _lanes_bound_the_work(self) -> CoherenceCounts:
        for work, trips, uneven in (
            (self.steps, self.step_trips, self.uneven_step_trips),
            (self.tests, self.test_trips, self.uneven_test_trips),
            (self.line_tests, self.line_trips, 0),
        ):
            if not trips <= work <= self.lanes * trips or uneven > trips:
                raise ValueError("a trip works on one lane at least and on all at most")
        return self


class CoherenceRow(Provenance):
    """One scene, grid and set of rays. `wave`: non-empty cells a ray of the deferred tracer."""

    intersector: str
    wave: int = Field(gt=0)
    grid: GridFacts
    rays: RayFacts
    counts: list[CoherenceCounts] = Field(min_length=1)


def coherence_row(row: Any, where: str) -> dict:
    """`row` in the schema's key order; raises DefrayError naming `where` and the first bad key."""
    return checked_row(CoherenceRow, SCHEMA, row, where)


def coherence_file(folder: Path, **options) -> RecordFile:
    """The rows of a folder as an append-only file; `options` as RecordFile takes them."""
    return RecordFile(Path(folder) / FILE, validate=coherence_row, **options)
