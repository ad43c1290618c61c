"""Rows of `roofline.jsonl`: time, flops and bytes of every kernel of one variant, beside the device's ceilings."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from harness.records.agreement import StoredAgreement
from harness.records.record_file import RecordFile
from harness.records.schema import Body, GridFacts, RayFacts, Row, Stored, StoredCounters
from harness.stats import Interval

FILE = "roofline.jsonl"


class Ceiling(Stored):
    """Samples of one ceiling, one before each run of each repetition, and their median with its 95 % interval."""

    unit: Literal["bytes/s", "flop/s"]
    samples: list[float] = Field(min_length=1)
    rate: Interval


class CeilingValues(Stored):
    """Copying from memory and from the last cache, and fused multiply-adds, in vectors of `lanes` floats.

    `memory_bytes`, `cache_bytes`: read and written by one copy.
    """

    memory: Ceiling
    cache: Ceiling
    fma: Ceiling
    lanes: int = Field(gt=0)
    memory_bytes: int = Field(gt=0)
    cache_bytes: int = Field(gt=0)


class KernelSeconds(Stored):
    """One kernel in one stage: device seconds of each repetition, launches summed up; `nanoseconds`: a ray.

    `own`: False for what a stage takes beyond its kernels.
    """

    name: str
    stage: str
    own: bool
    launches: int = Field(ge=0)
    seconds: list[float] = Field(min_length=1)
    nanoseconds: Interval


class KernelWork(Stored):
    """Work of all launches of one kernel; None where it is not stated.

    `executed_flops`: with those of idle lanes. `bytes`: the least that any cache could leave, each table once a
    launch; `uncached_bytes`: every load and store as the kernel states it.
    """

    flops: int | None = Field(ge=0)
    executed_flops: int | None = Field(ge=0)
    bytes: int | None = Field(ge=0)
    uncached_bytes: int | None = Field(ge=0)

    @property
    def is_stated(self) -> bool:
        """Whether the kernel's work is known."""
        return self.bytes is not None


NOT_STATED = KernelWork(flops=None, executed_flops=None, bytes=None, uncached_bytes=None)


class KernelRow(KernelWork, KernelSeconds):
    """One kernel in one stage: its time and its work."""


class RooflineBody(Body):
    """One variant on one scene, as measured.

    A run whose hits were not checked, or were wrong, has neither times nor kernels.
    """

    id: str
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
    counters: StoredCounters
    agreement: StoredAgreement
    valid: bool

    @model_validator(mode="after")
    def _no_time_without_validity(self) -> RooflineBody:
        if not self.valid and (self.seconds or self.kernels):
            raise ValueError("a run that is not valid must not have times")
        if self.valid and not self.agreement.is_checked:
            raise ValueError("times need hits that were compared with a reference")
        lengths = {len(self.seconds), *(len(kernel.seconds) for kernel in self.kernels)}
        if self.valid and lengths != {self.repetitions}:
            raise ValueError("there must be a time for each repetition")
        return self


class RooflineRow(RooflineBody, Row):
    """One variant on one scene, as stored."""


def roofline_file(folder: Path, **options) -> RecordFile[RooflineRow]:
    """The rows of a folder as an append-only file; `options` as RecordFile takes them."""
    return RecordFile(Path(folder) / FILE, RooflineRow, **options)
