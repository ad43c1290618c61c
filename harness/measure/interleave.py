"""Warm-up and interleaved repetitions of a group of runs."""

from __future__ import annotations

from collections.abc import Sequence

from harness.data import STAGES, Hits, differing
from harness.measure.group import Group, Run
from harness.stats import interleaved


def warm_up(group: Group, run: Run) -> None:
    """Compile and run every kernel on some of the rays, then count the work of all in an instrumented run."""
    group.tell(run.spec, "warm-up", 0.15)
    run.tracer.timed(group.rays[: run.tracer.warm_up_rays])
    run.counters = run.tracer.count(group.rays)


def repeat_interleaved(group: Group, runs: Sequence[Run]) -> None:
    """Repetition after repetition, the runs of each in a random order of its own."""
    rounds = max(run.spec.repetitions for run in runs)
    for turn, share, run in interleaved(runs, rounds, group.seed):
        if turn < run.spec.repetitions:
            done = 0.2 + 0.75 * (turn + share) / rounds
            group.tell(run.spec, f"repetition {turn + 1} of {run.spec.repetitions}", done)
            hits, seconds = run.tracer.timed(group.rays)
            for stage in STAGES:
                if stage in seconds:
                    getattr(run.samples, stage).append(seconds[stage])
            note_hits(run, hits)


def note_hits(run: Run, hits: Hits) -> None:
    """Keep a repetition's hits, and how many rays changed theirs since the one before."""
    if run.hits is not None:
        run.unstable = max(run.unstable, differing(hits, run.hits))
    run.hits = hits
