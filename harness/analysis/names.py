"""Names of runs for people: tracers in order, labels, structures, stand-ins, numbers with three digits."""

from __future__ import annotations

import re

from harness.records.roofline_row import RooflineBody
from harness.records.run_row import RunBody
from harness.records.schema import GridFacts
from harness.spec.run_spec import SIZES, STAND_IN
from harness.spec.structure import structure_from_json

RATES = ("traverse", "intersect", "total")
WORKLOAD = ["scene", "view", "rays", "seed"]
SAME_WORK = [*WORKLOAD, "grid", "beside"]  # `grid` alone does not tell adaptive grids of different densities apart


def scene_and_size(scene: str) -> tuple[str, str]:
    """A recorded scene's name without its size, and the size: `("crown", "1/4")`; `1` for a whole scene."""
    base, mark, size = scene.rpartition("@")
    return (base, size) if mark and size in SIZES else (scene, "1")


def stand_in_name(scene: str) -> str:
    """A stand-in's name in a folder that also holds the real scene: `sponza-stand-in`, `sponza-stand-in@1/4`."""
    base, size = scene_and_size(scene)
    return base + STAND_IN + ("" if size == "1" else f"@{size}")


def plain(name: str) -> str:
    """A scene's name without case, spaces and hyphens."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def options_text(options: dict[str, str]) -> str:
    """Options as a variant's name writes them."""
    return ":".join(f"{key}={value}" for key, value in sorted(options.items()))


def variant_text(run: RunBody | RooflineBody) -> str:
    """`tracer:intersector:option=value` of a run."""
    return ":".join(part for part in (run.tracer, run.intersector, options_text(run.options)) if part)


def grid_text(grid: GridFacts | None) -> str:
    """`8/128 total`, the name and options of a structure that is no grid, or nothing where a tracer uses none."""
    if grid is None:
        return ""
    if grid.top is None or grid.leaf is None:
        return str(structure_from_json({"reading": grid.reading, "options": grid.options or {}}))
    return f"{grid.top}/{grid.leaf} {grid.reading}"


def beside_text(run: RunBody) -> str:
    """The grid that a run was asked for, with its density or options; of a tracer without one, that of the runs it
    stood beside, and nothing where it stood alone. Runs on the same rays with the same were interleaved.
    """
    asked = run.spec.get("grid") or (run.grid.as_json() if run.grid else {})
    place = f"{asked['top']}/{asked['leaf']}" if "top" in asked else ""
    options = [f"{key}={value}" for key, value in sorted((asked.get("options") or {}).items())]
    return " ".join(str(part) for part in (place, asked.get("reading"), asked.get("density"), *options) if part)


def three_digits(value: float) -> str:
    """A measured value: three significant digits with their zeros, `4.00`, `0.140`; whole thousands."""
    if abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:#.3g}".rstrip(".") if abs(value) >= 1e-3 else f"{value:.2g}"


def short_number(value: float) -> str:
    """Three significant digits, no exponent, thousands as k, M or G: `0.58`, `4.73`, `142`, `3.54M`."""
    for size, unit in ((1e9, "G"), (1e6, "M"), (1e4, "k")):
        if abs(value) >= size:
            return _digits(value / (1e3 if unit == "k" else size)) + unit
    return _digits(value)


def two_digits(value: float) -> str:
    """Two significant digits, enough to see where a method fails: `0.52`, `940`, `1e6`."""
    if value < 1000:
        return f"{value:.2g}" if value < 100 else f"{value:.0f}"
    return f"{value:.0e}".replace("e+0", "e")


def _digits(value: float) -> str:
    if value == 0:
        return "0"
    if abs(value) < 1e-3:
        return f"{value:.2g}"
    text = f"{value:.3g}"
    return f"{value:.0f}" if "e" in text else text
