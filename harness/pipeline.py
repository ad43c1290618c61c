"""From a scene to checked hits and records: scene → rays → grid → trace → check → record."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from harness.data import GridSpec, Hits, Rays, Scene
from harness.measure import Group, Progress, describe_run, repeat_interleaved, warm_up
from harness.spec import RunSpec

__all__ = ["Progress", "run_group", "trace"]


def trace(
    scene: Scene,
    rays: Rays,
    tracer: str = "deferred",
    intersector: str = "ray-space",
    grid: GridSpec | str = "auto",
    device=None,
    **options,
) -> Hits:
    """First hits of `rays` in `scene`.

    `grid` is a GridSpec, or a text that `plan.parse_grid` reads; `auto`, the default, chooses it and the deferred
    tracer's wave and batch by a cost model, which is fitted to the device when it is first needed. `device` is an
    opened Device, a part of a device's name, or None for the default. `options` are the tracer's. Raises DefrayError
    for unknown names, bad rays, a grid that does not fit, or no device.
    """
    from harness import tracers
    from harness.auto import prepare_grid
    from harness.device import Device, open_device
    from harness.intersectors import find
    from harness.plan import parse_grid
    from harness.rays import checked
    from harness.stopwatch import Stopwatch
    from harness.tracers._base import Setting, parse_options

    kind = tracers.find(tracer)
    test = find(intersector) if kind.needs_intersector else None
    setting = Setting(scene)
    if kind.needs_device:
        device = device if isinstance(device, Device) else open_device(device)
        setting = Setting.on_device(scene, device)
    named, rays = {name: str(value) for name, value in options.items()}, checked(rays)
    if kind.needs_grid:
        parse_options(kind, named)
        spec = parse_grid(grid) if isinstance(grid, str) else grid
        built, choice = prepare_grid(setting, rays, spec, kind.name, test, named)
        setting, named = replace(setting, grid=built), choice.options_for(kind.name, named) if choice else named
    watch = Stopwatch(device.queue if kind.needs_device else None)
    return kind(setting, test, named).trace(rays, watch)


def run_group(
    specs: Sequence[RunSpec], device, progress: Callable[[Progress], None] | None = None
) -> Iterator[tuple[RunSpec, dict]]:
    """Measure runs that share scene, rays and grid; yields each spec with the body of its record.

    Every variant is warmed up, repetitions are interleaved in random order, and every run's hits are checked.
    Raises DefrayError for anything that cannot be run.
    """
    group = Group(specs, device, progress or (lambda _: None))
    runs = [group.open_run(spec) for spec in specs]
    for run in runs:
        warm_up(group, run)
    repeat_interleaved(group, runs)
    for run in runs:
        agreement = group.check(run, runs)
        yield run.spec, describe_run(group, run, agreement)
