"""From a scene to checked hits and records: scene → rays → grid → trace → check → record."""

from __future__ import annotations

from dataclasses import replace

from harness import tracers
from harness.data import Hits, Rays, Scene
from harness.device.opened import Device, open_device
from harness.device.stopwatch import Stopwatch
from harness.inputs.rays import checked
from harness.spec.intersectors import find
from harness.spec.structure import GridSpec, parse_grid
from harness.tracers.base import parse_options
from harness.tracers.prepared import Prepared
from harness.tuning.choose import prepare_grid


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
    kind = tracers.find(tracer)
    test = find(intersector) if kind.needs_intersector else None
    setting = Prepared(scene)
    if kind.needs_device:
        device = device if isinstance(device, Device) else open_device(device)
        setting = Prepared.on_device(scene, device)
    named, rays = {name: str(value) for name, value in options.items()}, checked(rays)
    if kind.needs_grid:
        parse_options(kind, named)
        spec = parse_grid(grid) if isinstance(grid, str) else grid
        built, choice = prepare_grid(setting, rays, spec, kind.name, test, named)
        setting, named = replace(setting, grid=built), choice.options_for(kind.name, named) if choice else named
    watch = Stopwatch(device.queue if kind.needs_device else None)
    return kind(setting, test, named).trace(rays, watch)
