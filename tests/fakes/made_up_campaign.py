"""Made-up campaigns: tasks of every study, a row for each of their parts, and an executor that gives those."""

from __future__ import annotations

import pickle
import time
from types import SimpleNamespace

import made_up_accuracy
import made_up_roofline
import pytest
from made_up_accuracy import as_row
from made_up_sweep import body_of

from harness.campaign import runner
from harness.campaign.executors import TaskFailed
from harness.campaign.plan import interleaved
from harness.campaign.tasks import coherence_tasks, roofline_tasks
from harness.records.accuracy_row import AccuracyRow
from harness.records.coherence_row import CoherenceRow
from harness.records.origin import finish
from harness.records.precision_row import PrecisionRow
from harness.records.roofline_row import RooflineRow
from harness.records.run_row import Record
from harness.records.schema import Machine, Row
from harness.records.stability_row import KernelRate, StressRow
from harness.spec.intersectors import find
from harness.spec.run_spec import Variant
from harness.spec.stress_suite import select
from harness.spec.structure import Uniform
from harness.studies.errors_and_leaks import AccuracyStudy, Plan, parse_contenders
from harness.studies.needed_precision import PrecisionStudy
from harness.studies.runs import RunStudy
from harness.studies.stability.suite import RATES, StabilityStudy
from harness.studies.study import Step, Task

SCENES = ("sponza", "conference")
MACHINE = Machine(**made_up_accuracy.MACHINE)
ELSEWHERE = MACHINE.model_copy(update={"device": "another"})
VARIANTS = "deferred:ray-space,forward:ray-space,embree"


def tasks_of(study: str) -> list[Task]:
    """Two tasks of a study, or more."""
    variants = [Variant.parse(text) for text in VARIANTS.split(",")]
    if study == "sweep":
        return RunStudy().tasks([s for scene in SCENES for s in interleaved(scene, variants, [Uniform()])], 1)
    if study == "accuracy":
        contenders = parse_contenders(VARIANTS)
        return [task for scene in SCENES for task in AccuracyStudy().tasks(scene, contenders, Plan())]
    if study == "precision":
        return [task for scene in SCENES for task in PrecisionStudy().tasks(scene, 1000, 2)]
    if study == "roofline":
        return roofline_tasks(SCENES)
    if study == "coherence":
        return coherence_tasks(SCENES)
    methods = [find("ray-space"), find("moller-trumbore")]
    return StabilityStudy({"off": False, "on": True}).tasks(methods, select("W"), "smoke", True)


def rows_of(task: Task) -> list[Row | StressRow | KernelRate]:
    """A made-up row for each part."""
    return [_row(task, part) for part in task.parts]


def _row(task: Task, part) -> Row | StressRow | KernelRate:
    if task.study.name == "sweep":
        return finish(Record, body_of(part.what), MACHINE, id=part.id)
    if task.study.name == "stability":
        made = made_up_accuracy.stability(("W1",))
        named = dict(zip(("intersector", "contraction"), part.what, strict=True))
        if task.name == RATES:
            return KernelRate.model_validate(made["kernel_rates"][0] | named)
        return StressRow.model_validate(made["rows"][0] | named | {"family": task.name})
    kind, make = {
        "accuracy": (AccuracyRow, lambda: made_up_accuracy.accuracy_row(task.scene, str(part.what))),
        "precision": (PrecisionRow, lambda: made_up_accuracy.precision_row(task.scene, "samples", "64", 0.3, 0.1)),
        "roofline": (RooflineRow, lambda: made_up_roofline.roofline_row(task.scene, "deferred")),
        "coherence": (CoherenceRow, lambda: made_up_roofline.coherence_row(task.scene)),
    }[task.study.name]
    return as_row(kind, make() | {"id": part.id})


class FakeExecutor:
    """Gives made-up rows, as an executor in another process would: whatever goes there and back is pickled."""

    def __init__(self, failing: str = "", blind: bool = False, wait: float = 0.0):
        self.machine = MACHINE
        self.failing, self.blind, self.wait = failing, blind, wait
        self.asked: list[str] = []

    def environment(self) -> dict:
        """Of the machine."""
        return MACHINE.as_json()

    def submit(self, task, tell=lambda _: None):
        """The rows of a task; one whose name has `failing` in it is made to fail, with nobody to blame if `blind`."""
        task = pickle.loads(pickle.dumps(task))
        self.asked.append(task.id)
        for part, row in zip(task.parts, rows_of(task), strict=True):
            tell(Step(part.id, "measuring", 0.5))
            if self.failing and self.failing in part.name:
                raise pickle.loads(pickle.dumps(TaskFailed("made to fail", None if self.blind else part.id)))
            time.sleep(self.wait)
            yield pickle.loads(pickle.dumps(row))


STUDIES = ("sweep", "accuracy", "precision", "roofline", "coherence", "stability")


@pytest.fixture(autouse=True, name="scenes")
def fake_scenes(monkeypatch):
    """Scenes that need not be loaded to be told apart."""
    known = {"sha256": "ab" * 32}

    def load_scene(name: str) -> SimpleNamespace:
        return SimpleNamespace(source=made_up_accuracy.common(name, "", 1)["scene"]["source"], **known)

    monkeypatch.setattr(runner, "load_scene", load_scene)
    return known
