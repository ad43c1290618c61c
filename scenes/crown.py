"""Imperial crown: a jewelled crown of dense small geometry on a wide ground."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(
    name="crown",
    title="Crown",
    triangles=3_532_946,
    files=(("crown.npz", "eb7bb2e9086c1475fff85aba523260809739818ce68751f8adfd076aa439fb6b"),),
    real_views=(View((0.0, 5.5, 24.0), (0.0, 11.0, -10.0), fov_degrees=47.0, name="front"),),
    licence="see the author",
    credit="Martin Lubich",
    paper=True,
)
