"""The stress suite as a study: families, and the rates of the same kernels beside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from harness.measure.scene import Scenes
from harness.records.schema import Machine
from harness.records.stability_row import KernelRate, ResultsFile, StressRow
from harness.spec.intersectors import DEFAULT, INTERSECTORS, Intersector, find
from harness.spec.stress_suite import Family, families
from harness.studies.stability.kernel_rates import kernel_rates
from harness.studies.stability.stress_run import measure_family, methods_of
from harness.studies.study import Part, Step, Study, Task, Tell

PAIR_SECONDS = 1.0e-6  # one ray of a family, judged
RATES = "kernel rates"


@dataclass(frozen=True)
class StabilityStudy(Study):
    """Where intersectors fail. `contracts`: whether this device's compiler contracts a * b + c in each mode."""

    contracts: dict[str, bool] = field(default_factory=dict)

    name = "stability"
    unit, good = "tests", "as promised"
    bad = "break a promise"
    of_scene = False

    def tasks(
        self, intersectors: Sequence[Intersector], chosen: Sequence[Family], size: str, rates: bool
    ) -> list[Task]:
        """A task for each family, and with `rates` one for the kernels' own; each method is a part."""
        methods = [(entry.name, mode) for entry, mode in methods_of(intersectors)]
        tasks = []
        for family in chosen:
            parts = tuple(
                Part(_id(name, mode, family.id, size), f"{family.id} {name}, contraction {mode}", (name, mode))
                for name, mode in methods
            )
            cost = 1.0 + len(parts) * family.rays[size] * PAIR_SECONDS
            tasks.append(Task(self, family.id, None, parts, cost, (family.id, size)))
        if rates:
            parts = tuple(
                Part(_id(name, mode, RATES), f"rate of {name}, contraction {mode}", (name, mode))
                for name, mode in methods
            )
            tasks.append(Task(self, RATES, None, parts, float(len(parts))))
        return tasks

    def file(self, folder: Path, machine: Machine) -> SuiteFile:
        """`stability.json`; raises DefrayError where it holds another device's results."""
        return SuiteFile(folder, machine, self.contracts)

    def measure(self, task: Task, scenes: Scenes, tell: Tell) -> Iterator[StressRow | KernelRate]:
        """Rows of one family, or the rates of the kernels."""
        methods = [(find(name), mode) for name, mode in (part.what for part in task.parts)]

        def told(place: int | None, what: str) -> None:
            done = 0.0 if place is None else place / len(methods)
            tell(Step(None if place is None else task.parts[place].id, what, done))

        if task.plan is None:
            yield from kernel_rates(scenes.device, methods, told)
        else:
            family, size = task.plan
            yield from measure_family(scenes.device, families()[family], methods, size, told)

    def id_of(self, row: StressRow | KernelRate) -> str:
        """Intersector, mode, family and size; of a rate the first two."""
        last = (row.family, row.size) if is_test(row) else (RATES,)
        return _id(row.intersector, row.contraction, *last)

    def device_of(self, row: StressRow | KernelRate) -> None:
        """The file is of one device."""
        return

    def passed(self, row: StressRow | KernelRate) -> bool:
        """Whether a row keeps what its intersector promises."""
        return not is_test(row) or row.passed or not is_promised(row)

    def outcome(self, row: StressRow | KernelRate) -> str | None:
        """Nothing, unless a promise is broken: the table shows the rest."""
        return None if self.passed(row) else "fails, though it promises not to"


def _id(*names: str) -> str:
    return " ".join(names)


def is_test(row: StressRow | KernelRate) -> bool:
    """Whether a row is of a family, and not a rate."""
    return isinstance(row, StressRow)


def is_promised(row: StressRow) -> bool:
    """Whether passing is promised: everything of the default, no leak of one registered as watertight."""
    watertight = INTERSECTORS[row.intersector].watertight
    return row.intersector == DEFAULT or (watertight and bool(row.leaks))


class SuiteFile:
    """`stability.json` of a folder, row by row."""

    def __init__(self, folder: Path, machine: Machine, contracts: dict[str, bool]):
        self._file = ResultsFile(folder, machine, contracts)
        self.path = self._file.file
        self.warn = None  # there is nothing to warn of

    def append(self, row: StressRow | KernelRate) -> None:
        """Put in one row, in place of an earlier one, and write the file whole or not at all."""
        if is_test(row):
            self._file.add([row])
        else:
            self._file.add(kernel_rates=[row])

    def read(self) -> list[StressRow | KernelRate]:
        """All rows and rates on file."""
        results = self._file.results
        return [*results.rows, *results.kernel_rates]

    repair = read  # what is written whole or not at all is never torn
