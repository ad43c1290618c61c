"""Rows of `roofline.jsonl`: time, flops and bytes of every kernel of one variant, beside the device's ceilings."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from harness.records.record_file import RecordFile
from harness.records.run_row import Agreement, CounterValues, GridFacts, Part, Provenance, Rate, RayFacts, checked_row

SCHEMA = 2
FILE = "roofline.jsonl"


class Ceiling(Part):
    """Samples of one ceiling, one before each run of each repetition, and their median with its 95 % interval."""

    unit: Literal["bytes/s", "flop/s"]
    samples: list[float] = Field(min_length=1)
    rate: Rate


class CeilingValues(Part):
    """Copying from memory and from the last cache, and fused multiply-adds, in vectors of `lanes` floats.

    `memory_bytes`, `cache_bytes`: read and written by one copy.
    """

    memory: Ceiling
    cache: Ceiling
    fma: Ceiling
    lanes: int = Field(gt=0)
    memory_bytes: int = Field(gt=0)
    cache_bytes: int = Field(gt=0)


class KernelRow(Part):
    """One kernel in one stage: device seconds of each repetition, launches summed up, and its share of the work.

    `nanoseconds`: a ray. `flops`, `bytes` and so on as in `harness.work.Work`; None where they are not stated.
    `own`: False for what a stage takes beyond its kernels.
    """

    name: str
    stage: str
    own: bool
    launches: int = Field(ge=0)
    seconds: list[float] = Field(min_length=1)
    nanoseconds: Rate
    flops: int | None = Field(ge=0)
    executed_flops: int | None = Field(ge=0)
    bytes: int | None = Field(ge=0)
    uncached_bytes: int | None = Field(ge=0)


class RooflineRow(Provenance):
    """One variant on one scene. A run whose hits were not checked, or were wrong, has neither times nor kernels."""

    variant: str
    tracer: str
    intersector: str
    options: dict[str, str]
    lanes: int = Field(gt=0)
    grid: GridFacts | None
    rays: RayFacts
    repetitions: int = Field(gt=0)
    ceilings: CeilingValues
    seconds: list[float]
    kernels: list[KernelRow]
    counters: CounterValues
    agreement: Agreement
    valid: bool

    @model_validator(mode="after")
    def _no_time_without_validity(self) -> RooflineRow:
        if not self.valid and (self.seconds or self.kernels):
            raise ValueError("a run that is not valid must not have times")
        if self.valid and self.agreement.reference not in ("embree", "exact"):
            raise ValueError("times need hits that were compared with a reference")
        lengths = {len(self.seconds), *(len(kernel.seconds) for kernel in self.kernels)}
        if self.valid and lengths != {self.repetitions}:
            raise ValueError("there must be a time for each repetition")
        return self


def roofline_row(row: Any, where: str) -> dict:
    """`row` in the schema's key order; raises DefrayError naming `where` and the first bad key."""
    return checked_row(RooflineRow, SCHEMA, row, where)


def roofline_file(folder: Path, **options) -> RecordFile:
    """The rows of a folder as an append-only file; `options` as RecordFile takes them."""
    return RecordFile(Path(folder) / FILE, validate=roofline_row, **options)
