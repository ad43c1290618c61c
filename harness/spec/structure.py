"""What space is cut into, as text and as data, before anything is built: fields, limits, parsing, printing.

`parse_structure` reads `8/128`, `8/128 per-cell`, `adaptive density=0.3`, `auto`, or the name of any other structure
with its options, `NAME key=value ...`; printing a spec gives text that is read back as an equal one.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from harness.errors import DefrayError

# Tests of whether a triangle overlaps a cell; the first loses no ray. The order is kernels/structures/overlap.clh's.
OVERLAPS = ("padded", "closed", "open", "box")
MOST_TOP = 256  # cells per axis of the first level, which is stored whole
MOST_CELLS = 1 << 16  # leaf cells per axis; beyond, float32 cannot tell neighbours apart
MOST_ADAPTIVE_TOP = 512  # top cells along the longest axis of an adaptive grid
ADAPTIVE_LEAF = 16  # leaf cells per axis that a top cell of an adaptive grid has at most, unless said otherwise
ADAPTIVE_LEAVES = (1, 2, 4, 8, 16, 32, 64, 128)
MOST_DENSITY = 1000
GRID_READINGS = ("total", "per-cell", "adaptive")  # how records call the grids; others go by their name


@dataclass(frozen=True)
class StructureSpec(ABC):
    """What is asked of a structure. `name`: of the structure that is built, as `harness.structures.find` knows it."""

    name: ClassVar[str]

    @abstractmethod
    def to_json(self) -> dict[str, Any]:
        """As records and ids hold it; `structure_from_json` reads it back."""


@dataclass(frozen=True)
class Uniform(StructureSpec):
    """A two-level grid of one resolution (paper, section 3: 8^3 and 128^3).

    `top`: cells per axis of the first level. `leaf`: cells per axis of the second level, over the whole scene, or,
    `per_cell`, inside every top cell. Raises DefrayError for a resolution that makes no grid.
    """

    name: ClassVar[str] = "uniform"
    top: int = 8
    leaf: int = 128
    per_cell: bool = False

    def __post_init__(self) -> None:
        top, leaf = self.top, self.leaf
        if top < 1 or leaf < 1:
            raise DefrayError(f"a grid needs at least one cell per axis, not {top}/{leaf}")
        if not self.per_cell and leaf % top:
            below, above = leaf // top * top, (leaf // top + 1) * top
            fitting = f"{below} or {above}" if below else str(above)
            raise DefrayError(
                f"leaf {leaf} is not a multiple of top {top}, as '{top}/{leaf}' needs; {fitting} would do"
            )
        if top > MOST_TOP:
            raise DefrayError(f"a grid has at most {MOST_TOP} top cells per axis, not {top}")
        if self.resolution > MOST_CELLS:
            raise DefrayError(
                f"grid {self} has {self.resolution} leaf cells per axis; at most {MOST_CELLS} make sense"
            )

    @property
    def leaf_per_top(self) -> int:
        """Leaf cells per axis inside one top cell."""
        return self.leaf if self.per_cell else self.leaf // self.top

    @property
    def resolution(self) -> int:
        """Leaf cells per axis over the whole scene."""
        return self.top * self.leaf_per_top

    @property
    def reading(self) -> str:
        """How the paper's 128 is read, as records say it."""
        return "per-cell" if self.per_cell else "total"

    def to_json(self) -> dict[str, Any]:
        """`top`, `leaf` and `reading`."""
        return {"top": self.top, "leaf": self.leaf, "reading": self.reading}

    def __str__(self) -> str:
        return f"{self.top}/{self.leaf} {self.reading}"


@dataclass(frozen=True)
class Adaptive(StructureSpec):
    """A two-level grid in which every top cell has its own number of leaf cells.

    `density`: leaf cells wanted per triangle of a top cell, None for the default. `top`: cells along the longest
    axis, 0 for a number from the triangle count. `leaf`: the most leaf cells per axis in a top cell, a power of two.
    Raises DefrayError for values outside their limits.
    """

    name: ClassVar[str] = "adaptive"
    density: float | None = None
    top: int = 0
    leaf: int = ADAPTIVE_LEAF

    def __post_init__(self) -> None:
        if not 0 <= self.top <= MOST_ADAPTIVE_TOP:
            raise DefrayError(f"an adaptive grid has 0 (automatic) to {MOST_ADAPTIVE_TOP} top cells, not {self.top}")
        if self.leaf not in ADAPTIVE_LEAVES:
            allowed = ", ".join(map(str, ADAPTIVE_LEAVES))
            raise DefrayError(f"leaf of an adaptive grid must be one of {allowed}, not {self.leaf}")
        if self.density is not None and not 0 < self.density <= MOST_DENSITY:
            raise DefrayError(f"density must be above 0 and at most {MOST_DENSITY}, not {self.density}")

    def to_json(self) -> dict[str, Any]:
        """As of a uniform grid, and `density` where it is given."""
        found = {"top": self.top, "leaf": self.leaf, "reading": self.name}
        return found if self.density is None else {**found, "density": self.density}

    def __str__(self) -> str:
        leaf = None if self.leaf == ADAPTIVE_LEAF else self.leaf
        shown = {"top": self.top or None, "leaf": leaf, "density": self.density}
        return " ".join([self.name, *(f"{key}={value:g}" for key, value in shown.items() if value is not None)])


