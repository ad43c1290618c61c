"""What a scene will take in memory, said before it is loaded."""

from __future__ import annotations

import os
from collections.abc import Iterable

from harness.errors import DefrayError

LARGE = 10_000_000  # triangles from which memory is announced
# Bytes a triangle. On the device: corners, number, three references as they are built. In main memory: a scene's
# triangles, a copy of them, Embree's hierarchy and the sums over all triangles that check them.
DEVICE_BYTES, MAIN_BYTES = 80, 290


def memory(triangles: int) -> tuple[int, int]:
    """Bytes that tracing a scene of so many triangles takes about: on the device, and in main memory."""
    return DEVICE_BYTES * triangles, MAIN_BYTES * triangles


def check_memory(name: str, triangles: int, device) -> None:
    """Refuse a scene that cannot fit before it is made; `device` may be None. Raises DefrayError."""
    on_device, in_main = memory(triangles)
    limits = [(in_main, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"), "this machine")]
    if device is not None:
        limits.append((on_device, device.memory_bytes, device.name))
        limits.append((36 * triangles, device.max_allocation_bytes, f"one buffer of {device.name}"))
    for need, limit, where in limits:
        if need > limit:
            raise DefrayError(
                f"scene {name} of about {triangles:,} triangles needs about {need / 2**30:.1f} GiB; "
                f"{where} has {limit / 2**30:.1f} GiB"
            )


def announcements(triangles: Iterable[tuple[str, int | None]]) -> list[str]:
    """A line for each scene, given with its size, that takes much memory."""
    lines = []
    for name, count in triangles:
        if count and count >= LARGE:
            on_device, in_main = (f"{need / 2**30:.1f} GiB" for need in memory(count))
            lines.append(f"{name}: about {count:,} triangles, {on_device} on the device, {in_main} of main memory")
    return lines
