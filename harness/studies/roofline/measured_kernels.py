"""Where the time of a tracer goes: every kernel's time, flops and bytes, and in the same repetitions the device's
ceilings. Rows of `roofline.jsonl`."""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from harness import stats, tracers
from harness.device.machine import machine_description
from harness.device.stopwatch import OUTSIDE, KernelWatch
from harness.errors import DefrayError
from harness.measure.group import Group, Progress, Run, scene_facts
from harness.measure.interleave import note_hits, warm_up
from harness.measure.scene import Scenes
from harness.records.origin import identity, row_facts
from harness.records.record_file import RecordFile
from harness.records.roofline_row import SCHEMA, roofline_file
from harness.reference.check import Agreement
from harness.spec.run_spec import RunSpec
from harness.studies.roofline.ceilings import UNITS, Ceilings
from harness.studies.roofline.kernel_work import Facts, KernelWork, rest_name, walked_rays, work_of
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

    def file(self, folder: Path, machine: dict) -> RecordFile:
        """`roofline.jsonl`."""
        return roofline_file(folder)

    def measure(self, task: Task, scenes: Scenes, tell: Tell) -> Iterator[dict]:
        """The row of each variant."""
        specs, device = [part.what for part in task.parts], scenes.device

        def told(step: Progress) -> None:
            tell(Step(id_of(step.spec) if step.spec else None, step.stage, step.done))

        for row in measure_roofline(specs, scenes, told):
            yield row | row_facts(machine_description(device))

    def passed(self, row: dict) -> bool:
        """Whether its hits passed the check."""
        return row["valid"]

    def outcome(self, row: dict) -> str:
        """Nanoseconds a ray, or none."""
        if not row["valid"]:
            return "check failed, no times"
        return f"{1e9 * statistics.median(row['seconds']) / row['rays']['count']:.0f} ns a ray"


def id_of(spec: RunSpec) -> str:
    """The id of the row of a run."""
    return identity(spec=spec.model_dump(mode="json"), what="roofline")


def measure_roofline(
    specs: Sequence[RunSpec], scenes: Scenes, tell: Callable[[Progress], None] = lambda _: None
) -> Iterator[dict]:
    """A row for each spec of one scene, still without command, time and machine; ceilings take turns with the runs.

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
        yield _row(group, run, agreement, watches[run.spec.id], _ceiling_rows(ceilings, samples))


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


def _ceiling_rows(ceilings: Ceilings, samples: Sequence[dict]) -> dict:
    sizes = ceilings.sizes
    rows = {
        name: {
            "unit": unit,
            "samples": [s[name] for s in samples],
            "rate": stats.interval([s[name] for s in samples]).as_dict(),
        }
        for name, unit in UNITS.items()
    }
    return {**rows, "lanes": sizes.lanes, "memory_bytes": sizes.memory, "cache_bytes": sizes.cache}


def facts_of(group: Group, run: Run) -> Facts:
    """Exact counts of a run, from its instrumented build, and sizes of its arrays."""
    tracer, counters = run.tracer, run.counters
    structure = group.prepared.structure if tracer.needs_structure else None
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


def _row(group: Group, run: Run, agreement: Agreement, watches: list[KernelWatch], ceilings: dict) -> dict:
    spec, grid, rays = run.spec, group.prepared.structure, group.rays
    valid = agreement.valid and agreement.reference != "none"
    facts = facts_of(group, run)
    return {
        "schema": SCHEMA,
        "id": id_of(spec),
        "scene": scene_facts(group.shared.scene),
        "variant": str(spec.variant),
        "tracer": run.tracer.name,
        "intersector": run.tracer.intersector.name,
        "options": spec.variant.options,
        "lanes": run.tracer.lanes,
        "grid": grid.describe() if run.tracer.needs_structure else None,
        "rays": {"kind": rays.kind, "count": len(rays), "seed": rays.seed},
        "repetitions": len(watches),
        "ceilings": ceilings,
        "seconds": [watch.seconds["total"] for watch in watches] if valid else [],
        "kernels": kernel_rows(watches, facts) if valid else [],
        "counters": dataclasses.asdict(run.counters),
        "agreement": agreement.to_record(),
        "valid": valid,
    }


def kernel_rows(watches: Sequence[KernelWatch], facts: Facts) -> list[dict]:
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


def _kernel_row(name: str, stage: str, seconds: list[float], launches: int, facts: Facts) -> dict:
    work = work_of(name, facts)
    stated = (
        dataclasses.asdict(work) if work else dict.fromkeys(field.name for field in dataclasses.fields(KernelWork))
    )
    nanoseconds = stats.interval([1e9 * value / facts.rays for value in seconds]).as_dict()
    return {
        "name": name,
        "stage": stage,
        "own": launches > 0,
        "launches": launches,
        "seconds": seconds,
        "nanoseconds": nanoseconds,
        **stated,
    }
