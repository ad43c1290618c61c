"""Crytek Sponza: a long atrium between two storeys of columns and arches, with drapes."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(
    name="sponza",
    title="Sponza",
    triangles=279_163,
    files=(("sponza.npz", "edc6ab861383bdefa2a2dffbfa335f557449ae1ab25aa3da0640d2db2239d0ed"),),
    real_views=(View((-1150.0, 260.0, -40.0), (900.0, 330.0, -40.0), fov_degrees=65.0, name="atrium"),),
    licence="CC BY 3.0",
    credit="Frank Meinl, Crytek, 2010, after Marko Dabrovic",
    paper=True,
)
