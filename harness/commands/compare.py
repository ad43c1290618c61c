"""`defray compare`: compare variants on the same rays, repetitions interleaved, as ratios with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from harness import stats
from harness.campaign.plan import interleaved
from harness.commands.console import comparison_table, print_table
from harness.commands.measuring import common_fields, exit_by_checks, measured_group
from harness.commands.options import (
    CheckOption,
    DeviceOption,
    JsonOption,
    KindOption,
    RaysOption,
    RepetitionsOption,
    SeedOption,
    StructureOption,
    ViewOption,
    print_json,
)
from harness.errors import DefrayError
from harness.inputs.scenes import check_name
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import parse_structure

EPILOG = (
    "Examples:  [bold]defray compare deferred:ray-space forward:moller-trumbore --rays 64k[/bold]   "
    "[bold]defray compare deferred deferred:ray-space:wave=4 embree --scenes sponza,crown[/bold]"
)


def compare(
    variants: Annotated[
        list[str],
        typer.Argument(metavar="A B ...", help="Two or more of tracer:intersector[:option=value...]; A is the base."),
    ],
    scenes: Annotated[str, typer.Option(metavar="A,B", help="Scenes or mesh files, with commas.")] = "sponza",
    rays: RaysOption = "1M",
    kind: KindOption = "diffuse",
    seed: SeedOption = 1,
    view: ViewOption = None,
    structure: StructureOption = "8/128",
    repetitions: RepetitionsOption = 5,
    check: CheckOption = "embree",
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Compare variants on the same rays, repetitions interleaved, as ratios with confidence intervals."""
    if len(variants) < 2:
        raise DefrayError("compare needs two variants or more, as in: defray compare deferred forward")
    chosen = parse_structure(structure)
    common = common_fields(rays, kind, seed, view, repetitions, check)
    parsed = [Variant.parse(text) for text in variants]
    groups = [list(interleaved(name, parsed, [chosen], **common)) for name in scene_names(scenes)]
    if any(len({spec.id for spec in group}) < len(group) for group in groups):
        raise DefrayError("the same variant is named twice")
    results = [comparison(group, measured_group(group, device)) for group in groups]
    records = [record for result in results for record in result["records"]]
    if json:
        print_json(results)
    else:
        for result in results:
            print_table(comparison_table(result))
    exit_by_checks(records)


def scene_names(text: str) -> list[str]:
    """Scenes of `A,B`, each once; raises DefrayError where there is none, or one that is not known."""
    names = list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    if not names:
        raise DefrayError(f"--scenes '{text}' names no scene")
    for name in names:
        check_name(name)
    return names


def comparison(specs: Sequence[RunSpec], records: Sequence[dict]) -> dict:
    """`{scene, rays, grid, base, rows, records}` of one group; the first spec is the base.

    A row is `{variant, valid, rate, ratio, p_value, tests_per_ray}`: `rate` and `ratio` as
    `{median, low, high}`, in rays per second and relative to the base; None where a check failed. `p_value`
    is that of the Mann-Whitney test against the base, None for the base itself.
    """
    base = _samples(records[0])
    rows = []
    for number, (spec, record) in enumerate(zip(specs, records, strict=True)):
        rates = _samples(record)
        comparable = bool(number and rates and base)
        rows.append(
            {
                "variant": str(spec.variant),
                "valid": record["valid"],
                "rate": record["rate"]["total"],
                "ratio": stats.ratio(rates, base).as_dict() if comparable else None,
                "p_value": stats.different_p_value(rates, base) if comparable else None,
                "tests_per_ray": record["counters"]["tests"] / record["rays"]["count"],
            }
        )
    return {
        "scene": records[0]["scene"],
        "rays": records[0]["rays"],
        "grid": str(specs[0].structure) if specs[0].structure else None,
        "base": str(specs[0].variant),
        "rows": rows,
        "records": list(records),
    }


def _samples(record: dict) -> list[float]:
    """Rates of all repetitions; none when the check failed."""
    if not record["valid"] or not record["rate"]["total"]:
        return []
    return stats.rates_of(record["samples"]["total"], record["rays"]["count"])
