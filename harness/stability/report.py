"""The suite's results as a table for the terminal and as a file for the charts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError
from rich.table import Table

from harness.errors import DefrayError
from harness.stability.suite import families

SCHEMA = 1
FILE = "stability.json"
LEGEND = (
    "W, G: leaks a million rays; A: worst band | 99th percentile of t's distance from the plane, local ulp; "
    "A4, D: gross errors; S: self-hits, tunnels a million rays; ✗: not passed"
)


class Row(BaseModel):
    """One family with one intersector in one contraction mode; None where a metric does not apply."""

    model_config = ConfigDict(extra="forbid")

    intersector: str
    contraction: str
    family: str
    rays: int
    leaks: int | None
    double_hits: int | None
    band_ulp: float | None
    residual_p99_ulp: float | None
    gross: int | None
    nonfinite: int | None
    self_hits: int | None
    tunnels: int | None
    passed: bool


class KernelRate(BaseModel):
    """Isolated tests a second of one intersector; None where its hits failed their check."""

    model_config = ConfigDict(extra="forbid")

    intersector: str
    contraction: str
    wrong: int
    tests_per_second: dict[str, float] | None


class Results(BaseModel):
    """All rows of one run of the suite on one device, and the rates of the same kernels."""

    model_config = ConfigDict(extra="forbid")

    schema_: int = SCHEMA
    machine: dict
    size: str
    contracts: dict[str, bool]
    rows: list[Row]
    kernel_rates: list[KernelRate] = []


def write_results(folder: Path, results: Results) -> Path:
    """Write FILE into `folder`, whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / FILE
    data = results.model_dump()
    data["schema"] = data.pop("schema_")
    part = file.with_suffix(".part")
    part.write_text(json.dumps(data, allow_nan=False, indent=1) + "\n")
    part.replace(file)
    return file


def read_results(folder: Path) -> Results | None:
    """Results in `folder`, None where there are none; raises DefrayError for a file of another schema."""
    file = folder / FILE
    if not file.is_file():
        return None
    try:
        data = json.loads(file.read_text())
        schema = data.pop("schema", None)
        if schema != SCHEMA:
            raise DefrayError(f"{file} has schema {schema}, this version reads {SCHEMA}")
        return Results(schema_=schema, **data)
    except (ValueError, AttributeError, ValidationError) as error:
        first = " ".join(str(error).split())[:200]
        raise DefrayError(f"{file} is no result of the stress suite: {first}") from None


def table(rows: Sequence[dict]) -> Table:
    """Methods by families: the figure that decides, red where the family is failed."""
    order = [family for family in families() if any(row["family"] == family for row in rows)]
    found = {(row["intersector"], row["contraction"], row["family"]): row for row in rows}
    result = Table(box=None)
    result.add_column("intersector")
    result.add_column("contraction")
    for family in order:
        result.add_column(family, justify="right")
    for name, mode in dict.fromkeys((row["intersector"], row["contraction"]) for row in rows):
        cells = [_cell(found.get((name, mode, family))) for family in order]
        result.add_row(name, mode, *cells)
    return result


def _cell(row: dict | None) -> str:
    if row is None:
        return "–"
    if row["band_ulp"] is not None and row["residual_p99_ulp"] is not None and row["family"] != "A4":
        text = f"{_number(row['band_ulp'])}|{_number(row['residual_p99_ulp'])}"
    elif row["leaks"] is not None:
        text = _number(1e6 * row["leaks"] / row["rays"])
    elif row["self_hits"] is not None:
        text = f"{_number(1e6 * row['self_hits'] / row['rays'])},{_number(1e6 * row['tunnels'] / row['rays'])}"
    else:
        text = _number(row["gross"])
    return text if row["passed"] else f"[red]{text} ✗[/red]"


def _number(value: float) -> str:
    """Two digits are enough to see where a method fails."""
    if value < 1000:
        return f"{value:.2g}" if value < 100 else f"{value:.0f}"
    return f"{value:.0e}".replace("e+0", "e")
