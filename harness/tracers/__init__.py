"""Tracers: one end-to-end strategy a file, found by listing this folder."""

from __future__ import annotations

import functools
import importlib
import pkgutil

from harness.errors import known


@functools.cache
def _classes() -> dict:
    found = {}
    for module in pkgutil.iter_modules(__path__):
        if not module.name.startswith("_"):
            tracer = importlib.import_module(f"{__name__}.{module.name}").TRACER
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
