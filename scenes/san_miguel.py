"""San Miguel: a courtyard with arcades, trees of single leaves, tables and tableware."""

from __future__ import annotations

from harness.data import View
from scenes import Recipe

RECIPE = Recipe(
    name="san-miguel",
    title="San Miguel",
    triangles=9_388_826,
    files=(
        ("san_miguel_a.npz", "680e30683c3ab3669fd671d426b6de127738f4cb2905f7d01d683cbf186386c0"),
        ("san_miguel_b.npz", "0aec474a6b9137a62c829e92fe0a6f484ace4b54737c104a0e21265dcf365a87"),
    ),
    real_views=(
        View((6.37319, -5.62511, 1.53861), (7.09618, -4.94254, 1.64532), (0, 0, 1), 60.0, "courtyard"),
        View((27.6255, -2.42353, 1.49616), (26.6582, -2.17012, 1.48803), (0, 0, 1), 60.0, "tables"),
    ),
    licence="CC BY 3.0",
    credit="Guillermo M. Leal Llaguno",
    up="z",
    paper=True,
)
