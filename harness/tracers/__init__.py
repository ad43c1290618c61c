"""Tracers: one end-to-end strategy a file (or a folder with a file `tracer.py`), found by listing this folder."""

from __future__ import annotations

import functools
import importlib
import pkgutil

from harness.errors import DefrayError, known
from harness.spec import intersectors
from harness.spec.run_spec import Variant
from harness.tracers.base import parse_options


@functools.cache
def _classes() -> dict:
    found = {}
    for entry in pkgutil.iter_modules(__path__):
        module = importlib.import_module(f"{__name__}.{entry.name}" + (".tracer" if entry.ispkg else ""))
        tracer = getattr(module, "TRACER", None)
        if tracer:
            found[tracer.name] = tracer
    return found


def names() -> list[str]:
    """Names of all tracers."""
    return sorted(_classes())


def find(name: str):
    """The tracer class called `name`; raises DefrayError listing the known ones."""
    if name not in _classes():
        raise known("tracer", name, names())
    return _classes()[name]


def check_variant(variant: Variant) -> Variant:
    """`variant` with tracer, intersector and options known; a missing intersector becomes ray-space."""
    tracer = find(variant.tracer)
    parse_options(tracer, variant.options)
    if not tracer.needs_intersector:
        if variant.intersector:
            raise DefrayError(f"tracer '{variant.tracer}' has its own intersector; leave '{variant.intersector}' out")
        return variant
    intersector = variant.intersector or "ray-space"
    intersectors.find(intersector)
    return variant.model_copy(update={"intersector": intersector})


def needs_grid(variant: Variant) -> bool:
    """Whether the variant's tracer walks a grid."""
    return find(variant.tracer).needs_grid
