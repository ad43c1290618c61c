"""What runs share: a scene, on a device, in a structure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from harness import structures
from harness.data import Scene
from harness.device.opened import Device
from harness.reference.embree_scene import EmbreeScene
from harness.spec.structure import StructureSpec
from harness.structures.contract import Structure
from harness.structures.device_scene import DeviceScene, upload_scene


@dataclass(frozen=True, eq=False)
class Prepared:
    """What a group of runs shares: the scene, the device, the scene on the device, and the structure.

    `hierarchies`: Embree's, by whether they are robust, built when first asked for and kept for all of the scene.
    """

    scene: Scene
    device: Device | None = None
    device_scene: DeviceScene | None = None
    structure: Structure | None = None
    hierarchies: dict[bool, EmbreeScene] = field(default_factory=dict, repr=False)

    def hierarchy(self, robust: bool = True) -> EmbreeScene:
        """Embree's hierarchy of all triangles."""
        if robust not in self.hierarchies:
            self.hierarchies[robust] = EmbreeScene(self.scene.triangles, robust)
        return self.hierarchies[robust]

    @classmethod
    def on_device(cls, scene: Scene, device: Device, active: np.ndarray | None = None) -> Prepared:
        """The scene uploaded, without a structure; `active` bool[n] saves looking for zero-area triangles."""
        return cls(scene, device, upload_scene(device, scene.triangles, active))

    def with_structure(self, structure: Structure | StructureSpec, overlap: str = "padded") -> Prepared:
        """The same scene in a structure, built where a spec is given; `overlap` as `structures.build` takes it.

        Raises DefrayError for a structure that makes no sense or does not fit.
        """
        if isinstance(structure, StructureSpec):
            structure = structures.build(self.device_scene, structure, overlap)
        return replace(self, structure=structure)
