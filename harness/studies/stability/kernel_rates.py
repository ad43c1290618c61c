"""How many tests a second an intersector makes on its own: every ray against every triangle of a small mesh."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

import numpy as np

from harness import tracers
from harness.data import Rays, Scene
from harness.device.opened import Device
from harness.device.stopwatch import Stopwatch
from harness.records.stability_row import KernelRate
from harness.reference.check import Checker
from harness.spec.intersectors import Intersector
from harness.stats import interval
from harness.studies.stability.closed_meshes import icosphere
from harness.studies.stability.pairs import MODES
from harness.tracers.prepared import Prepared

RAYS = 1 << 15
REPETITIONS = 7
SEED = 12111


def kernel_rates(
    device: Device,
    intersectors: Sequence[Intersector],
    progress: Callable[[str, int, int], None] = lambda *_: None,
    rays: int = RAYS,
    repetitions: int = REPETITIONS,
) -> list[KernelRate]:
    """The rate of each in both modes; where the check of its hits fails there is none.

    Repetitions are interleaved in random order. A mesh of 1,280 triangles stays in cache: the rate is that of
    arithmetic. A test is one ray with one triangle.
    """
    setting, shot = _setting(device, rays)
    tests = rays * len(setting.scene)
    runs, verdicts = {}, {}
    checker = Checker(setting.scene.triangles, shot)
    for entry in intersectors:
        for mode in MODES:
            progress(f"warming up {entry.name}", len(runs), 2 * len(intersectors))
            runs[entry.name, mode] = tracers.find("brute")(setting, entry, {"contraction": mode})
            verdicts[entry.name, mode] = checker.check(runs[entry.name, mode].trace(shot, Stopwatch(device.queue)))
    samples: dict[tuple, list[float]] = {key: [] for key in runs}
    generator = random.Random(SEED)
    for turn in range(repetitions):
        order = list(runs)
        generator.shuffle(order)
        progress(f"repetition {turn + 1}", turn, repetitions)
        for key in order:
            watch = Stopwatch(device.queue)
            runs[key].trace(shot, watch)
            samples[key].append(tests / watch.seconds["intersect"])
    return [
        KernelRate(
            intersector=name,
            contraction=mode,
            wrong=sum(getattr(verdicts[name, mode], kind) for kind in ("t_off", "wrong", "missed", "phantom")),
            tests_per_second=interval(values) if verdicts[name, mode].valid else None,
        )
        for (name, mode), values in samples.items()
    ]


def _setting(device: Device, count: int) -> tuple[Prepared, Rays]:
    generator = np.random.Generator(np.random.Philox(key=[SEED, 0]))
    vertices, faces = icosphere(3, generator)
    scene = Scene("icosphere", vertices[faces].astype(np.float32))
    origins = (generator.random((count, 3)) - 0.5) * 0.34
    directions = 2 * generator.random((count, 3)) - 1
    limit = np.full(count, np.inf, np.float32)
    rays = Rays(origins.astype(np.float32), directions.astype(np.float32), limit)
    return Prepared.on_device(scene, device), rays
