"""One group of runs from a scene to checked results: scene, rays, structure, trace, check, the body of a record."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from harness.measure.group import Group, Progress, describe_run
from harness.measure.interleave import repeat_interleaved, warm_up
from harness.measure.scene import Scenes
from harness.records.run_row import RunBody
from harness.spec.run_spec import RunSpec


def run_group(
    specs: Sequence[RunSpec], scenes: Scenes, progress: Callable[[Progress], None] | None = None
) -> Iterator[tuple[RunSpec, RunBody]]:
    """Measure runs that share scene, rays and grid; yields each spec with the body of its record.

    Every variant is warmed up, repetitions are interleaved in random order, and every run's hits are checked.
    Raises DefrayError for anything that cannot be run.
    """
    group = Group(specs, scenes, progress or (lambda _: None))
    runs = [group.open_run(spec) for spec in specs]
    for run in runs:
        warm_up(group, run)
    repeat_interleaved(group, runs)
    for run in runs:
        agreement = group.check(run, runs)
        yield run.spec, describe_run(group, run, agreement)
