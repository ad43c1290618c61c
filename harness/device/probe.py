"""Compile and run one kernel on one OpenCL device, in a process of its own: a broken runtime may crash.

Run by path (`python -P harness/device/probe.py list`, `... run PLATFORM DEVICE`), with the environment that
`harness.device.runtime` prepared; prints one line of JSON. Imports nothing of the package.
"""

from __future__ import annotations

import json
import sys
import warnings

SOURCE = """
#ifdef cl_khr_int64_extended_atomics
#pragma OPENCL EXTENSION cl_khr_int64_extended_atomics : enable
#endif
kernel void probe(global const float *in, global float *out, global ulong *least)
{
    size_t i = get_global_id(0);
    float16 x = vload16(i, in);
    vstore16(fma(x, x, (float16)(1.0f)), i, out);
#ifdef cl_khr_int64_extended_atomics
    atom_min(least, ((ulong)as_uint(in[16 * i]) << 32) | (uint)(1000 - i));
#endif
}
"""
ITEMS = 64


def list_devices(cl) -> list[dict]:
    """Every device's place, platform, name, version and kind, without running anything on it."""
    return [
        {
            "place": [p, d],
            "platform": platform.name.strip(),
            "name": device.name.strip(),
            "version": device.version.strip(),
            "is_cpu": bool(device.type & cl.device_type.CPU),
        }
        for p, platform in enumerate(cl.get_platforms())
        for d, device in enumerate(platform.get_devices())
    ]


def run_probe(cl, platform: int, device: int) -> str:
    """Empty when the kernel's numbers are right; otherwise what is wrong. Raises what pyopencl raises."""
    import numpy as np

    handle = cl.get_platforms()[platform].get_devices()[device]
    context = cl.Context([handle])
    queue = cl.CommandQueue(context)
    flags = cl.mem_flags
    values = np.arange(1, 16 * ITEMS + 1, dtype=np.float32)
    least = np.full(1, 2**64 - 1, dtype=np.uint64)
    source = cl.Buffer(context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=values)
    result = cl.Buffer(context, flags.WRITE_ONLY, values.nbytes)
    minimum = cl.Buffer(context, flags.READ_WRITE | flags.COPY_HOST_PTR, hostbuf=least)
    program = cl.Program(context, SOURCE).build()
    program.probe(queue, (ITEMS,), (ITEMS // 4,), source, result, minimum)
    out = np.empty_like(values)
    cl.enqueue_copy(queue, out, result)
    cl.enqueue_copy(queue, least, minimum)
    queue.finish()
    if not np.array_equal(out, values * values + 1):
        return "the probe kernel's float16 fma gave wrong numbers"
    expected = (int(np.float32(1).view(np.uint32)) << 32) | 1000
    if "cl_khr_int64_extended_atomics" in handle.extensions and int(least[0]) != expected:
        return "the probe kernel's 64-bit atomic minimum gave a wrong number"
    return ""


def main(arguments: list[str]) -> None:
    """Print the answer to `list` or `run PLATFORM DEVICE` as the last line of standard output."""
    import pyopencl as cl

    warnings.simplefilter("ignore")
    if arguments[0] == "list":
        try:
            answer = list_devices(cl)
        except cl.LogicError as error:
            if error.code != cl.status_code.PLATFORM_NOT_FOUND_KHR:
                raise
            answer = []
    else:
        answer = run_probe(cl, int(arguments[1]), int(arguments[2]))
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
