"""Fits the cost model to a device, once for an intersector and a state of the kernels, and keeps it on file."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from harness import tracers
from harness.adaptive import AdaptiveGrid
from harness.cache import cache_folder
from harness.cost_model import CostModel, Run, fit
from harness.data import GridSpec, Rays
from harness.device import Device
from harness.grid import build_grid
from harness.intersectors import Intersector
from harness.program import KERNELS
from harness.rays import make_rays
from harness.sampling import counted_work, padding, sample_rays, some_of
from harness.stopwatch import CpuStopwatch, Stopwatch
from harness.tracers._base import Setting

SCENES = ("sponza", "conference")  # as stand-ins, which are at hand everywhere
DENSITIES = (0.075, 0.3, 1.2)
# Deferred, of fewer rays more of the time goes into reading triangles for the first time.
RAYS = {"deferred": 1 << 20, "forward": 1 << 16}
REPETITIONS = 2
FAST = {"arrange": "record", "pairs": "copy"}  # deferred options that the model is fitted with
SETTINGS = {
    "deferred": [{**FAST, "wave": "2"}, {**FAST, "wave": "4"}, {**FAST, "wave": "8", "growth": "2"}],
    "forward": [{}],
}
FORM = 2  # of the file


def per_axis(grid: AdaptiveGrid) -> float:
    """Leaf cells per axis of a top cell in use, the root mean cube."""
    return (grid.cells / max(grid.blocks, 1)) ** (1 / 3)


def cost_model(
    device: Device, tracer: str, intersector: Intersector, tell: Callable[[str], None] | None = None
) -> CostModel:
    """The model of a device, from its file or fitted now, which takes a minute or so; `tell` hears of it first."""
    file = model_file(device, tracer, intersector)
    with contextlib.suppress(OSError, ValueError):
        return CostModel.model_validate_json(file.read_text())
    if tell:
        tell(f"fitting the cost model of {tracer}:{intersector.name} to this device, once; a minute or two")
    model = fit(tracer, measured_runs(device, tracer, intersector, _calibration_scenes(RAYS[tracer])))
    partial = file.with_name(f"{file.name}.{os.getpid()}")
    with contextlib.suppress(OSError):  # a cache that cannot be written costs time, no more
        file.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(model.model_dump_json(indent=1) + "\n")
        os.replace(partial, file)
    return model


def model_file(device: Device, tracer: str, intersector: Intersector) -> Path:
    """Where the model is kept: another driver, number of cores or kernel source is another file."""
    known = (FORM, device.platform, device.name, device.version, device.driver, device.compute_units)
    return cache_folder() / f"cost-{tracer}-{intersector.name}-{_digest(*known, kernels_digest())}.json"


def _digest(*parts) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


@functools.cache
def kernels_digest() -> str:
    """Of the source of all kernels and of the tracers that launch them."""
    folders = (KERNELS, Path(tracers.__file__).parent)
    files = sorted(file for folder in folders for file in folder.rglob("*") if file.suffix in (".cl", ".clh", ".py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


@functools.cache
def _calibration_scenes(rays: int) -> tuple[tuple, ...]:
    """Scenes and that many rays of each."""
    from harness.scene import stand_in_scene
    from scenes import recipes

    made = [stand_in_scene(recipes()[name]) for name in SCENES]
    return tuple((scene, make_rays(scene, "diffuse", rays)) for scene in made)


def measured_runs(device: Device, tracer: str, intersector: Intersector, scenes: Sequence[tuple]) -> list[Run]:
    """Runs of every scene, density and setting, repetitions interleaved; the shortest of each counts."""
    runs = []
    for scene, rays in scenes:
        setting = Setting.on_device(scene, device)
        for density in DENSITIES:
            grid = build_grid(setting.device_scene, GridSpec(0, 16, "adaptive", density))
            runs += _on_grid(replace(setting, grid=grid), tracer, intersector, rays)
    return runs


def stopwatch(device: Device) -> Stopwatch:
    """One that other work on the machine disturbs little."""
    return CpuStopwatch(device) if device.is_cpu else Stopwatch(device.queue)


def _on_grid(setting: Setting, tracer: str, intersector: Intersector, rays: Rays) -> list[Run]:
    kind, grid = tracers.find(tracer), setting.grid
    made = [(kind(setting, intersector, options), options) for options in SETTINGS[tracer]]
    for one, _ in made:
        one.trace(rays, stopwatch(setting.device))
    times: list[list[dict]] = [[] for _ in made]
    for _ in range(REPETITIONS):
        for (one, _), taken in zip(made, times, strict=True):
            watch = stopwatch(setting.device)
            one.trace(rays, watch)
            taken.append(dict(watch.seconds))
    sample = sample_rays(made[0][0], some_of(rays))
    runs = []
    for (one, options), taken in zip(made, times, strict=True):
        best = min(taken, key=lambda seconds: seconds["total"])
        counters = one.count(rays)
        work = counted_work(counters, len(rays), grid.nonempty)
        run = Run(tracer, setting.scene.name, len(rays), best, work, per_axis(grid), grid.nonempty,
                  len(grid.references), setting=repr(options))
        if tracer == "deferred":
            wave, growth = int(options["wave"]), int(options.get("growth", 1))
            _, per_wave = sample.deferred_work(wave, growth, len(rays))
            empty = padding(per_wave * len(rays), grid.nonempty, one.lanes) / len(rays)
            run = replace(run, predicted_padding=empty)
        runs.append(run)
    return runs
