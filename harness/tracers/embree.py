"""Embree on all cores: the outside reference, robust (its default) or fast."""

from __future__ import annotations

import os
from functools import cached_property

from pydantic import Field

from harness.data import Counters, Hits, Rays
from harness.device.stopwatch import Stopwatch
from harness.reference.embree_scene import EmbreeScene
from harness.spec.tracer_facts import TracerFacts
from harness.tracers.base import Options, Tracer


class EmbreeOptions(Options):
    """`robust`: Embree's robust traversal and intersection; `threads`: 0 for every core."""

    robust: bool = True
    threads: int = Field(default=0, ge=0, le=1024)


class Embree(Tracer):
    """Embree's own hierarchy, intersector and vector code, one call a thread.

    Its total includes handing pieces of the rays to threads and masking misses, about 5 %.
    """

    name = "embree"
    needs_device = False
    needs_intersector = False
    Options = EmbreeOptions

    @cached_property
    def scene(self) -> EmbreeScene:
        """The hierarchy, built on first use and shared with other runs on the scene."""
        return self.prepared.hierarchy(self.options.robust)

    @property
    def build_seconds(self) -> float:
        """Wall clock of building the hierarchy."""
        return self.scene.build_seconds

    def trace(self, rays: Rays, watch: Stopwatch) -> Hits:
        """First hits; host memory to host memory."""
        scene, threads = self.scene, self.options.threads or len(os.sched_getaffinity(0))
        with watch.total():
            return scene.trace(rays, threads=threads)

    def count(self, rays: Rays) -> Counters:
        """Embree counts nothing."""
        return Counters()


TRACER = Embree
FACTS = TracerFacts(
    order=6,
    colour="green",
    marker="^",
)
