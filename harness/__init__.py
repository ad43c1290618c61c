"""defray: the benchmark harness for deferred ray tracing."""

from __future__ import annotations

from harness.data import Hits, Rays, Scene, View
from harness.spec.structure import Adaptive, Uniform

__version__ = "0.1.0"
__all__ = ["Adaptive", "Hits", "Rays", "Scene", "Uniform", "View", "load_scene", "trace"]


def __getattr__(name: str):
    """`trace` and `load_scene` import OpenCL and mesh readers, so they are looked up when first used."""
    if name == "trace":
        from harness.engine import trace

        return trace
    if name == "load_scene":
        from harness.inputs.scenes import load_scene

        return load_scene
    raise AttributeError(f"module 'harness' has no attribute '{name}'")
