"""Rows of `precision.jsonl`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from harness.records.accuracy_row import SCHEMA
from harness.records.record_file import RecordFile
from harness.records.run_row import Provenance, Rate, checked_row

PRECISION_FILE = "precision.jsonl"


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
