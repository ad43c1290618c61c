"""A scene kept from group to group: on the device, with its hierarchy, rays and checkers."""

from __future__ import annotations

import functools

from harness.data import Rays, Scene
from harness.inputs.memory import LARGE, check_memory
from harness.inputs.rays import make_rays
from harness.inputs.scenes_by_name import expected_triangles, load_scene
from harness.reference.check import Checker
from harness.reference.embree_scene import EmbreeScene
from harness.reference.exact import zero_area
from harness.reference.oracle import Oracle
from harness.spec.run_spec import RunSpec
from harness.tracers.prepared import Prepared


class SharedScene:
    """A scene on the device with its Embree hierarchy, ray sets and checkers, kept from group to group."""

    def __init__(self, scene: Scene, device):
        self.scene = scene
        self.active = ~zero_area(scene.triangles)
        self.prepared = Prepared.on_device(scene, device, self.active) if device else Prepared(scene)
        self._rays: dict[tuple, Rays] = {}
        self._checkers: dict[tuple, Checker] = {}

    @property
    def embree(self) -> EmbreeScene:
        """Finds primary hits for the rays that start on surfaces; Embree's runs trace it too."""
        return self.prepared.hierarchy()

    @functools.cached_property
    def reference(self) -> EmbreeScene:
        """The checkers' hierarchy: of the triangles that take part."""
        return self.embree if self.active.all() else EmbreeScene(self.scene.triangles, active=self.active)

    @functools.cached_property
    def oracle(self) -> Oracle:
        """Settles the checkers' disputes."""
        return Oracle(self.scene.triangles, self.active)

    def rays(self, spec: RunSpec) -> Rays:
        """The ray set of a spec; the latest stays in memory."""
        key = (spec.kind, spec.rays, spec.seed, spec.view, spec.ray_file)
        if key not in self._rays:
            embree = self.embree if spec.kind in ("diffuse", "ambient-occlusion") else None
            self._rays = {key: make_rays(self.scene, *key, embree=embree)}
            self._checkers.clear()
            if len(self.scene) >= LARGE:
                self.prepared.hierarchies.clear()  # the checker builds another, and two would be too much memory
        return self._rays[key]

    def checker(self, spec: RunSpec, rays: Rays) -> Checker:
        """The checker of the latest ray set: it remembers every ray settled exactly."""
        if spec.check not in self._checkers:
            embree = self.reference if spec.check == "embree" and len(self.scene) < LARGE else None
            self._checkers[spec.check] = Checker(
                self.scene.triangles, rays, spec.check, self.active, embree, lambda: self.oracle
            )
        return self._checkers[spec.check]


class Scenes:
    """Scenes on one device, None for none; the one asked for last is kept, so that groups of one scene share it."""

    def __init__(self, device):
        self.device = device
        self._kept: dict[str, SharedScene] = {}

    def load(self, name: str) -> SharedScene:
        """The scene `name`, in place of the one kept before; raises DefrayError where it cannot be loaded."""
        if name not in self._kept:
            self.forget()
            count = expected_triangles(name)
            if count:
                check_memory(name, count, self.device)
            self._kept[name] = SharedScene(load_scene(name), self.device)
        return self._kept[name]

    def forget(self) -> None:
        """Free the scene that is kept."""
        self._kept.clear()
