"""Runs of a sweep: rates of variants on the same rays, repetitions interleaved, every hit checked."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from harness.device.machine import machine_description
from harness.measure.pipeline import run_group
from harness.measure.scene import Scenes
from harness.records.agreement import why_failed
from harness.records.origin import finish
from harness.records.record_file import RecordFile
from harness.records.run_row import FILE, Record
from harness.records.schema import Machine
from harness.spec.run_spec import RunSpec
from harness.stats import megarays
from harness.studies.study import Part, Step, Study, Task, Tell, guessed_seconds


class RunStudy(Study):
    """Groups of runs that share scene, rays and structure; a row is a record."""

    name = "sweep"
    unit, good = "runs", "valid"
    adds = False
    of_scene = False  # a sweep is a plan for names of scenes, whatever they stand for

    def tasks(self, specs: Sequence[RunSpec], seed: int) -> list[Task]:
        """A task for each group of `specs`, in the random order that `seed` gives."""
        return [self._task(group) for group in shuffled_groups(specs, seed)]

    def _task(self, group: Sequence[RunSpec]) -> Task:
        first = group[0]
        traced = [(spec.variant, (spec.repetitions + 2) * spec.rays) for spec in group]
        return Task(
            self,
            group_name(first),
            first.scene,
            tuple(Part(spec.id, run_name(spec), spec) for spec in group),
            guessed_seconds(first.scene, traced, first.rays),
        )

    def file(self, folder: Path, machine: Machine) -> RecordFile[Record]:
        """`records.jsonl`."""
        return RecordFile(folder / FILE, Record)

    def measure(self, task: Task, scenes: Scenes, tell: Tell) -> Iterator[Record]:
        """Records of one group."""
        specs = [part.what for part in task.parts]
        machine = machine_description(scenes.device)
        for spec, body in run_group(
            specs, scenes, lambda step: tell(Step(step.spec.id if step.spec else None, step.stage, step.done))
        ):
            tell(Step(spec.id, "storing", 1.0))  # a record that is not whole is this run's fault
            yield finish(Record, body, machine, id=spec.id)

    def passed(self, row: Record) -> bool:
        """Whether a run did not fail its check; one that asked for none has not failed it."""
        return not row.failed

    def outcome(self, row: Record) -> str:
        """Its rate, or why it has none."""
        if not row.agreement.is_checked:
            return "not checked, hence no rate"
        if row.failed:
            return f"check failed: {why_failed(row.agreement)}, no rate"
        rate = row.rate.total
        return f"{megarays(rate.median):.3g} Mrays/s valid" if rate else "valid, no rate"


def shuffled_groups(specs: Sequence[RunSpec], seed: int) -> list[list[RunSpec]]:
    """Runs by group, in the random order that `seed` gives.

    Scenes, the sets of rays of a scene, their groups and the runs of a group are shuffled; groups of one scene stay
    together, and those with the same rays, so that each scene is loaded and each set of rays made once.
    """
    scenes: dict[str, dict[tuple, dict[tuple, list[RunSpec]]]] = {}
    for spec in specs:
        scenes.setdefault(spec.scene, {}).setdefault(spec.workload, {}).setdefault(spec.group, []).append(spec)
    generator = random.Random(seed)

    def shuffled(items: Iterable) -> list:
        items = list(items)
        generator.shuffle(items)
        return items

    return [
        shuffled(group)
        for scene in shuffled(scenes.values())
        for workload in shuffled(scene.values())
        for group in shuffled(workload.values())
    ]


def group_name(spec: RunSpec) -> str:
    """Scene and grid of a run, for people."""
    return f"{spec.scene} {spec.structure}" if spec.structure else spec.scene


def run_name(spec: RunSpec) -> str:
    """Scene, grid and variant of a run, for people."""
    return f"{group_name(spec)} {spec.variant}"
