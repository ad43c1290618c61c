"""`defray trace`: trace rays through one scene, check the hits and report the rate."""

from __future__ import annotations

from harness.campaign.plan import interleaved
from harness.commands.console import print_table, record_table
from harness.commands.measuring import common_fields, exit_by_checks, measured_group
from harness.commands.options import (
    CheckOption,
    DeviceOption,
    IntersectorOption,
    JsonOption,
    KindOption,
    RayFileOption,
    RaysOption,
    RepetitionsOption,
    SceneArgument,
    SeedOption,
    SettingsOption,
    StructureOption,
    TracerOption,
    ViewOption,
    print_json,
)
from harness.errors import DefrayError
from harness.spec.run_spec import Variant
from harness.spec.structure import parse_structure

EPILOG = (
    "Examples:  [bold]defray trace sponza --rays 64k[/bold]   "
    "[bold]defray trace dragon.ply --tracer forward --check exact[/bold]   "
    "[bold]defray trace crown --structure auto --json[/bold]"
)


def trace(
    scene: SceneArgument,
    tracer: TracerOption = "deferred",
    intersector: IntersectorOption = None,
    option: SettingsOption = None,
    rays: RaysOption = "1M",
    kind: KindOption = "diffuse",
    seed: SeedOption = 1,
    view: ViewOption = None,
    ray_file: RayFileOption = None,
    structure: StructureOption = "8/128",
    repetitions: RepetitionsOption = 3,
    check: CheckOption = "embree",
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Trace rays through one scene, check the hits and report the rate."""
    for part in option or []:
        if "=" not in part:
            raise DefrayError(f"--option '{part}' is not of the form key=value, as in: --option wave=8")
    text = ":".join(part for part in (tracer, intersector, *(option or [])) if part)
    common = common_fields(rays, kind, seed, view, repetitions, check)
    if ray_file is not None:
        common |= {"kind": "file", "ray_file": ray_file}
    specs = list(interleaved(scene, [Variant.parse(text)], [parse_structure(structure)], **common))
    record = measured_group(specs, device)[0]
    if json:
        print_json(record.as_json())
    else:
        print_table(record_table(record))
    exit_by_checks([record])
