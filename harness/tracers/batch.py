"""A batch of rays on the device, its outputs poisoned."""

from __future__ import annotations

import numpy as np

from harness.data import Hits, Rays
from harness.device.opened import Device
from harness.device.runtime import cl

POISON = 0xA5  # outputs are filled with this byte before a run, so that a kernel that writes nothing shows


class Batch:
    """Rays on the device: inputs, the ray records the kernels read, and poisoned outputs.

    `rays`: 32 bytes a ray; `keys` uint64[n], best hits; `positions` uint64[n], packed leaf positions;
    `t_exit` float32[n], how far a ray has been walked.
    """

    def __init__(self, device: Device, rays: Rays):
        queue = device.queue
        self.count = len(rays)
        self.origins, self.directions, self.t_max = (
            cl.array.to_device(queue, np.ascontiguousarray(values, np.float32).ravel())
            for values in (rays.origins, rays.directions, rays.t_max)
        )
        self.rays = poisoned(queue, 8 * self.count, np.float32)
        self.keys = poisoned(queue, self.count, np.uint64)
        self.positions = poisoned(queue, self.count, np.uint64)
        self.t_exit = poisoned(queue, self.count, np.float32)
        self.hits = [poisoned(queue, self.count, d) for d in (np.float32, np.int32, np.float32, np.float32)]

    def download(self) -> Hits:
        """The hits, on the host."""
        return Hits(*(array.get() for array in self.hits))


def poisoned(queue: cl.CommandQueue, count: int, dtype) -> cl.array.Array:
    """An array on the device filled with the poison byte."""
    array = cl.array.empty(queue, count, dtype)
    cl.enqueue_fill_buffer(queue, array.data, np.uint8(POISON), 0, array.nbytes)
    return array


class BatchTooLarge(Exception):
    """The pairs of a batch exceed the device's memory; the message says how much they need."""
