"""Plans: counts, grids and variants as people write them, and tiers of a TOML file as lists of runs."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from harness.data import ADAPTIVE_LEAF, AUTO, GridSpec
from harness.errors import DefrayError, known
from harness.ladder import SIZES
from harness.record import first_problem
from harness.spec import RAY_KINDS, Check, RunSpec, Variant, check_grid

UNITS = {"": 1, "k": 1_000, "M": 1_000_000, "G": 1_000_000_000}


def parse_count(text: str | int) -> int:
    """`64k`, `1M`, `2.5M`, `1_000_000` or a number as an integer; decimal units: 1M is 1,000,000."""
    match = re.fullmatch(
        r"([0-9]+(?:\.[0-9]+)?)([kKmMgG]?)", str(text).strip().replace("_", "").replace(",", "")
    )
    if not match:
        raise DefrayError(f"'{text}' is not a count; write 64k, 1M or 1000000")
    unit = "k" if match[2] in "kK" and match[2] else match[2].upper()
    count = Fraction(match[1]) * UNITS[unit]
    if count.denominator != 1:
        raise DefrayError(f"'{text}' is not a count: not a whole number")
    if count <= 0:
        raise DefrayError(f"a count must be above zero, not '{text}'")
    return int(count)


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


def check_variant(variant: Variant) -> Variant:
    """`variant` with tracer, intersector and options known; a missing intersector becomes ray-space."""
    from harness import intersectors, tracers
    from harness.tracers._base import parse_options

    tracer = tracers.find(variant.tracer)
    parse_options(tracer, variant.options)
    if not tracer.needs_intersector:
        if variant.intersector:
            raise DefrayError(
                f"tracer '{variant.tracer}' has its own intersector; leave '{variant.intersector}' out"
            )
        return variant
    intersector = variant.intersector or "ray-space"
    intersectors.find(intersector)
    return variant.model_copy(update={"intersector": intersector})


def needs_grid(variant: Variant) -> bool:
    """Whether the variant's tracer walks a grid."""
    from harness import tracers

    return tracers.find(variant.tracer).needs_grid


def make_spec(scene: str, variant: Variant, **fields: Any) -> RunSpec:
    """A checked RunSpec; raises DefrayError for anything that could not run whatever the scene."""
    kind, ray_file = fields.get("kind", "diffuse"), fields.get("ray_file")
    if kind not in RAY_KINDS:
        raise known("kind of rays", kind, RAY_KINDS)
    if (kind == "file") != (ray_file is not None):
        raise DefrayError("rays of kind 'file' need a ray file (--ray-file), and a ray file needs kind 'file'")
    if ray_file is not None and not Path(ray_file).is_file():
        what = "is a folder" if ray_file and Path(ray_file).is_dir() else "does not exist"
        raise DefrayError(f"ray file '{ray_file}' {what}")
    if fields.get("grid") is None and needs_grid(variant):
        raise DefrayError(f"tracer '{variant.tracer}' needs a grid")
    try:
        return RunSpec(scene=scene, variant=check_variant(variant), **fields)
    except ValidationError as error:
        raise DefrayError(first_problem(error)) from None


def interleaved(
    scene: str, variants: Sequence[Variant], grids: Sequence[GridSpec], **fields: Any
) -> Iterable[RunSpec]:
    """Specs of all variants on all grids.

    A tracer without a grid is measured beside the runs of every grid: it belongs to their group, so that its
    repetitions interleave with theirs and ratios to it are paired. Where no variant walks a grid it has none.
    """
    if not any(map(needs_grid, variants)):
        grids = []
    for variant in variants:
        for grid in grids or [None]:
            yield make_spec(scene, variant, grid=grid, **fields)


# ---------------------------------------------------------------- tiers in a TOML file

