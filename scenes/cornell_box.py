"""Cornell box: a classic, small enough to try things on."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(
    name="cornell-box",
    title="Cornell box",
    triangles=36,
    files=(("cornell_box.npz", "b82910fd8f52ceb050bd88310bd8e69ea4e1348e30982e7161d04edee9117892"),),
    real_views=(View((0.0, 1.0, 3.6), (0.0, 1.0, 0.0), fov_degrees=40.0, name="front"),),
    licence="see the source",
    credit="Cornell University Program of Computer Graphics",
)
