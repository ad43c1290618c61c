"""Scene recipes: one module a scene, found by listing this folder."""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness.data import View

# What the generators are made of, beside their own modules.
BUILDING_BLOCKS = ("shapes.py", "plants.py", "elementary.py")


@dataclass(frozen=True)
class Recipe:
    """Where a scene comes from.

    `triangles`: of the real scene. `files`: (name, SHA-256) of the npz files that hold the real geometry
    (`vertices` float32[v,3], `faces` int32[t,3]); several are joined in order. `stand_in(seed)` generates
    float32[n,3,3]; None where there is no stand-in. `described(resolutions)`: figures of its calibration that follow
    from its description, where it has no files. `paper`: one of the paper's five.
    `smaller(seed, size)`: the stand-in with that part of its triangles, where its generator makes a better one than
    decimation does.
    """

    name: str
    title: str
    triangles: int
    files: tuple[tuple[str, str], ...] = ()
    real_views: tuple[View, ...] = ()
    stand_in_views: tuple[View, ...] = ()
    stand_in: Callable[[int], np.ndarray] | None = None
    described: Callable[[tuple[int, ...]], dict[str, float]] | None = None
    licence: str = "unknown"
    credit: str = ""
    up: str = "y"
    smaller: Callable[[int, float], np.ndarray] | None = None
    paper: bool = False


@functools.cache
def recipes() -> dict[str, Recipe]:
    """All recipes by scene name, the paper's first."""
    found = []
    for module in pkgutil.iter_modules(__path__):
        recipe = getattr(importlib.import_module(f"{__name__}.{module.name}"), "RECIPE", None)
        if recipe:
            found.append(recipe)
    found.sort(key=lambda recipe: (not recipe.paper, recipe.triangles))
    return {recipe.name: recipe for recipe in found}
