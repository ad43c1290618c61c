"""Rows of `records.jsonl`: what one run leaves behind."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import model_validator

from harness.data import Samples
from harness.records.agreement import StoredAgreement
from harness.records.schema import Body, GridFacts, RayFacts, Row, Stored, StoredCounters, every_key
from harness.stats import Interval

FILE = "records.jsonl"


class Rates(Stored):
    """Rays per second of the stages that have a rate, each with its 95 % interval."""

    traverse: Interval | None
    intersect: Interval | None
    total: Interval | None


class RunBody(Body):
    """One run as measured. A run that is not valid, or that was not checked, has no rate.

    `spec`: what was asked for. `hierarchy_build_seconds`: of Embree's bounding volume hierarchy, wall clock; None for
    tracers that have none.
    """

    view: str | None
    rays: RayFacts
    grid: GridFacts | None
    tracer: str
    intersector: str | None
    options: dict[str, str]
    repetitions: int
    spec: dict[str, Any]
    samples: Annotated[Samples, every_key(Samples)]
    rate: Rates
    counters: StoredCounters
    agreement: StoredAgreement
    hits: int | None = None
    hits_sha256: str | None = None
    hierarchy_build_seconds: float | None = None
    valid: bool

    @model_validator(mode="after")
    def _no_rate_without_validity(self) -> RunBody:
        has_rate = any((self.rate.traverse, self.rate.intersect, self.rate.total))
        if has_rate and not self.valid:
            raise ValueError("a run that is not valid must not have a rate")
        if self.valid and not self.agreement.is_checked:
            raise ValueError("a run that was not checked must not be valid nor have a rate")
        return self

    @property
    def failed(self) -> bool:
        """Whether its check found it wrong; a run that asked for no check has not failed it."""
        return not self.valid and self.agreement.is_checked


class Record(RunBody, Row):
    """One run as stored."""
