"""Dragon: a classic, small enough to try things on."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(
    name="dragon",
    title="Dragon",
    triangles=871_414,
    files=(("stanford_dragon.npz", "06fe710d4f4d79b6b860977aeb50b9971fc749b4e5fe0e69be8be46fc8df8f85"),),
    real_views=(View((0.0, 0.16, 0.32), (-0.005, 0.12, 0.0), fov_degrees=40.0, name="front"),),
    licence="see the source",
    credit="Stanford 3D Scanning Repository",
)
