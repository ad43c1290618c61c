"""Where the time of a tracer goes: every kernel's time, flops and bytes, and in the same repetitions the device's
ceilings. Rows of `roofline.jsonl`."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence

from harness import stats
from harness.data import differing
from harness.device.stopwatch import OUTSIDE, KernelWatch
from harness.errors import DefrayError
from harness.measure.group import Group, Run, describe_grid, ray_facts, scene_facts
from harness.measure.interleave import warm_up
from harness.records.agreement import Agreement
from harness.records.origin import identity
from harness.records.roofline_row import NOT_STATED, Ceiling, CeilingValues, KernelRow, RooflineBody
from harness.spec.run_spec import RunSpec
from harness.studies.roofline.ceilings import UNITS, Ceilings
from harness.studies.roofline.kernel_work import Facts, rest_name, walked_rays, work_of


def measure_roofline(
    specs: Sequence[RunSpec], device, tell: Callable[[str], None] = lambda _: None
) -> Iterator[RooflineBody]:
    """The body of a row for each spec of one scene; ceilings take turns with the runs.

    Raises DefrayError for a tracer that does not run on the device, and what a group of runs raises.
    """
    group = Group(specs, device, lambda step: tell(step.stage))
    runs = [group.open_run(spec) for spec in specs]
    strange = [str(run.spec.variant) for run in runs if not run.tracer.needs_device]
    if strange:
        raise DefrayError(f"{strange[0]} has no kernels on a device; leave it out")
    for run in runs:
        warm_up(group, run)
    ceilings = Ceilings(device)
    samples, watches = _repeat(group, runs, ceilings, tell)
    for run in runs:
        agreement = group.check(run, runs)
        yield _body(group, run, agreement, watches[run.spec.id], _ceiling_values(ceilings, samples))


def _repeat(group: Group, runs: Sequence[Run], ceilings: Ceilings, tell) -> tuple[list[dict], dict[str, list]]:
    """Samples of the ceilings and the watches of each run, by its id, repetition by repetition."""
    generator, samples = random.Random(group.seed), []
    watches: dict[str, list[KernelWatch]] = {run.spec.id: [] for run in runs}
    for turn in range(runs[0].spec.repetitions):
        tell(f"repetition {turn + 1} of {runs[0].spec.repetitions}")
        for run in generator.sample(list(runs), len(runs)):
            samples.append(ceilings.measure())
            watch = KernelWatch(group.device.queue)
            hits = run.tracer.trace(group.rays, watch)
            watches[run.spec.id].append(watch)
            if run.hits is not None:
                run.unstable = max(run.unstable, differing(hits, run.hits))
            run.hits = hits
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
    tracer, grid, counters = run.tracer, group.setting.grid if run.tracer.needs_grid else None, run.counters
    walked = walked_rays(counters, len(group.rays), tracer.batch_size, getattr(tracer.options, "compaction", True))
    return Facts(
        rays=len(group.rays),
        hits=int((run.hits.primitive >= 0).sum()),
        counters=counters,
        walked=walked,
        lanes=tracer.lanes,
        first_level=grid.top_block.nbytes if grid else 0,
        second_level=grid.leaves.nbytes if grid else 0,
        cells=grid.nonempty if grid else 0,
        references=len(grid.references) if grid else 0,
        triangles=len(group.shared.scene),
        triangle_bytes=tracer.intersector.bytes,
        pair_bytes=4 * getattr(tracer.options, "pair_words", 1),
        walk="adaptive" if grid and grid.spec.reading == "adaptive" else "uniform",
        test_flops=tracer.intersector.flops,
    )


def _body(
    group: Group, run: Run, agreement: Agreement, watches: list[KernelWatch], ceilings: CeilingValues
) -> RooflineBody:
    spec, grid, valid = run.spec, group.setting.grid, agreement.valid and agreement.is_checked
    return RooflineBody(
        id=identity(spec=spec.model_dump(mode="json"), what="roofline"),
        scene=scene_facts(group.shared.scene),
        variant=str(spec.variant),
        tracer=run.tracer.name,
        intersector=run.tracer.intersector.name,
        options=spec.variant.options,
        lanes=run.tracer.lanes,
        grid=describe_grid(grid) if run.tracer.needs_grid else None,
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
