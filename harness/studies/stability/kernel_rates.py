"""How many tests a second an intersector makes on its own: every ray against every triangle of a small mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from harness.data import Rays, Scene
from harness.device.opened import Device
from harness.records.stability_row import KernelRate
from harness.reference.check import Checker
from harness.spec.intersectors import Intersector
from harness.stats import interleaved, interval
from harness.studies.stability.closed_meshes import icosphere
from harness.tracers import open_tracer
from harness.tracers.prepared import Prepared

RAYS = 1 << 15
REPETITIONS = 7
SEED = 12111


def kernel_rates(
    device: Device,
    methods: Sequence[tuple[Intersector, str]],
    tell: Callable[[int | None, str], None] = lambda *_: None,
    rays: int = RAYS,
    repetitions: int = REPETITIONS,
) -> list[KernelRate]:
    """The rate of each in its mode; where the check of its hits fails there is none.

    Repetitions are interleaved in random order. A mesh of 1,280 triangles stays in cache: the rate is that of
    arithmetic. A test is one ray with one triangle.
    """
    prepared, shot = _icosphere(device, rays)
    tests = rays * len(prepared.scene)
    runs, verdicts = {}, {}
    checker = Checker(prepared.scene.triangles, shot)
    for place, (entry, mode) in enumerate(methods):
        tell(place, "warming up")
        runs[entry.name, mode] = open_tracer(prepared, f"brute:{entry.name}:contraction={mode}")
        verdicts[entry.name, mode] = checker.check(runs[entry.name, mode].timed(shot)[0])
    samples: dict[tuple, list[float]] = {key: [] for key in runs}
    for turn, _, key in interleaved(list(runs), repetitions, SEED):
        tell(None, f"repetition {turn + 1}")
        samples[key].append(tests / runs[key].timed(shot)[1]["intersect"])
    return [
        KernelRate(
            intersector=name,
            contraction=mode,
            wrong=sum(getattr(verdicts[name, mode], kind) for kind in ("t_off", "wrong", "missed", "phantom")),
            tests_per_second=interval(values) if verdicts[name, mode].valid else None,
        )
        for (name, mode), values in samples.items()
    ]


def _icosphere(device: Device, count: int) -> tuple[Prepared, Rays]:
    generator = np.random.Generator(np.random.Philox(key=[SEED, 0]))
    vertices, faces = icosphere(3, generator)
    scene = Scene("icosphere", vertices[faces].astype(np.float32))
    origins = (generator.random((count, 3)) - 0.5) * 0.34
    directions = 2 * generator.random((count, 3)) - 1
    limit = np.full(count, np.inf, np.float32)
    rays = Rays(origins.astype(np.float32), directions.astype(np.float32), limit)
    return Prepared.on_device(scene, device), rays
