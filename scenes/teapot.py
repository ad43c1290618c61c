"""Teapot: a classic, small enough to try things on."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(
    name="teapot",
    title="Teapot",
    triangles=6_320,
    files=(("teapot.npz", "3ad788e2ae9e5b5b106d47d7eceba735dfff9dafbb003abb2ca93680d65ed8de"),),
    real_views=(View((2.0, 5.0, 9.0), (0.2, 1.4, 0.0), fov_degrees=40.0, name="front"),),
    licence="see the source",
    credit="Martin Newell, 1975",
)
