"""The suite's results as a table for the terminal and as a file for the charts."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from rich.table import Table

from harness import digest
from harness.errors import DefrayError
from harness.stability.suite import families

SCHEMA = 2  # 1 had no digest; `defray migrate` brings it here
Count = Annotated[int, Field(ge=0)]
Size = Annotated[float, Field(ge=0, allow_inf_nan=False)]
FILE = "stability.json"
LEGEND = (
    "W, G: leaks a million rays; A: worst band | 99th percentile of t's distance from the plane, local ulp; "
    "A4, D: gross errors; S: self-hits, tunnels a million rays; ✗: not passed"
)


class Part(BaseModel):
    """A part of the file: no key that is not declared."""

    model_config = ConfigDict(extra="forbid")


class Row(Part):
    """One family with one intersector in one contraction mode; None where a metric does not apply.

    `size`: `full` or `smoke` inputs.
    """

    intersector: str
    contraction: Literal["off", "on"]
    family: str
    size: Literal["full", "smoke"]
    rays: int = Field(gt=0)
    leaks: Count | None
    double_hits: Count | None
    band_ulp: Size | None
    residual_p99_ulp: Size | None
    gross: Count | None
    nonfinite: Count | None
    self_hits: Count | None
    tunnels: Count | None
    passed: bool

    @field_validator("family")
    @classmethod
    def _known(cls, family: str) -> str:
        if family not in families():
            raise ValueError(f"no family is called {family}")
        return family

    @property
    def key(self) -> tuple:
        """What a later measurement replaces."""
        return self.intersector, self.contraction, self.family


class TestRate(Part):
    """Tests a second."""

    median: float = Field(gt=0)
    low: float = Field(gt=0)
    high: float = Field(gt=0)


class KernelRate(Part):
    """Isolated tests a second of one intersector; None where its hits failed their check."""

    intersector: str
    contraction: Literal["off", "on"]
    wrong: Count
    tests_per_second: TestRate | None

    @property
    def key(self) -> tuple:
        """What a later measurement replaces."""
        return self.intersector, self.contraction


class Results(Part):
    """Rows of the suite on one device, and the rates of the same kernels.

    `contracts`: whether the compiler contracts a * b + c in each mode.
    """

    schema_: int = Field(default=SCHEMA, alias="schema")
    machine: dict
    contracts: dict[Literal["off", "on"], bool]
    migrated_utc: str | None = None
    rows: list[Row]
    kernel_rates: list[KernelRate] = Field(default_factory=list)


class ResultsFile:
    """`FILE` of a folder, which grows family by family; rows of an earlier run that are not measured again stay.

    Raises DefrayError at once where the folder cannot be written to, where the file is no result of the suite, or
    where it holds those of another device.
    """

    def __init__(self, folder: Path, machine: dict, contracts: dict[str, bool]):
        self.file = folder / FILE
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise DefrayError(f"cannot write to {folder}: {error.strerror}") from None
        self.results = read_results(folder) or Results(machine=machine, contracts=contracts, rows=[])
        there, here = (of.get("device") for of in (self.results.machine, machine))
        if there != here:
            raise DefrayError(f"{self.file} holds results of {there}, not of {here}; choose another folder")
        self.results.machine, self.results.contracts = machine, contracts

    def add(self, rows: Sequence[dict] = (), kernel_rates: Sequence[dict] = ()) -> None:
        """Put in rows and rates, each in place of an earlier one, and write the file, whole or not at all."""
        results = self.results
        results.rows = _replaced(results.rows, [Row(**row) for row in rows])
        results.kernel_rates = _replaced(results.kernel_rates, [KernelRate(**rate) for rate in kernel_rates])
        write_results(self.file, results)


def _replaced(old: list, new: list) -> list:
    return list(({one.key: one for one in old} | {one.key: one for one in new}).values())


def write_results(file: Path, results: Results) -> None:
    """Write the file with its digest, whole or not at all; raises DefrayError where it cannot be written."""
    part = file.with_suffix(".part")
    text = json.dumps(digest.sealed(results.model_dump(mode="json", by_alias=True)), indent=1) + "\n"
    try:
        part.write_text(text)
        part.replace(file)
    except OSError as error:
        raise DefrayError(f"cannot write {file}: {error.strerror}") from None


def read_results(folder: Path) -> Results | None:
    """Results in `folder`, None where there are none; raises DefrayError for a file that the suite did not write."""
    file = folder / FILE
    if not file.is_file():
        return None
    try:
        data = json.loads(file.read_text())
    except ValueError as error:
        raise DefrayError(f"{file} is no result of the stress suite: {error}") from None
    if not isinstance(data, dict):
        raise DefrayError(f"{file} is no result of the stress suite: not a JSON object")
    digest.check_schema(data, SCHEMA, str(file))
    digest.needs_digest(data, str(file))
    return as_results(digest.unsealed(data, str(file)), file)


def as_results(data: dict, file: Path) -> Results:
    """`data` as the content of `file`; raises DefrayError for what the suite did not write."""
    try:
        return Results(**data)
    except (TypeError, ValidationError) as error:
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
