"""Tracers: one end-to-end strategy a file, or a folder with a file `tracer.py`, found by listing folders.

The folders are this one, and `tracers` in each that DEFRAY_EXTRA names.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from harness.errors import DefrayError, known
from harness.spec import intersectors
from harness.spec.run_spec import Variant
from harness.spec.tracer_facts import listed_tracers
from harness.tracers.base import Tracer, parse_options


def names() -> list[str]:
    """Names of all tracers."""
    return sorted(listed_tracers())


def find(name: str) -> type[Tracer]:
    """The tracer class called `name`; raises DefrayError listing the known ones, or for a file that fails to load."""
    listed = listed_tracers()
    if name not in listed:
        raise known("tracer", name, names())
    return _load(listed[name].file).TRACER


@functools.cache
def _load(file: Path) -> ModuleType:
    """A tracer's file, imported: one of this folder as a module of it, another by its path."""
    own = Path(__file__).parent
    if file.is_relative_to(own):
        return importlib.import_module(".".join((__name__, *file.relative_to(own).with_suffix("").parts)))
    name = file.stem if file.stem != "tracer" else file.parent.name
    specification = importlib.util.spec_from_file_location(f"extra_tracer_{name}", file)
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module  # where dataclasses and pydantic look for it
    try:
        specification.loader.exec_module(module)
    except Exception as error:
        del sys.modules[specification.name]
        raise DefrayError(f"cannot load {file}: {type(error).__name__}: {error}") from error
    return module


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


def needs_grid(variant: Variant) -> bool:
    """Whether the variant's tracer walks a grid."""
    return find(variant.tracer).needs_grid
