"""What a device can do at most, measured beside the kernels that are held against it (Williams, Waterman & Patterson
2009, "Roofline"): bytes a second of copying, from memory and from the last cache, and flops a second of fused
multiply-adds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.device.opened import Device
from harness.device.program import LOCAL_SIZE, build
from harness.device.runtime import cl

VECTORS = 16  # vectors that a work-item copies
CHAINS = 10  # independent sums in kernels/studies/ceilings.cl
ROUNDS = 16384  # steps of each chain
TURNS = 4  # copies from memory: samples last tens of milliseconds, to see as much of a busy machine as kernels do
LEAST_COPY = 128 << 20  # bytes of the array that is copied, unless the device has a larger cache
CACHED_TURNS = 160  # copies of the array that stays in the cache
UNITS = {"memory": "bytes/s", "cache": "bytes/s", "fma": "flop/s"}


@dataclass(frozen=True)
class Sizes:
    """Bytes of the two arrays of a copy together: `memory` far more than the last cache holds, `cache` a quarter of
    it. `lanes`: floats of a vector."""

    memory: int
    cache: int
    lanes: int


class Ceilings:
    """Kernels and arrays that measure the three ceilings; `measure` may be called any number of times."""

    def __init__(self, device: Device):
        self.device, self.lanes = device, device.native_lanes
        self.program = build(device, "studies/ceilings.cl", lanes=self.lanes, defines={"VECTORS": VECTORS})
        last_cache = int(device.handle.global_mem_cache_size) or 8 << 20
        most = min(device.max_allocation_bytes, device.memory_bytes // 8)
        self.memory_items = self._items(min(max(LEAST_COPY, 4 * last_cache), most))
        self.cache_items = self._items(last_cache // 8)
        self.fma_items = 16 * LOCAL_SIZE * device.compute_units
        floats = self.memory_items * VECTORS * self.lanes
        self.source, self.target = (cl.array.zeros(device.queue, floats, np.float32) for _ in range(2))
        self.sums = cl.array.empty(device.queue, self.fma_items, np.float32)
        self.measure()

    def _items(self, size: int) -> int:
        """Whole work-groups that copy about `size` bytes."""
        group = LOCAL_SIZE * VECTORS * self.lanes * 4
        return max(size // group, self.device.compute_units) * LOCAL_SIZE

    @property
    def sizes(self) -> Sizes:
        """What is copied."""
        return Sizes(2 * self._bytes(self.memory_items), 2 * self._bytes(self.cache_items), self.lanes)

    def _bytes(self, items: int) -> int:
        return items * VECTORS * self.lanes * 4

    def measure(self) -> dict[str, float]:
        """One sample of each ceiling: bytes read and written a second from `memory` and `cache`, flop/s of `fma`.

        Device time alone. A cache line that is fetched only to be overwritten is not counted, as in STREAM.
        """
        memory = [self._copy(self.memory_items) for _ in range(TURNS)]
        cache = [self._copy(self.cache_items) for _ in range(CACHED_TURNS + 1)][1:]
        fma = self.program.launch("chain_fmas", self.fma_items, ROUNDS, np.float32(0.5), np.float32(1), self.sums)
        self.device.queue.finish()
        flops = 2 * CHAINS * ROUNDS * self.lanes * self.fma_items
        return {
            "memory": 2 * self._bytes(self.memory_items) * len(memory) / seconds_of(memory),
            "cache": 2 * self._bytes(self.cache_items) * len(cache) / seconds_of(cache),
            "fma": flops / seconds_of([fma]),
        }

    def _copy(self, items: int) -> cl.Event:
        return self.program.launch("copy_vectors", items, items, self.source, self.target)


def seconds_of(events: list[cl.Event]) -> float:
    """Device time of finished events, added up."""
    return sum(1e-9 * (event.profile.end - event.profile.start) for event in events)
