"""Tracers: one end-to-end strategy a file, or a folder with a file `tracer.py`, found by listing folders.

The folders are this one, and `tracers` in each that DEFRAY_EXTRA names.
"""

from __future__ import annotations

from harness.errors import DefrayError, known
from harness.files import module_of
from harness.spec import intersectors
from harness.spec.run_spec import Variant
from harness.spec.tracer_facts import listed_tracers
from harness.tracers.base import Tracer, parse_options
from harness.tracers.prepared import Prepared


def names() -> list[str]:
    """Names of all tracers."""
    return sorted(listed_tracers())


def find(name: str) -> type[Tracer]:
    """The tracer class called `name`; raises DefrayError listing the known ones, or for a file that fails to load."""
    listed = listed_tracers()
    if name not in listed:
        raise known("tracer", name, names())
    return module_of("tracers", listed[name].file).TRACER


def check_variant(variant: Variant) -> Variant:
    """`variant` with tracer, intersector and options known; a missing intersector becomes ray-space."""
    tracer = find(variant.tracer)
    parse_options(tracer, variant.options)
    if not tracer.needs_intersector:
        if variant.intersector:
            raise DefrayError(f"tracer '{variant.tracer}' has its own intersector; leave '{variant.intersector}' out")
        return variant
    intersector = variant.intersector or intersectors.DEFAULT
    intersectors.find(intersector)
    return variant.model_copy(update={"intersector": intersector})


def open_tracer(prepared: Prepared, variant: Variant | str) -> Tracer:
    """The tracer of a variant, or of its text, on what is prepared.

    Raises DefrayError for a variant that is not known, and where the device cannot run it.
    """
    variant = check_variant(Variant.parse(variant) if isinstance(variant, str) else variant)
    kind = find(variant.tracer)
    test = intersectors.find(variant.intersector) if kind.needs_intersector else None
    return kind(prepared, test, variant.options)


def needs_structure(variant: Variant) -> bool:
    """Whether the variant's tracer walks a structure."""
    return find(variant.tracer).needs_structure
