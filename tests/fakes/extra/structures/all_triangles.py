"""The simplest structure there is: one cell that holds every triangle."""

from __future__ import annotations

import numpy as np

from harness.device.runtime import cl
from harness.spec.structure import StructureSpec
from harness.structures.base import Structure
from harness.structures.device_scene import DeviceScene


class AllTriangles(Structure):
    """One list of all triangles that have an area."""

    name = "all-triangles"
    header = "structures/all_triangles_walk.clh"

    @classmethod
    def build(cls, scene: DeviceScene, spec: StructureSpec, overlap: str = "padded") -> AllTriangles:
        """Nothing to build: the list of active triangles is the cell's."""
        start = np.array([0, scene.active_count], np.int32)
        return cls(
            spec=spec,
            cell_start=cl.array.to_device(scene.device.queue, start),
            references=scene.active,
            nonempty=1,
            build_seconds=0.0,
        )

    @property
    def arguments(self) -> tuple:
        """A walk needs nothing to know, but a kernel needs an argument."""
        return (np.int32(0),)

    @property
    def table_bytes(self) -> int:
        """There is no table."""
        return 0

    @property
    def most_cells_met(self) -> int:
        """The one there is."""
        return 1


STRUCTURE = AllTriangles
