"""Runs the stress suite: family after family, every intersector in both contraction modes."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from harness.data import Rays
from harness.device.opened import Device
from harness.errors import DefrayError
from harness.records.stability_row import StressRow
from harness.spec.intersectors import DEFAULT, INTERSECTORS, Intersector, find
from harness.spec.stress_suite import METRICS, Family
from harness.studies.stability import offsets, walks, whole_grids, whole_scenes
from harness.studies.stability.aimed_at_features import aimed_pairs
from harness.studies.stability.failures import Judge, merge
from harness.studies.stability.pairs import MODES, Pairs, PairTester
from harness.studies.stability.single_triangle import single_pairs


def chosen(name: str, device: Device) -> list[Intersector]:
    """Intersectors by name, `default` or `all`; `all` leaves out those that need doubles the device lacks."""
    if name == "all":
        return [entry for entry in INTERSECTORS.values() if device.has_double or not entry.needs_double]
    return [find(DEFAULT if name == "default" else name)]


def methods_of(intersectors: Sequence[Intersector]) -> list[tuple[Intersector, str]]:
    """Each of `intersectors` in both contraction modes."""
    return [(entry, mode) for entry in intersectors for mode in MODES]


def measure_family(
    device: Device,
    family: Family,
    methods: Sequence[tuple[Intersector, str]],
    size: str = "full",
    tell: Callable[[int | None, str], None] = lambda *_: None,
) -> Iterator[dict]:
    """Yield one row an intersector and contraction mode, with the keys of ROW.

    `size`: `full` or `smoke`. `tell` is given the place of a method, None for all of them, and what is being done.
    Raises DefrayError where inputs are not the bits that the suite froze.
    """
    tell(None, "making inputs")
    trial = TRIALS[family.kind](device, family, size)
    check_inputs(family, size, trial.digest)
    for place, (entry, mode) in enumerate(methods):
        tell(place, "measuring")
        metrics = merge(trial.measure(entry, mode))
        yield StressRow(
            intersector=entry.name,
            contraction=mode,
            family=family.id,
            size=size,
            passed=family.passes(metrics),
            **metrics,
        )


def check_inputs(family: Family, size: str, digest: str) -> None:
    """Raise DefrayError where the inputs' hash is not the frozen one."""
    frozen = family.sha256.get(size)
    if digest and frozen != digest:
        raise DefrayError(f"the {size} inputs of family {family.id} have SHA-256 {digest}, the suite froze {frozen}")


def generators(family: Family) -> Iterator[tuple[dict, np.random.Generator]]:
    """Each case with a generator of its own."""
    number = int.from_bytes(family.id.encode(), "big")
    for place, case in enumerate(family.cases):
        yield case, np.random.Generator(np.random.Philox(key=[family.seed, (number << 8) + place]))


class _PairTrial:
    """Kinds `aimed` and `single`."""

    def __init__(self, device: Device, family: Family, size: str):
        count = family.rays[size] // len(family.cases)
        make = aimed_pairs if family.kind == "aimed" else single_pairs
        self.parts = []
        hashed = hashlib.sha256()
        for case, generator in generators(family):
            pairs = make(case, count, generator)
            _hash_pairs(hashed, pairs)
            kind = next((name for name in ("coplanar", "broken") if name in case), family.kind)
            self.parts.append((PairTester(device, pairs), Judge(pairs, kind)))
        self.digest = hashed.hexdigest()

    def measure(self, intersector: Intersector, mode: str) -> list[dict]:
        """Metrics of every case."""
        return [judge.judge(tester.run(intersector, mode)) for tester, judge in self.parts]


class _SceneTrial:
    """Kinds `verify` and `scene`."""

    def __init__(self, device: Device, family: Family, size: str):
        count = family.rays[size] // len(family.cases)
        self.device, self.verify = device, family.kind == "verify"
        make = whole_scenes.verify_inputs if self.verify else whole_scenes.degenerate_inputs
        self.parts = [make(case, count, generator) for case, generator in generators(family)]
        self.digest = _hash_scenes(self.parts)
        self.settings = [whole_scenes.prepare(device, triangles) for triangles, _ in self.parts]

    def measure(self, intersector: Intersector, mode: str) -> list[dict]:
        """Metrics of every case."""
        tracer = "deferred" if self.verify else "brute"
        found = []
        for (triangles, rays), prepared in zip(self.parts, self.settings, strict=True):
            hits = whole_scenes.trace(prepared, rays, tracer, intersector, mode)
            found.append(
                whole_scenes.judge_verify(hits)
                if self.verify
                else whole_scenes.judge_degenerate(triangles, rays, hits)
            )
        return found


class _OffsetTrial:
    """Kind `offset`."""

    def __init__(self, device: Device, family: Family, size: str):
        count = family.rays[size] // len(family.cases)
        self.device, self.family = device, family
        self.parts = [
            (case, offsets.offset_inputs(case, count, generator), generator) for case, generator in generators(family)
        ]
        self.digest = _hash_scenes([shape for _, shapes, _ in self.parts for shape in shapes])

    def measure(self, intersector: Intersector, mode: str) -> list[dict]:
        """Metrics of every case."""
        found = []
        for (case, shapes, _), (_, generator) in zip(self.parts, generators(self.family), strict=True):
            found.append(offsets.judge_offsets(self.device, case, shapes, intersector, mode, generator))
        return found


class _WalkTrial:
    """Kind `walk`: the grid's walk knows no intersector, so one measurement serves all."""

    def __init__(self, device: Device, family: Family, size: str):
        self.run = functools.cache(lambda: walks.walk_family(device, family.id, family.rays[size], family.seed))
        self.digest = walks.walk_digest(family.id, family.rays[size], family.seed)

    def measure(self, intersector: Intersector, mode: str) -> list[dict]:
        """Rays with a stretch that no visited cell covers, and rays that step for too long."""
        found = self.run()
        counts = {"rays": found["rays"], "leaks": found["leaks"], "gross": found["steps_over"]}
        return [dict.fromkeys(METRICS) | counts]


class _GridTrial:
    """Kind `grid`: whole tracers against brute force."""

    def __init__(self, device: Device, family: Family, size: str):
        self.device, self.family, self.size = device, family, size
        self.digest = whole_grids.grid_digest(family.rays[size], family.seed)

    def measure(self, intersector: Intersector, mode: str) -> list[dict]:
        """Rays whose hit a grid loses or changes."""
        family = self.family
        found = whole_grids.grid_family(self.device, intersector, mode, family.rays[self.size], family.seed)
        return [dict.fromkeys(METRICS) | {"rays": found["rays"], "leaks": found["leaks"]}]


TRIALS = {
    "aimed": _PairTrial,
    "single": _PairTrial,
    "verify": _SceneTrial,
    "scene": _SceneTrial,
    "walk": _WalkTrial,
    "grid": _GridTrial,
    "offset": _OffsetTrial,
}


def _hash_pairs(hashed, pairs: Pairs) -> None:
    _hash_rays(hashed, pairs.rays)
    for array in (pairs.triangles, pairs.ray, pairs.triangle):
        hashed.update(np.ascontiguousarray(array).tobytes())


def _hash_rays(hashed, rays: Rays) -> None:
    for array in (rays.origins, rays.directions, rays.t_max):
        hashed.update(np.ascontiguousarray(array).tobytes())


def _hash_scenes(parts) -> str:
    hashed = hashlib.sha256()
    for triangles, rays in parts:
        hashed.update(np.ascontiguousarray(triangles).tobytes())
        _hash_rays(hashed, rays)
    return hashed.hexdigest()
