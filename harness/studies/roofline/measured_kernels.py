"""Where the time of a tracer goes: every kernel's time, flops and bytes, and in the same repetitions the device's
ceilings. Rows of `roofline.jsonl`."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from harness import stats, tracers
from harness.device.machine import machine_description
from harness.device.stopwatch import OUTSIDE, KernelWatch
from harness.errors import DefrayError
from harness.measure.group import Group, Progress, Run, describe_structure, ray_facts, scene_facts
from harness.measure.interleave import note_hits, warm_up
from harness.measure.scene import Scenes
from harness.records.agreement import Agreement
from harness.records.origin import finish, identity
from harness.records.record_file import RecordFile
from harness.records.roofline_row import (
    NOT_STATED,
    Ceiling,
    CeilingValues,
    KernelRow,
    RooflineBody,
    RooflineRow,
    roofline_file,
)
from harness.records.schema import Machine
from harness.spec.run_spec import RunSpec
from harness.studies.roofline.ceilings import UNITS, Ceilings
from harness.studies.roofline.kernel_work import Facts, rest_name, walked_rays, work_of
from harness.studies.study import Part, Step, Study, Task, Tell, guessed_seconds


class RooflineStudy(Study):
    """Time, flops and bytes of every kernel of variants on the device, beside its ceilings."""

    name = "roofline"
    unit, good = "variants", "valid"
    bad = "failed the check and have no times"

    def tasks(self, specs: Sequence[RunSpec]) -> list[Task]:
        """One task: the runs of one scene. Raises DefrayError for a tracer that does not run on the device."""
        for spec in specs:
            if not tracers.find(spec.variant.tracer).needs_device:
                raise DefrayError(f"{spec.variant} has no kernels on a device; leave it out")
        scene = specs[0].scene
        parts = tuple(Part(id_of(spec), f"{scene} {spec.variant}", spec) for spec in specs)
        traced = [(spec.variant, (spec.repetitions + 2) * spec.rays) for spec in specs]
        return [Task(self, scene, scene, parts, guessed_seconds(scene, traced, specs[0].rays))]

    def file(self, folder: Path, machine: Machine) -> RecordFile[RooflineRow]:
        """`roofline.jsonl`."""
        return roofline_file(folder)

    def measure(self, task: Task, scenes: Scenes, tell: Tell) -> Iterator[RooflineRow]:
        """The row of each variant."""
        specs, device = [part.what for part in task.parts], scenes.device

        def told(step: Progress) -> None:
            tell(Step(id_of(step.spec) if step.spec else None, step.stage, step.done))

        for body in measure_roofline(specs, scenes, told):
            yield finish(RooflineRow, body, machine_description(device))

    def passed(self, row: RooflineRow) -> bool:
        """Whether its hits passed the check."""
        return row.valid

    def outcome(self, row: RooflineRow) -> str:
        """Nanoseconds a ray, or none."""
        if not row.valid:
            return "check failed, no times"
        return f"{1e9 * statistics.median(row.seconds) / row.rays.count:.0f} ns a ray"


def id_of(spec: RunSpec) -> str:
    """The id of the row of a run."""
    return identity(spec=spec.model_dump(mode="json"), what="roofline")


def measure_roofline(
    specs: Sequence[RunSpec], scenes: Scenes, tell: Callable[[Progress], None] = lambda _: None
) -> Iterator[RooflineBody]:
    """The body of a row for each spec of one scene; ceilings take turns with the runs.

    Raises what a group of runs raises.
    """
    group = Group(specs, scenes, tell)
    runs = [group.open_run(spec) for spec in specs]
    for run in runs:
        warm_up(group, run)
    ceilings = Ceilings(group.device)
    samples, watches = _repeat(group, runs, ceilings)
    for run in runs:
        agreement = group.check(run, runs)
        yield _body(group, run, agreement, watches[run.spec.id], _ceiling_values(ceilings, samples))


def _repeat(group: Group, runs: Sequence[Run], ceilings: Ceilings) -> tuple[list[dict], dict[str, list]]:
    """Samples of the ceilings and the watches of each run, by its id, repetition by repetition."""
    samples = []
    watches: dict[str, list[KernelWatch]] = {run.spec.id: [] for run in runs}
    turns = runs[0].spec.repetitions
    for turn, share, run in stats.interleaved(runs, turns, group.seed):
        group.tell(run.spec, f"repetition {turn + 1} of {turns}", 0.2 + 0.75 * (turn + share) / turns)
        samples.append(ceilings.measure())
        watch = KernelWatch(group.device.queue)
        note_hits(run, run.tracer.trace(group.rays, watch))
        watches[run.spec.id].append(watch)
    return samples, watches


def _ceiling_values(ceilings: Ceilings, samples: Sequence[dict]) -> CeilingValues:
    sizes = ceilings.sizes
    found = {}
    for name, unit in UNITS.items():
        values = [sample[name] for sample in samples]
        found[name] = Ceiling(unit=unit, samples=values, rate=stats.interval(values))
    return CeilingValues(**found, lanes=sizes.lanes, memory_bytes=sizes.memory, cache_bytes=sizes.cache)


def facts_of(group: Group, run: Run) -> Facts:
    """Exact counts of a run, from its instrumented build, and sizes of its arrays."""
    tracer, counters = run.tracer, run.counters
    structure = group.prepared.structure if tracer.needs_structure else None
    if structure and structure.walk_work is None:
        raise DefrayError(
            f"structure {structure.name} does not state what its walk computes; a roofline needs its walk_work"
        )
    walked = walked_rays(counters, len(group.rays), tracer.batch_size, getattr(tracer.options, "compaction", True))
    return Facts(
        rays=len(group.rays),
        hits=int((run.hits.primitive >= 0).sum()),
        counters=counters,
        walked=walked,
        lanes=tracer.lanes,
        cells=structure.nonempty if structure else 0,
        references=len(structure.references) if structure else 0,
        triangles=len(group.shared.scene),
        triangle_bytes=tracer.intersector.bytes,
        pair_bytes=4 * getattr(tracer.options, "pair_words", 1),
        walk=structure.walk_work if structure else None,
        test_flops=tracer.intersector.flops,
    )


def _body(
    group: Group, run: Run, agreement: Agreement, watches: list[KernelWatch], ceilings: CeilingValues
) -> RooflineBody:
    spec, valid = run.spec, agreement.valid and agreement.is_checked
    return RooflineBody(
        id=id_of(spec),
        scene=scene_facts(group.shared.scene),
        variant=str(spec.variant),
        tracer=run.tracer.name,
        intersector=run.tracer.intersector.name,
        options=spec.variant.options,
        lanes=run.tracer.lanes,
        grid=describe_structure(group.prepared.structure) if run.tracer.needs_structure else None,
        rays=ray_facts(group.rays),
        repetitions=len(watches),
        ceilings=ceilings,
        seconds=[watch.seconds["total"] for watch in watches] if valid else [],
        kernels=kernel_rows(watches, facts_of(group, run)) if valid else [],
        counters=run.counters,
        agreement=agreement,
        valid=valid,
    )


def kernel_rows(watches: Sequence[KernelWatch], facts: Facts) -> list[KernelRow]:
    """Every kernel, in the order of its first launch, then what each stage takes beyond its kernels."""
    names = list(dict.fromkeys(key for watch in watches for key in watch.kernels))
    rows = []
    for stage, name in names:
        times = [watch.kernels[stage, name] for watch in watches]
        rows.append(_kernel_row(name, stage, [one.seconds for one in times], times[0].launches, facts))
    for stage in [name for name in watches[0].seconds if name != "total"] + [OUTSIDE]:
        seconds = [watch.rest(stage) for watch in watches]
        rows.append(_kernel_row(rest_name(stage, {name for _, name in names}), stage, seconds, 0, facts))
    return rows


def _kernel_row(name: str, stage: str, seconds: list[float], launches: int, facts: Facts) -> KernelRow:
    work = work_of(name, facts) or NOT_STATED
    return KernelRow(
        name=name,
        stage=stage,
        own=launches > 0,
        launches=launches,
        seconds=seconds,
        nanoseconds=stats.interval([1e9 * value / facts.rays for value in seconds]),
        **work.as_json(),
    )
