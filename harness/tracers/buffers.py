"""Buffers on the device that are kept from wave to wave and from batch to batch."""

from __future__ import annotations

import numpy as np

from harness.device.opened import Device
from harness.device.runtime import cl
from harness.tracers.batch import BatchTooLarge


class Buffers:
    """int32 arrays by name: memory that is touched for the first time costs more than what is done with it."""

    def __init__(self, device: Device):
        self.device = device
        self._kept: dict[str, cl.array.Array] = {}

    def get(self, name: str, count: int) -> cl.array.Array:
        """An int32 array of at least `count`, the same at every call until it has to grow. Raises BatchTooLarge."""
        if 4 * count > self.device.max_allocation_bytes:
            raise BatchTooLarge(f"{4 * count / 2**20:.1f} MiB for its {name}")
        if name not in self._kept or len(self._kept[name]) < count:
            self._kept.pop(name, None)  # freed before its successor is made
            self._kept[name] = cl.array.empty(self.device.queue, max(count, 1), np.int32)
        return self._kept[name]

    def sizes(self) -> dict[str, int]:
        """Bytes of each."""
        return {name: array.nbytes for name, array in self._kept.items()}

    def clear(self) -> None:
        """Free them all."""
        self._kept.clear()
