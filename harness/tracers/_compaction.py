"""List compaction of the deferred tracer: the rays that a next wave walks."""

from __future__ import annotations

import functools

import numpy as np

from harness.device import Device
from harness.program import build
from harness.runtime import cl
from harness.tracers._base import Batch

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
    program = build(device, "compact.cl")
    rays = (active, batch.positions, batch.keys, batch.t_exit)
    program.launch("keep_in_blocks", blocks, count, size, *rays, kept, block_kept)
    program.launch("join_blocks", 1, blocks, size, kept, block_kept)
    return int(block_kept.get()[blocks])


@functools.cache
def unfinished_scan(device: Device):
    """List compaction: a ray stays while it is in the grid and its best t lies beyond the cells walked."""
    from pyopencl.scan import GenericScanKernel

    return GenericScanKernel(
        device.context,
        np.int32,
        arguments=(
            "__global int *active, __global int *kept, __global ulong *positions, __global ulong *keys, "
            "__global float *t_exit, __global int *total"
        ),
        input_expr=(
            "(positions[active[i]] != 0xffffffffffffffffUL"
            " && as_float((uint)(keys[active[i]] >> 32)) > t_exit[active[i]]) ? 1 : 0"
        ),
        scan_expr="a+b",
        neutral="0",
        output_statement="""
            if (prev_item != item) kept[prev_item] = active[i];
            if (i == N - 1) total[0] = item;
        """,
    )
