"""Sibenik: a classic, small enough to try things on."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(
    name="sibenik",
    title="Sibenik",
    triangles=75_284,
    files=(("sibenik.npz", "ba76daeab06e5834d694264497c6af47e65a73c1490d72830d14973756d48759"),),
    real_views=(View((-16.0, -11.0, 0.0), (4.0, -10.0, 0.0), fov_degrees=70.0, name="nave"),),
    licence="see the source",
    credit="Marko Dabrovic, 2002",
)
