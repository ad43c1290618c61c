"""defray: the benchmark harness for deferred ray tracing."""

from harness.data import GridSpec, Hits, Rays, Scene, View

__version__ = "0.1.0"
__all__ = ["GridSpec", "Hits", "Rays", "Scene", "View", "load_scene", "trace"]


def __getattr__(name: str):
    """`trace` and `load_scene` import OpenCL and mesh readers, so they are looked up when first used."""
    if name == "trace":
        from harness.pipeline import trace

        return trace
    if name == "load_scene":
        from harness.scene import load_scene

        return load_scene
    raise AttributeError(f"module 'harness' has no attribute '{name}'")
