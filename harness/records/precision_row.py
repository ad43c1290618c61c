"""Rows of `precision.jsonl`: how much accuracy a rate costs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from harness.records.record_file import RecordFile
from harness.records.schema import Body, Row
from harness.stats import Interval

FILE = "precision.jsonl"


class PrecisionBody(Body):
    """Error and rate of one value of one knob on one scene, as measured.

    `knob`: `grid` (leaf cells an axis), `precision` (`half` vertices, `float`, `double` intersector) or `samples`
    (occlusion rays a pixel). `error`: of the first two the root mean square error of the hit distance over the
    scene's diagonal; of `samples`, and in `image_error` of `precision`, that of an ambient occlusion image, of which
    1 is white, against one with many rays a pixel. `differing`: rays that hit another triangle than the reference.
    `rays`: behind `rate`, which is in rays a second.
    """

    knob: Literal["grid", "precision", "samples"]
    value: str
    variant: str
    rays: int = Field(gt=0)
    seconds: list[float] = Field(min_length=1)
    rate: Interval
    error: float = Field(ge=0)
    image_error: float | None = Field(default=None, ge=0)
    differing: int | None = Field(default=None, ge=0)


class PrecisionRow(PrecisionBody, Row):
    """One value of one knob on one scene, as stored."""


def precision_file(folder: Path, **options) -> RecordFile[PrecisionRow]:
    """The rows of a folder as an append-only file; `options` as RecordFile takes them."""
    return RecordFile(Path(folder) / FILE, PrecisionRow, **options)