_listed = BeforeValidator(lambda value: value if isinstance(value, list) else [value])


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class SweepEntry(_Strict):
    """One sweep: the product of all its lists. A single value may stand for a list of one."""

    name: str
    scenes: Annotated[list[str], _listed]
    sizes: Annotated[list[str], _listed] = Field(default_factory=lambda: ["1"])
    grids: Annotated[list[str], _listed] = Field(default_factory=list)
    variants: Annotated[list[str], _listed]
    kinds: Annotated[list[str], _listed] = Field(default_factory=lambda: ["diffuse"])
    rays: Annotated[list[str | int], _listed] = Field(default_factory=lambda: ["1M"])
    seeds: Annotated[list[int], _listed] = Field(default_factory=lambda: [1])
    views: Annotated[list[str], _listed] = Field(default_factory=list)
    repetitions: int = Field(default=3, gt=0)
    check: Check = "embree"

    def rungs(self) -> list[str]:
        """Every scene in every size there is of it; raises DefrayError for an unknown scene or size."""
        from harness.scene import check_name, enlargeable

        for size in self.sizes:
            if size not in SIZES:
                raise known("size", size, SIZES)
        for scene in self.scenes:
            check_name(scene)
        made = [f"{scene}@{size}" if size != "1" else scene for scene, size in product(self.scenes, self.sizes)
                if SIZES[size] <= 1 or enlargeable(scene)]
        return list(dict.fromkeys(made))

    def specs(self) -> list[RunSpec]:
        """All runs of the product, in the order of the lists."""
        variants = [Variant.parse(text) for text in self.variants]
        grids = [parse_grid(text) for text in self.grids]
        made: list[RunSpec] = []
        for scene, kind, rays, seed, view in product(
            self.rungs(), self.kinds, self.rays, self.seeds, self.views or [None]
        ):
            common = {"kind": kind, "rays": parse_count(rays), "seed": seed, "view": view}
            common |= {"repetitions": self.repetitions, "check": self.check}
            made += interleaved(scene, variants, grids, **common)
        return made


class Tier(_Strict):
    """Sweeps that are run together; `include` takes over those of other tiers of the file."""

    about: str = ""
    include: list[str] = Field(default_factory=list)
    sweeps: list[SweepEntry] = Field(default_factory=list)


class SweepFile(_Strict):
    """A whole sweep file: tiers by name."""

    tiers: dict[str, Tier]


def read_sweep_file(path: Path | str) -> SweepFile:
    """Read and validate a sweep file; raises DefrayError naming the file and the bad field."""
    try:
        with open(path, "rb") as file:
            return SweepFile.model_validate(tomllib.load(file))
    except OSError as error:
        raise DefrayError(f"cannot read {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DefrayError(f"{path}: not TOML: {error}") from None
    except ValidationError as error:
        raise DefrayError(f"{path}: {first_problem(error)}") from None


def expand(path: Path | str, tier: str) -> list[RunSpec]:
    """All different runs of a tier and the tiers it includes, in the file's order."""
    file = read_sweep_file(path)
    runs: dict[str, RunSpec] = {}
    for name in _with_included(file, tier, path):
        for entry in file.tiers[name].sweeps:
            try:
                runs |= {spec.id: spec for spec in entry.specs() if spec.id not in runs}
            except DefrayError as error:
                raise DefrayError(f"{path}: tier {name}, sweep '{entry.name}': {error}") from None
    if not runs:
        raise DefrayError(f"{path}: tier '{tier}' has no runs")
    return list(runs.values())


def _with_included(file: SweepFile, tier: str, path: Path | str) -> list[str]:
    """`tier` after all tiers that it includes, each once."""
    order: list[str] = []

    def visit(name: str, above: tuple[str, ...]) -> None:
        if name not in file.tiers:
            raise DefrayError(f"{path}: {known('tier', name, file.tiers)}")
        if name in above:
            raise DefrayError(f"{path}: tier '{name}' includes itself")
        for included in file.tiers[name].include:
            visit(included, (*above, name))
        if name not in order:
            order.append(name)

    visit(tier, ())
    return order
