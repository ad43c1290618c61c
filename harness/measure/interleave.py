"""Warm-up and interleaved repetitions."""

from __future__ import annotations

import random
from collections.abc import Sequence

from harness.data import STAGES, differing
from harness.measure.group import Group, Run


def warm_up(group: Group, run: Run) -> None:
    """Compile and run every kernel on some of the rays, then count the work of all in an instrumented run."""
    group.tell(run.spec, "warm-up", 0.15)
    run.tracer.trace(group.rays[: run.tracer.warm_up_rays], group.stopwatch(run))
    run.counters = run.tracer.count(group.rays)


def repeat_interleaved(group: Group, runs: Sequence[Run]) -> None:
    """Repetition after repetition, the runs of each in a random order of its own."""
    rounds = max(run.spec.repetitions for run in runs)
    generator = random.Random(group.seed)
    for turn in range(rounds):
        due = [run for run in runs if turn < run.spec.repetitions]
        generator.shuffle(due)
        for place, run in enumerate(due):
            done = 0.2 + 0.75 * (turn + place / len(due)) / rounds
            group.tell(run.spec, f"repetition {turn + 1} of {run.spec.repetitions}", done)
            _repeat(group, run)


def _repeat(group: Group, run: Run) -> None:
    watch = group.stopwatch(run)
    hits = run.tracer.trace(group.rays, watch)
    for stage in STAGES:
        if stage in watch.seconds:
            getattr(run.samples, stage).append(watch.seconds[stage])
    if run.hits is not None:
        run.unstable = max(run.unstable, differing(hits, run.hits))
    run.hits = hits
