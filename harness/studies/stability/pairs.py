"""Intersectors on given pairs of rays and triangles, on the device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.data import Rays
from harness.device.opened import Device
from harness.device.program import build
from harness.device.runtime import cl
from harness.errors import DefrayError
from harness.spec.intersectors import Intersector

SAID, ACCEPTED = 1, 2
MODES = ("off", "on")


@dataclass(frozen=True, eq=False)
class Pairs:
    """Which ray meets which triangle: `ray`, `triangle` int32[m], sorted by ray; triangles float32[n,3,3]."""

    rays: Rays
    triangles: np.ndarray
    ray: np.ndarray
    triangle: np.ndarray

    def __len__(self) -> int:
        return len(self.ray)


@dataclass(frozen=True, eq=False)
class Answers:
    """What an intersector answers to pairs.

    `said` bool[m]: it says inside. `accepted` bool[m]: and its t lies in (0, t_max] by the driver's rule. `t`
    float32[m], in units of the ray's direction; `u`, `v` float32[m].
    """

    said: np.ndarray
    accepted: np.ndarray
    t: np.ndarray
    u: np.ndarray
    v: np.ndarray


class PairTester:
    """Rays, triangles and pairs on the device, for one intersector after the other."""

    def __init__(self, device: Device, pairs: Pairs):
        self.device, self.pairs = device, pairs
        rays = pairs.rays
        limit = np.nextafter(rays.t_max, np.float32(np.inf))  # the driver's comparison is strict
        arrays = (pairs.ray, pairs.triangle, rays.origins, rays.directions, limit, pairs.triangles)
        dtypes = (np.int32, np.int32, *[np.float32] * 4)
        to_device = cl.array.to_device
        self._arrays = [
            to_device(device.queue, np.ascontiguousarray(a, d).ravel()) for a, d in zip(arrays, dtypes, strict=True)
        ]

    def run(self, intersector: Intersector, contraction: str = "off") -> Answers:
        """Every pair's answer, with `contraction` of a * b + c "off" or "on".

        Raises DefrayError where the intersector needs double precision and the device has none.
        """
        if intersector.needs_double and not self.device.has_double:
            raise DefrayError(f"{self.device.name} has no double precision, which {intersector.name} needs")
        defines = {"CONTRACT": 1} if contraction == "on" else {}
        count, queue = len(self.pairs), self.device.queue
        *inputs, triangles = self._arrays
        stored = self._stored(intersector, defines, triangles)
        said = cl.array.zeros(queue, count, np.int32)
        outputs = [cl.array.empty(queue, count, np.float32) for _ in range(3)]
        for output in outputs:
            output.fill(np.float32(np.nan))
        lanes = self.device.native_lanes
        program = build(self.device, "studies/pairs.cl", intersector=intersector.file, lanes=lanes, defines=defines)
        program.launch("test_pairs", -(-count // lanes), count, *inputs, stored, said, *outputs)
        flags = said.get()
        return Answers((flags & SAID) != 0, (flags & ACCEPTED) != 0, *(output.get() for output in outputs))

    def _stored(self, intersector: Intersector, defines: dict, triangles):
        """The triangles in the intersector's own form."""
        if not intersector.precomputes:
            return triangles
        count = triangles.size // 9
        stored = cl.array.empty(self.device.queue, 12 * count, np.float32)
        program = build(self.device, "tracers/precompute.cl", intersector=intersector.file, defines=defines)
        program.launch("precompute_triangles", count, count, triangles, stored)
        return stored


def contracts(device: Device) -> dict[str, bool]:
    """Whether a * b + c is contracted on this device in each mode: `{"off": False, "on": True}` as it should be."""
    generator = np.random.default_rng(12111)
    a, b = (generator.random(4096, np.float32) + 1 for _ in range(2))
    answer = {}
    for mode in MODES:
        defines = {"CONTRACT": 1} if mode == "on" else {}
        rest = cl.array.empty(device.queue, len(a), np.float32)
        product = cl.array.to_device(device.queue, a * b)
        left, right = (cl.array.to_device(device.queue, values) for values in (a, b))
        program = build(device, "studies/contraction.cl", defines=defines)
        program.launch("product_rest", len(a), len(a), left, right, product, rest)
        answer[mode] = bool(np.any(rest.get() != 0))
    return answer
