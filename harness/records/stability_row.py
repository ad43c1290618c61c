"""`stability.json`: results of the stress suite, method by method and family by family, with the tests' rates."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator

from harness.errors import DefrayError
from harness.records import digest
from harness.records.schema import SCHEMA, Machine, Stored, checked
from harness.spec.stress_suite import families
from harness.stats import Interval

Count = Annotated[int, Field(ge=0)]
Size = Annotated[float, Field(ge=0)]
FILE = "stability.json"


class StressRow(Stored):
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


class KernelRate(Stored):
    """Isolated tests a second of one intersector; None where its hits failed their check.

    `wrong`: rays whose hit differs from the reference.
    """

    intersector: str
    contraction: Literal["off", "on"]
    wrong: Count
    tests_per_second: Interval | None

    @field_validator("tests_per_second")
    @classmethod
    def _above_zero(cls, found: Interval | None) -> Interval | None:
        if found and min(found.median, found.low, found.high) <= 0:
            raise ValueError("a rate must be above 0")
        return found

    @property
    def key(self) -> tuple:
        """What a later measurement replaces."""
        return self.intersector, self.contraction


class StressResults(Stored):
    """Rows of the suite on one device, and the rates of the same kernels.

    `contracts`: whether the compiler contracts a * b + c in each mode.
    """

    schema_: int = Field(default=SCHEMA, alias="schema")
    machine: Machine
    contracts: dict[Literal["off", "on"], bool]
    migrated_utc: None = None  # stands in every file of schema 2
    rows: list[StressRow]
    kernel_rates: list[KernelRate] = Field(default_factory=list)


class ResultsFile:
    """`FILE` of a folder, which grows family by family; rows of an earlier run that are not measured again stay.

    Raises DefrayError at once where the folder cannot be written to, where the file is no result of the suite, or
    where it holds those of another device.
    """

    def __init__(self, folder: Path, machine: Machine, contracts: dict[str, bool]):
        self.file = folder / FILE
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise DefrayError(f"cannot write to {folder}: {error.strerror}") from None
        self.results = read_results(folder) or StressResults(machine=machine, contracts=contracts, rows=[])
        there, here = self.results.machine.device, machine.device
        if there != here:
            raise DefrayError(f"{self.file} holds results of {there}, not of {here}; choose another folder")
        self.results.machine, self.results.contracts = machine, contracts

    def add(self, rows: Sequence[StressRow] = (), kernel_rates: Sequence[KernelRate] = ()) -> None:
        """Put in rows and rates, each in place of an earlier one, and write the file, whole or not at all."""
        results = self.results
        results.rows = _replaced(results.rows, rows)
        results.kernel_rates = _replaced(results.kernel_rates, kernel_rates)
        write_results(self.file, results)


def _replaced(old: Sequence, new: Sequence) -> list:
    return list(({one.key: one for one in old} | {one.key: one for one in new}).values())


def write_results(file: Path, results: StressResults) -> None:
    """Write the file with its digest, whole or not at all; raises DefrayError where it cannot be written."""
    part = file.with_suffix(".part")
    text = json.dumps(digest.sealed(results.as_json()), indent=1) + "\n"
    try:
        part.write_text(text)
        part.replace(file)
    except OSError as error:
        raise DefrayError(f"cannot write {file}: {error.strerror}") from None


def read_results(folder: Path) -> StressResults | None:
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
    return checked(StressResults, digest.unsealed(data, str(file)), f"{file} is no result of the stress suite")
