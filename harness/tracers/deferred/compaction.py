"""List compaction of the deferred tracer: the rays that a next wave walks."""

from __future__ import annotations

import numpy as np

from harness.device.opened import Device
from harness.device.primitives import unfinished_scan
from harness.device.program import build
from harness.device.runtime import cl
from harness.tracers.batch import Batch

BLOCKS = 64  # parts of a list that a CPU's work-items stream through, whatever their number


def compact(device: Device, active, kept, batch: Batch, count: int) -> int:
    """Copy the unfinished rays of `active` to `kept`, in order; returns their number.

    The library's scan takes 10 ns a ray on a CPU, where ten times less do; elsewhere it is used.
    """
    if device.is_cpu:
        return _compact_in_blocks(device, active, kept, batch, count)
    total = cl.array.empty(device.queue, 1, np.int32)
    unfinished_scan(device)(active, kept, batch.positions, batch.keys, batch.t_exit, total, size=count)
    return int(total.get()[0])


def blocks_of(count: int) -> tuple[int, int]:
    """Number and size of the blocks of a list of `count`."""
    size = max(-(-count // BLOCKS), 1)
    return -(-count // size), size


def _compact_in_blocks(device: Device, active, kept, batch: Batch, count: int) -> int:
    blocks, size = blocks_of(count)
    block_kept = cl.array.empty(device.queue, BLOCKS + 1, np.int32)
    program = build(device, "tracers/deferred/compact.cl")
    rays = (active, batch.positions, batch.keys, batch.t_exit)
    program.launch("keep_in_blocks", blocks, count, size, *rays, kept, block_kept)
    program.launch("join_blocks", 1, blocks, size, kept, block_kept)
    return int(block_kept.get()[blocks])
