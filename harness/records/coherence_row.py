"""Rows of `coherence.jsonl`: how well the rays of one scene and grid share vectors of 8 and 32 lanes."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from harness.records.record_file import RecordFile
from harness.records.schema import Body, GridFacts, RayFacts, Row, Stored

FILE = "coherence.jsonl"


class Coherence(Stored):
    """Exact counts of one model and width. A trip is `uneven` where not every lane takes part.

    `lines_64`, `lines_128`: distinct cache lines of triangles that each of `line_trips` trips loads, added up; these
    trips make `line_tests` tests, and are all of them unless there are too many.
    """

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
    def _lanes_bound_the_work(self) -> Coherence:
        for work, trips, uneven in (
            (self.steps, self.step_trips, self.uneven_step_trips),
            (self.tests, self.test_trips, self.uneven_test_trips),
            (self.line_tests, self.line_trips, 0),
        ):
            if not trips <= work <= self.lanes * trips or uneven > trips:
                raise ValueError("a trip works on one lane at least and on all at most")
        return self

    @property
    def walk_efficiency(self) -> float:
        """Share of lanes at work in a trip of the walk."""
        return self.steps / (self.lanes * self.step_trips) if self.step_trips else 0.0

    @property
    def test_efficiency(self) -> float:
        """Share of lanes at work in a trip of the tests."""
        return self.tests / (self.lanes * self.test_trips) if self.test_trips else 0.0

    @property
    def uneven_share(self) -> float:
        """Share of trips, of walk and tests together, in which not every lane takes part."""
        trips = self.step_trips + self.test_trips
        return (self.uneven_step_trips + self.uneven_test_trips) / trips if trips else 0.0

    def lines_a_trip(self, line: int) -> float:
        """Distinct cache lines of `line` bytes that a trip of the tests loads."""
        return getattr(self, f"lines_{line}") / self.line_trips if self.line_trips else 0.0


def predicted_ratios(counts: list[Coherence], lanes: int) -> dict[str, dict[str, float]]:
    """Cost of forward tests over that of the other models, by model: in `trips`, which is the ratio of times where
    the tests are bound by instructions, and in 64-byte `lines`, where by loads of triangles."""
    here = {one.model: one for one in counts if one.lanes == lanes and one.test_trips}
    forward = here.pop("forward", None)
    return {
        model: {
            "trips": forward.test_trips / one.test_trips,
            "lines": forward.test_trips * forward.lines_a_trip(64) / (one.test_trips * one.lines_a_trip(64)),
        }
        for model, one in here.items()
        if forward
    }


class CoherenceBody(Body):
    """One scene, grid and set of rays, as counted. `wave`: non-empty cells a ray of the deferred tracer."""

    id: str
    intersector: str
    wave: int = Field(gt=0)
    grid: GridFacts
    rays: RayFacts
    counts: list[Coherence] = Field(min_length=1)


class CoherenceRow(CoherenceBody, Row):
    """One scene, grid and set of rays, as stored."""


def coherence_file(folder: Path, **options) -> RecordFile[CoherenceRow]:
    """The rows of a folder as an append-only file; `options` as RecordFile takes them."""
    return RecordFile(Path(folder) / FILE, CoherenceRow, **options)
