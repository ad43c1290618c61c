"""Prefix sums, compaction and sorting on the device, from pyopencl's library."""

from __future__ import annotations

import functools

import numpy as np
from pyopencl.algorithm import RadixSort
from pyopencl.scan import ExclusiveScanKernel, GenericScanKernel

from harness.device.opened import Device
from harness.device.runtime import cl


@functools.cache
def number_scan(device: Device, empty: int):
    """Numbers the leaf cells marked 1, in place, makes the others `empty`, and tells how many there are."""
    return GenericScanKernel(
        device.context,
        np.int32,
        arguments="__global int *leaves, __global int *total",
        input_expr="leaves[i]",
        scan_expr="a+b",
        neutral="0",
        output_statement=f"""
            leaves[i] = prev_item == item ? (int)({empty + 2**32}u) : prev_item;
            if (i == N - 1) total[0] = item;
        """,
    )


def offsets(device: Device, counts: cl.array.Array) -> int:
    """Turn counts uint32[n] into offsets, in place; returns their sum."""
    total = int(cl.array.sum(counts, dtype=np.int64).get())
    exclusive_scan(device)(counts)
    return total


@functools.cache
def exclusive_scan(device: Device):
    """In-place exclusive prefix sum of a 32-bit array."""
    kernels = {
        np.dtype(dtype): ExclusiveScanKernel(device.context, dtype, "a+b", neutral="0")
        for dtype in (np.int32, np.uint32)
    }
    return lambda array: kernels[array.dtype](array)


@functools.cache
def rank_scan(device: Device):
    """Occupancy words to (occupancy, non-empty cells before) pairs, and the total."""
    kernel = GenericScanKernel(
        device.context,
        np.uint32,
        arguments="__global uint *occupancy, __global uint *bricks, __global uint *total",
        input_expr="popcount(occupancy[i])",
        scan_expr="a+b",
        neutral="0",
        output_statement="""
            bricks[2 * i] = occupancy[i];
            bricks[2 * i + 1] = item - popcount(occupancy[i]);
            if (i == N - 1) total[0] = item;
        """,
    )
    return kernel


@functools.cache
def chunk_scan(device: Device, lanes: int):
    """Exclusive prefix sum of ceil(count / lanes): the first chunk of each bin."""
    return GenericScanKernel(
        device.context,
        np.int32,
        arguments="__global int *cell_count, __global int *chunk_start",
        input_expr=f"(i < N - 1 ? (cell_count[i] + {lanes - 1}) / {lanes} : 0)",
        scan_expr="a+b",
        neutral="0",
        output_statement="chunk_start[i] = prev_item;",
    )


@functools.cache
def unfinished_scan(device: Device):
    """List compaction: a ray stays while it is in the grid and its best t lies beyond the cells walked."""
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


@functools.cache
def library_sort(device: Device):
    """pyopencl's radix sort of uint64[n] by their upper half."""
    key = "(uint)(pairs[i] >> 32)"
    return RadixSort(device.context, "__global ulong *pairs", key_expr=key, sort_arg_names=["pairs"])
