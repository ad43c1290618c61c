"""Plans: checked specs of runs, and tiers of a sweep file as lists of them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any

from pydantic import AliasChoices, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from harness.errors import DefrayError, first_problem, known
from harness.inputs.scenes_by_name import check_name, enlargeable
from harness.spec.run_spec import RAY_KINDS, SIZES, Check, RunSpec, Variant, parse_count
from harness.spec.structure import AUTO, StructureSpec, parse_structure
from harness.structures import check_structure
from harness.tracers import check_variant, needs_structure


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
    structure = fields.get("structure")
    if structure is None and needs_structure(variant):
        raise DefrayError(f"tracer '{variant.tracer}' needs a structure")
    if structure not in (None, AUTO):
        check_structure(structure)
    try:
        return RunSpec(scene=scene, variant=check_variant(variant), **fields)
    except ValidationError as error:
        raise DefrayError(first_problem(error)) from None


def interleaved(
    scene: str, variants: Sequence[Variant], structures: Sequence[StructureSpec], **fields: Any
) -> Iterable[RunSpec]:
    """Specs of all variants in all structures.

    A tracer without a structure is measured beside the runs of every one: it belongs to their group, so that its
    repetitions interleave with theirs and ratios to it are paired. Where no variant walks a structure it has none.
    """
    if not any(map(needs_structure, variants)):
        structures = []
    for variant in variants:
        for structure in structures or [None]:
            yield make_spec(scene, variant, structure=structure, **fields)


def scene_specs(
    scenes: Sequence[str], variants: Sequence[Variant], structure: StructureSpec, **fields: Any
) -> list[list[RunSpec]]:
    """Specs of all variants on one grid, for each scene once; raises DefrayError for a scene that is not known."""
    for name in scenes:
        check_name(name)
    return [list(interleaved(name, variants, [structure], **fields)) for name in dict.fromkeys(scenes)]


_listed = BeforeValidator(lambda value: value if isinstance(value, list) else [value])


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class SweepEntry(_Strict):
    """One sweep: the product of all its lists. A single value may stand for a list of one."""

    name: str
    scenes: Annotated[list[str], _listed]
    sizes: Annotated[list[str], _listed] = Field(default_factory=lambda: ["1"])
    structures: Annotated[list[str], _listed] = Field(
        default_factory=list, validation_alias=AliasChoices("structures", "grids")
    )
    variants: Annotated[list[str], _listed]
    kinds: Annotated[list[str], _listed] = Field(default_factory=lambda: ["diffuse"])
    rays: Annotated[list[str | int], _listed] = Field(default_factory=lambda: ["1M"])
    seeds: Annotated[list[int], _listed] = Field(default_factory=lambda: [1])
    views: Annotated[list[str], _listed] = Field(default_factory=list)
    repetitions: int = Field(default=3, gt=0)
    check: Check = "embree"

    def resized_scenes(self) -> list[str]:
        """Every scene in every size there is of it; raises DefrayError for an unknown scene or size."""
        for size in self.sizes:
            if size not in SIZES:
                raise known("size", size, SIZES)
        for scene in self.scenes:
            check_name(scene)
        made = [
            f"{scene}@{size}" if size != "1" else scene
            for scene, size in product(self.scenes, self.sizes)
            if SIZES[size] <= 1 or enlargeable(scene)
        ]
        return list(dict.fromkeys(made))

    def specs(self) -> list[RunSpec]:
        """All runs of the product, in the order of the lists."""
        variants = [Variant.parse(text) for text in self.variants]
        structures = [parse_structure(text) for text in self.structures]
        made: list[RunSpec] = []
        for scene, kind, rays, seed, view in product(
            self.resized_scenes(), self.kinds, self.rays, self.seeds, self.views or [None]
        ):
            common = {"kind": kind, "rays": parse_count(rays), "seed": seed, "view": view}
            common |= {"repetitions": self.repetitions, "check": self.check}
            made += interleaved(scene, variants, structures, **common)
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
