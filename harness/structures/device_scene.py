"""A scene on a device: its triangles, which of them have an area, and their bounds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from harness.data import check_scale
from harness.device.opened import Device
from harness.device.program import build
from harness.device.runtime import cl
from harness.errors import DefrayError
from harness.reference.exact import zero_area
from harness.spec.intersectors import Intersector


@dataclass(frozen=True, eq=False)
class DeviceScene:
    """Triangles on the device. `active`: the triangles that have an area, in ascending order.

    `triangles` float32[n*9], `active` int32[m]; `lower`, `upper` float64[3] bound the triangles.
    `stored` keeps the triangles in the form that the latest precomputing intersector wants, float32[n*12].
    """

    device: Device
    triangles: cl.array.Array
    active: cl.array.Array
    active_count: int
    lower: np.ndarray
    upper: np.ndarray
    stored: dict = field(default_factory=dict, repr=False)


def upload_scene(device: Device, triangles: np.ndarray, active: np.ndarray | None = None) -> DeviceScene:
    """Copy triangles float32[n,3,3] to the device; zero-area ones stay in the numbering but are not active.

    `active`: bool[n], the triangles that have an area, where it is known already.
    """
    active = np.flatnonzero(~zero_area(triangles) if active is None else active).astype(np.int32)
    if not len(active):
        raise DefrayError("the scene has no triangle with an area (corners may coincide once rounded to float32)")
    check_scale(triangles)
    if triangles.nbytes > device.max_allocation_bytes:
        need, most = triangles.nbytes / 2**30, device.max_allocation_bytes / 2**30
        raise DefrayError(f"the triangles need {need:.1f} GiB in one buffer; {device.name} allows {most:.1f}")
    corners = triangles[active]
    return DeviceScene(
        device=device,
        triangles=cl.array.to_device(device.queue, np.ascontiguousarray(triangles, np.float32).ravel()),
        active=cl.array.to_device(device.queue, active),
        active_count=len(active),
        lower=corners.min(axis=(0, 1)).astype(np.float64),
        upper=corners.max(axis=(0, 1)).astype(np.float64),
    )


def stored_triangles(scene: DeviceScene, intersector: Intersector, defines: dict[str, int]) -> cl.array.Array:
    """The triangles as `intersector` stores them: the vertices float32[n*9], or its planes float32[n*12]."""
    if not intersector.precomputes:
        return scene.triangles
    key = (intersector.name, *defines)
    if key not in scene.stored:
        count = scene.triangles.size // 9
        stored = cl.array.empty(scene.device.queue, 12 * count, np.float32)
        program = build(scene.device, "tracers/precompute.cl", intersector=intersector.file, defines=defines)
        program.launch("precompute_triangles", count, count, scene.triangles, stored)
        scene.stored.clear()
        scene.stored[key] = stored
    return scene.stored[key]