@dataclass(frozen=True)
class Auto(StructureSpec):
    """No structure yet: a cost model chooses one when scene, rays and device are known (harness/tuning)."""

    name: ClassVar[str] = "auto"

    def to_json(self) -> dict[str, Any]:
        """Zeros, which no grid has."""
        return {"top": 0, "leaf": 0, "reading": self.name}

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Named(StructureSpec):
    """Any other structure by its name, with options as text; the structure's own file validates them."""

    name: str = ""  # type: ignore[misc]  # a field here: the name is what is asked for
    options: tuple[tuple[str, str], ...] = field(default=())

    def to_json(self) -> dict[str, Any]:
        """`reading` is the name, beside the options."""
        return {"reading": self.name, "options": dict(self.options)}

    def __str__(self) -> str:
        return " ".join([self.name, *(f"{key}={value}" for key, value in self.options)])


AUTO = Auto()


def parse_structure(text: str) -> StructureSpec:
    """The spec that `text` says; raises DefrayError for what cannot be read or makes no sense."""
    first, *fields = text.split() or [""]
    if re.fullmatch(r"\d+/\d+", first) and (not fields or fields in (["total"], ["per-cell"])):
        top, leaf = map(int, first.split("/"))
        return Uniform(top, leaf, per_cell=fields == ["per-cell"])
    if not fields and first in (Auto.name, Uniform.name):
        return AUTO if first == Auto.name else Uniform()
    if first == Adaptive.name:
        return _parse_adaptive(text, fields)
    if not re.fullmatch(r"[a-z][a-z0-9-]*", first) or first in (Auto.name, Uniform.name):
        raise DefrayError(
            f"'{text}' is not a structure; write top/leaf as in '8/128' or '8/128 per-cell', 'adaptive density=0.3', "
            "'auto', or a structure's name"
        )
    pairs = [_key_value(text, part) for part in fields]
    return Named(first, tuple(sorted(pairs)))


def _parse_adaptive(text: str, fields: Sequence[str]) -> Adaptive:
    kinds = {"top": int, "leaf": int, "density": float}
    values: dict[str, Any] = {}
    for part in fields:
        key, _, value = part.partition("=")
        try:
            values[key] = kinds[key](value)
        except (KeyError, ValueError):
            raise DefrayError(f"'{part}' in '{text}' is not of the form top=N, leaf=N or density=X") from None
    return Adaptive(**values)


def _key_value(text: str, part: str) -> tuple[str, str]:
    key, equals, value = part.partition("=")
    if not (key and equals and value):
        raise DefrayError(f"'{part}' in '{text}' is not of the form option=value")
    return key, value


def structure_from_json(value: Mapping[str, Any]) -> StructureSpec:
    """The spec whose `to_json` is `value`; raises DefrayError."""
    reading = value.get("reading", "total")
    try:
        if reading in ("total", "per-cell"):
            return Uniform(value["top"], value["leaf"], per_cell=reading == "per-cell")
        if reading == Auto.name:
            return AUTO
        if reading == Adaptive.name:
            return Adaptive(value.get("density"), value["top"], value["leaf"])
        return Named(str(reading), tuple(sorted(value.get("options", {}).items())))
    except (KeyError, TypeError, AttributeError):
        raise DefrayError(f"{dict(value)} is not a structure") from None


def structure_spec(value: StructureSpec | str | Mapping[str, Any]) -> StructureSpec:
    """A spec from what a user may say: a spec, its text, or its JSON; raises DefrayError."""
    if isinstance(value, StructureSpec):
        return value
    return parse_structure(value) if isinstance(value, str) else structure_from_json(value)
