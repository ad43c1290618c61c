"""Fits the cost model to a device, once for an intersector and a state of the kernels, and keeps it on file."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from harness import stats, tracers
from harness.data import Rays
from harness.device.opened import Device
from harness.device.stopwatch import CpuStopwatch, Stopwatch
from harness.files import cache_folder
from harness.inputs.rays import make_rays
from harness.inputs.scenes_by_name import stand_in_scene
from harness.spec.intersectors import KERNELS, Intersector
from harness.spec.run_spec import Variant
from harness.spec.structure import Adaptive
from harness.spec.tracer_facts import tracer_facts
from harness.structures import adaptive
from harness.structures.adaptive import AdaptiveGrid
from harness.tracers.device_tracer import DeviceTracer
from harness.tracers.prepared import Prepared
from harness.tuning import cost_model, sampling
from harness.tuning.cost_model import CostModel, TimedRun, fit
from harness.tuning.sampling import (
    Sample,
    counted_work,
    far_bins,
    far_grid,
    far_triangles,
    sample_rays,
    some_of,
    unused_slots,
)
from scenes import recipes

# As stand-ins, which are at hand everywhere; the crown's triangles do not fit a cache.
SCENES = ("sponza", "conference", "crown")
DENSITIES = (0.075, 0.3, 1.2)
REPETITIONS = 2
SEED = 1
FORM = 5  # of the file


def per_axis(grid: AdaptiveGrid) -> float:
    """Leaf cells per axis of a top cell in use, the root mean cube."""
    return (grid.leaf_cells / max(grid.blocks, 1)) ** (1 / 3)


def cost_models(
    device: Device, tracer: str, intersector: Intersector, tell: Callable[[str], None] | None = None
) -> dict[str, CostModel]:
    """The models of the `compared` tracers, from their files or fitted now, which takes minutes; `tell` hears of it
    first."""
    fitted = compared(device, tracer)
    with contextlib.suppress(OSError, ValueError):
        texts = {name: model_file(device, name, intersector).read_text() for name in fitted}
        return {name: CostModel.model_validate_json(text) for name, text in texts.items()}
    if tell:
        tell(f"fitting the cost model of {' and '.join(fitted)} with {intersector.name} to the device, once; minutes")
    runs = measured_runs(device, fitted, intersector, _fitting_scenes(tracer_facts(tracer).fitted_rays))
    models = {name: fit(name, [run for run in runs if run.tracer == name]) for name in fitted}
    for name, model in models.items():
        _keep(model, model_file(device, name, intersector))
    return models


def compared(device: Device, tracer: str) -> tuple[str, ...]:
    """The tracers whose times are predicted beside each other: `tracer` first."""
    both = ("deferred", "streamed")
    if not device.is_cpu or tracer not in both:  # elsewhere one core's stream takes minutes
        return (tracer,)
    return tracer, *(name for name in both if name != tracer)


def _keep(model: CostModel, file: Path) -> None:
    partial = file.with_name(f"{file.name}.{os.getpid()}")
    with contextlib.suppress(OSError):  # a cache that cannot be written costs time, no more
        file.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(model.model_dump_json(indent=1) + "\n")
        os.replace(partial, file)


def model_file(device: Device, tracer: str, intersector: Intersector) -> Path:
    """Where the model is kept: another driver, number of cores or kernel source is another file."""
    known = (FORM, device.platform, device.name, device.version, device.driver, device.compute_units)
    return cache_folder() / f"cost-{tracer}-{intersector.name}-{_digest(*known, kernels_digest())}.json"


def fitted_settings(tracer: str) -> list[dict[str, str]]:
    """Options of each run that a tracer's model is fitted to."""
    facts = tracer_facts(tracer)
    return [{**facts.fast_options, **options} for options in facts.fitted_options]


def _digest(*parts) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


@functools.cache
def kernels_digest() -> str:
    """Of the source of all kernels, of the tracers that launch them, and of what builds grids and fits the model."""
    folders = (KERNELS, Path(tracers.__file__).parent)
    files = sorted(file for folder in folders for file in folder.rglob("*") if file.suffix in (".cl", ".clh", ".py"))
    files += [Path(module.__file__) for module in (adaptive, cost_model, sampling)]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


@functools.cache
def _fitting_scenes(rays: int) -> tuple[tuple, ...]:
    """Scenes and that many rays of each."""
    made = [stand_in_scene(recipes()[name]) for name in SCENES]
    return tuple((scene, make_rays(scene, "diffuse", rays)) for scene in made)


def measured_runs(
    device: Device, fitted: Sequence[str], intersector: Intersector, scenes: Sequence[tuple]
) -> list[TimedRun]:
    """Runs of every scene, density, tracer and setting, repetitions interleaved; the shortest of each counts."""
    runs = []
    for scene, rays in scenes:
        prepared = Prepared.on_device(scene, device)
        for density in DENSITIES:
            runs += _on_grid(prepared.with_structure(Adaptive(density)), fitted, intersector, rays)
    return runs


def stopwatch(device: Device) -> Stopwatch:
    """One that other work on the machine disturbs little."""
    return CpuStopwatch(device) if device.is_cpu else Stopwatch(device.queue)


def _on_grid(prepared: Prepared, fitted: Sequence[str], intersector: Intersector, rays: Rays) -> list[TimedRun]:
    made = [
        tracers.open_tracer(prepared, Variant(tracer=name, intersector=intersector.name, options=options))
        for name in fitted
        for options in fitted_settings(name)
    ]
    for one in made:
        one.trace(rays, stopwatch(prepared.device))
    times: list[list[dict]] = [[] for _ in made]
    for _, _, place in stats.interleaved(range(len(made)), REPETITIONS, SEED):
        watch = stopwatch(prepared.device)
        made[place].trace(rays, watch)
        times[place].append(dict(watch.seconds))
    sample = sample_rays(made[0], some_of(rays))
    shortest = (min(taken, key=lambda seconds: seconds["total"]) for taken in times)
    return [_run(one, sample, seconds, rays) for one, seconds in zip(made, shortest, strict=True)]


def _run(tracer: DeviceTracer, sample: Sample, seconds: dict[str, float], rays: Rays) -> TimedRun:
    """What a timed run comes to, its work counted, and its padding predicted."""
    grid, options, count = tracer.structure, tracer.options, len(rays)
    work = counted_work(tracer.count(rays), count, grid.nonempty)
    chances = sample.chances(grid.nonempty)
    work = replace(
        work,
        far=far_triangles(tracer),
        far_bins=far_bins(tracer, grid.nonempty, chances),
        far_grid=far_grid(tracer.device, grid.table_bytes),
    )
    run = TimedRun(
        tracer.name,
        tracer.prepared.scene.name,
        count,
        seconds,
        work,
        per_axis(grid),
        grid.nonempty,
        len(grid.references) - tracer.scene.active_count,
        setting=f"{tracer.name} {options}",
    )
    if tracer.name == "forward":
        return run
    _, per_wave = sample.deferred_work(int(options.wave), options.growth, min(count, options.batch))
    empty = unused_slots(tracer, grid.nonempty, per_wave, count, chances)
    return replace(run, predicted_padding=empty)
