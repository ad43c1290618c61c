"""defray: the benchmark harness for deferred ray tracing."""

from __future__ import annotations

import importlib

__version__ = "0.1.0"
__all__ = ["Adaptive", "Hits", "Rays", "Scene", "Uniform", "View", "load_scene", "trace"]
# Some import OpenCL and mesh readers, and the command line shows its help without any: each when first used.
_HOMES = {
    **dict.fromkeys(("Hits", "Rays", "Scene", "View"), "harness.data"),
    **dict.fromkeys(("Adaptive", "Uniform"), "harness.spec.structure"),
    "load_scene": "harness.inputs.scenes_by_name",
    "trace": "harness.engine",
}


def __getattr__(name: str):
    """What the package offers, from the module where it lives."""
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'harness' has no attribute '{name}'")
