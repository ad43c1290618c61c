"""What space is cut into, as text and data: fields, limits, parsing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from harness.errors import DefrayError, known

# Tests whether a triangle overlaps a cell; the first loses no ray. The order is that of the kernels' numbers.
OVERLAPS = ("padded", "closed", "open", "box")
ADAPTIVE_LEAF = 16  # leaf cells per axis that a top cell of an adaptive grid has at most, unless said otherwise


@dataclass(frozen=True)
class GridSpec:
    """Resolution of a two-level grid (paper, section 3: 8^3 and 128^3).

    `top`: cells per axis of the first level. `leaf`: cells per axis of the second level, over the whole
    scene (`reading='total'`) or inside every top cell (`reading='per-cell'`).

    `reading='adaptive'`: every top cell has its own number of leaf cells. Then `top` counts the cells along the
    longest axis, 0 for a number from the triangle count; `leaf`, a power of two, is the most leaf cells per axis in
    a top cell; `density` is the number of leaf cells wanted per triangle of a top cell, None for the default.

    `reading='auto'` (AUTO): an adaptive grid that a cost model chooses when scene, rays and device are known.
    """

    top: int = 8
    leaf: int = 128
    reading: str = "total"
    density: float | None = None

    @property
    def leaf_per_top(self) -> int:
        """Leaf cells per axis inside one top cell; the most, of an adaptive grid."""
        return self.leaf // self.top if self.reading == "total" else self.leaf

    @property
    def resolution(self) -> int:
        """Leaf cells per axis over the whole scene; 0 where that is known only when the grid is built."""
        return self.top * self.leaf_per_top

    def __str__(self) -> str:
        if self.reading == "auto":
            return "auto"
        if self.reading == "adaptive":
            shown = {"top": self.top or None, "leaf": self.leaf, "density": self.density}
            shown["leaf"] = None if self.leaf == ADAPTIVE_LEAF else self.leaf
            return " ".join(["adaptive", *(f"{key}={value:g}" for key, value in shown.items() if value is not None)])
        return f"{self.top}/{self.leaf} {self.reading}"


AUTO = GridSpec(top=0, leaf=0, reading="auto")


def parse_grid(text: str) -> GridSpec:
    """`8/128`, `8/128 per-cell`, `adaptive`, `adaptive density=0.3 top=64` or `auto` as a checked GridSpec."""
    first, *fields = text.split() or [""]
    if text.strip() == "auto":
        return AUTO
    if first == "adaptive":
        return _parse_adaptive(text, fields)
    match = re.fullmatch(r"(\d+)/(\d+)(?:\s+([a-z-]+))?", text.strip())
    if not match:
        raise DefrayError(
            f"'{text}' is not a grid; write top/leaf and a reading, as in '8/128 total', or "
            "'adaptive density=0.3', or 'auto'"
        )
    return check_grid(GridSpec(int(match[1]), int(match[2]), match[3] or "total"))


def _parse_adaptive(text: str, fields: Sequence[str]) -> GridSpec:
    kinds = {"top": int, "leaf": int, "density": float}
    values: dict[str, Any] = {}
    for field in fields:
        key, _, value = field.partition("=")
        try:
            values[key] = kinds[key](value)
        except (KeyError, ValueError):
            raise DefrayError(f"'{field}' in '{text}' is not of the form top=N, leaf=N or density=X") from None
    return make_grid(reading="adaptive", **values)


def make_grid(
    top: int | None = None,
    leaf: int | None = None,
    reading: str = "total",
    density: float | None = None,
    grid: str | None = None,
) -> GridSpec:
    """A checked GridSpec; what is None takes the default of the reading. `grid`: the same in one text, alone."""
    if grid is not None:
        if (top, leaf, reading, density) != (None, None, "total", None):
            raise DefrayError(f"grid '{grid}' says all of --top, --leaf, --reading and --density; leave them out")
        return parse_grid(grid)
    usual = (0, ADAPTIVE_LEAF) if reading == "adaptive" else (8, 128)
    return check_grid(
        GridSpec(usual[0] if top is None else top, usual[1] if leaf is None else leaf, reading, density)
    )


READINGS = ("total", "per-cell", "adaptive")
MOST_TOP = 256  # cells per axis of the first level, which is stored whole
MOST_CELLS = 1 << 16  # leaf cells per axis; beyond, float32 cannot tell neighbours apart
MOST_ADAPTIVE_TOP = 512  # top cells along the longest axis of an adaptive grid
ADAPTIVE_LEAVES = (1, 2, 4, 8, 16, 32, 64, 128)
MOST_DENSITY = 1000


def check_grid(grid: GridSpec) -> GridSpec:
    """`grid` itself; raises DefrayError for a resolution that makes no grid."""
    if grid == AUTO:
        return grid
    if grid.reading not in READINGS:
        raise known("reading", grid.reading, READINGS)
    if grid.reading == "adaptive":
        return _check_adaptive(grid)
    if grid.density is not None:
        raise DefrayError(f"a density belongs to reading 'adaptive', not to '{grid.reading}'")
    if grid.top < 1 or grid.leaf < 1:
        raise DefrayError(f"a grid needs at least one cell per axis, not {grid.top}/{grid.leaf}")
    if grid.reading == "total" and grid.leaf % grid.top:
        below, above = grid.leaf // grid.top * grid.top, (grid.leaf // grid.top + 1) * grid.top
        fitting = f"{below} or {above}" if below else str(above)
        raise DefrayError(
            f"leaf {grid.leaf} is not a multiple of top {grid.top}, as reading 'total' needs; {fitting} would do"
        )
    if grid.top > MOST_TOP:
        raise DefrayError(f"a grid has at most {MOST_TOP} top cells per axis, not {grid.top}")
    if grid.resolution > MOST_CELLS:
        raise DefrayError(f"grid {grid} has {grid.resolution} leaf cells per axis; at most {MOST_CELLS} make sense")
    return grid


def _check_adaptive(grid: GridSpec) -> GridSpec:
    if not 0 <= grid.top <= MOST_ADAPTIVE_TOP:
        raise DefrayError(f"an adaptive grid has 0 (automatic) to {MOST_ADAPTIVE_TOP} top cells, not {grid.top}")
    if grid.leaf not in ADAPTIVE_LEAVES:
        allowed = ", ".join(map(str, ADAPTIVE_LEAVES))
        raise DefrayError(f"leaf of an adaptive grid must be one of {allowed}, not {grid.leaf}")
    if grid.density is not None and not 0 < grid.density <= MOST_DENSITY:
        raise DefrayError(f"density must be above 0 and at most {MOST_DENSITY}, not {grid.density}")
    return grid
