"""Bunny: a classic, small enough to try things on."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(
    name="bunny",
    title="Bunny",
    triangles=69_451,
    files=(("stanford_bunny.npz", "5be6e1c67f2ae9a5e4565c1ca5a159b022ca845b5e9b6709d0bd396ca51d6a0d"),),
    real_views=(View((-0.02, 0.14, 0.28), (-0.02, 0.10, 0.0), fov_degrees=40.0, name="front"),),
    licence="see the source",
    credit="Stanford 3D Scanning Repository",
)
