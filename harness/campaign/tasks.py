"""What is asked of each study, as people write it, made into its tasks."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass

from harness.campaign.plan import scene_specs
from harness.errors import DefrayError, known
from harness.files import ROOT
from harness.inputs.scenes_by_name import check_name
from harness.spec.intersectors import DEFAULT, find
from harness.spec.run_spec import Variant, parse_count
from harness.spec.stress_suite import select, size_of
from harness.spec.structure import parse_structure
from harness.studies.errors_and_leaks import AccuracyStudy, Contender, Plan, default_contenders, parse_contenders
from harness.studies.lanes_and_lines import CoherenceStudy
from harness.studies.needed_precision import PrecisionStudy
from harness.studies.roofline.measured_kernels import RooflineStudy
from harness.studies.stability.pairs import contracts
from harness.studies.stability.stress_run import chosen
from harness.studies.stability.suite import StabilityStudy
from harness.studies.study import Task

ACCURACY_TIERS = ROOT / "harness" / "paper" / "accuracy.toml"
CHECKS = ("embree", "exact")
ROOFLINE_VARIANTS = "deferred:ray-space:arrange=record:pairs=copy,forward:ray-space"


@dataclass(frozen=True)
class AccuracyScene:
    """One scene and what is measured on it; `contenders` None stands for the default list of the device."""

    scene: str
    plan: Plan
    contenders: list[Contender] | None = None
    precision: bool = False


def accuracy_scenes(scenes: Sequence[str], tier: str | None, rays, aimed, repetitions) -> list[AccuracyScene]:
    """Scenes and counts of the tier, replaced by those of the command line.

    Raises DefrayError for what is not known.
    """
    given = {"rays": rays, "aimed": aimed, "repetitions": repetitions}
    given = {name: parse_count(value) for name, value in given.items() if value is not None}
    entries = [{"scenes": list(scenes)}]
    if tier is not None:
        tiers = tomllib.loads(ACCURACY_TIERS.read_text(encoding="utf-8"))["tiers"]
        if tier not in tiers:
            raise known("tier", tier, tiers)
        entries = [entry | ({"scenes": list(scenes)} if scenes else {}) for entry in tiers[tier]]
    found: dict[str, AccuracyScene] = {}
    for entry in entries:
        counts = {name: parse_count(entry[name]) for name in ("rays", "aimed", "repetitions") if name in entry}
        contenders = parse_contenders(",".join(entry["variants"])) if "variants" in entry else None
        for scene in entry["scenes"]:
            check_name(scene)
            precision = scene in entry.get("precision", ())
            found.setdefault(scene, AccuracyScene(scene, Plan(**(counts | given)), contenders, precision))
    if not found:
        raise DefrayError("name a scene or a tier, as in: defray accuracy sponza")
    return list(found.values())


def accuracy_tasks(scenes: Sequence[AccuracyScene], device) -> list[Task]:
    """A task for each scene; where none are named, its contenders are all that the device can run."""
    study = AccuracyStudy()
    return [
        task
        for one in scenes
        for task in study.tasks(one.scene, one.contenders or default_contenders(device), one.plan)
    ]


def precision_tasks(scenes: Sequence[AccuracyScene]) -> list[Task]:
    """A task for each scene that says so."""
    study = PrecisionStudy()
    wanted = [one for one in scenes if one.precision]
    return [task for one in wanted for task in study.tasks(one.scene, one.plan.rays, one.plan.repetitions)]


def roofline_tasks(
    scenes: Sequence[str],
    variants: str = ROOFLINE_VARIANTS,
    rays: str = "1M",
    kind: str = "diffuse",
    seed: int = 1,
    structure: str = "8/128",
    repetitions: int = 5,
    check: str = "embree",
) -> list[Task]:
    """A task for each scene; raises DefrayError for what cannot be measured."""
    parsed = device_variants(variants)
    if check not in CHECKS:
        raise DefrayError(f"times need a check, 'embree' or 'exact', not '{check}'")
    common = {"rays": parse_count(rays), "kind": kind, "seed": seed, "repetitions": repetitions, "check": check}
    study = RooflineStudy()
    return [
        task
        for specs in scene_specs(scenes, parsed, parse_structure(structure), **common)
        for task in study.tasks(specs)
    ]


def device_variants(text: str) -> list[Variant]:
    """Variants separated by commas; raises DefrayError where there is none."""
    parsed = [Variant.parse(part.strip()) for part in text.split(",") if part.strip()]
    if not parsed:
        raise DefrayError(f"'{text}' names no variant; write one, as in deferred:ray-space")
    return parsed


def coherence_tasks(
    scenes: Sequence[str],
    intersector: str = DEFAULT,
    wave: int = 4,
    rays: str = "64k",
    kind: str = "diffuse",
    seed: int = 1,
    structure: str = "8/128",
) -> list[Task]:
    """A task for each scene; raises DefrayError for what cannot be counted."""
    variants = [Variant.parse(f"forward:{intersector}"), Variant.parse(f"deferred:{intersector}:wave={wave}")]
    common = {"rays": parse_count(rays), "kind": kind, "seed": seed}
    groups = scene_specs(scenes, variants, parse_structure(structure), **common)
    study = CoherenceStudy()
    return [task for specs in groups for task in study.tasks(specs, wave)]


def check_suite(intersector: str, family: str | None, size: str) -> None:
    """Raise DefrayError for a part of the stress suite that does not exist."""
    select(family)
    size_of(size)
    if intersector not in ("all", "default"):
        find(intersector)


def stability_tasks(
    device, intersector: str = "default", family: str | None = None, size: str = "full", rates: bool = True
) -> list[Task]:
    """A task for each family, and one for the rates of the kernels; raises DefrayError for what is not known."""
    check_suite(intersector, family, size)
    study = StabilityStudy(contracts(device))
    return study.tasks(chosen(intersector, device), select(family), size, rates)
