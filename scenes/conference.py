"""Conference room: a table with chairs, wall panels and lamps."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(
    name="conference",
    title="Conference",
    triangles=331_179,
    files=(("conference.npz", "51dc8144abca976101cb411a430b56e4e55fe241ba8663d43f22ecf417a4fcfa"),),
    real_views=(View((1300.0, 420.0, -560.0), (-200.0, 60.0, 60.0), fov_degrees=65.0, name="room"),),
    licence="unknown",
    credit="Anat Grynberg and Greg Ward, recreated by Kenzie Lamar",
    paper=True,
)
