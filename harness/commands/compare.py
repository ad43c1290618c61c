"""`defray compare`: compare variants on the same rays, repetitions interleaved, as ratios with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from harness import stats
from harness.campaign.plan import interleaved
from harness.commands.console import class_counts, no_rate, print_table
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
from harness.inputs.scenes_by_name import check_name
from harness.records.run_row import Record
from harness.records.schema import RayFacts, SceneFacts, Stored
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import parse_structure
from harness.stats import Interval

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
    records = [record for result in results for record in result.records]
    if json:
        print_json([result.as_json() for result in results])
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


class ComparedRun(Stored):
    """One variant beside the base. `rate` in rays per second and `ratio` to the base; None where a check failed.

    `p_value`: of the Mann-Whitney test against the base, None for the base itself.
    """

    variant: str
    valid: bool
    rate: Interval | None
    ratio: Interval | None
    p_value: float | None
    tests_per_ray: float


class Comparison(Stored):
    """Runs of one group; the first is the base."""

    scene: SceneFacts
    rays: RayFacts
    grid: str | None
    base: str
    rows: list[ComparedRun]
    records: list[Record]


def comparison(specs: Sequence[RunSpec], records: Sequence[Record]) -> Comparison:
    """The comparison of one group's records, in the order of `specs`."""
    base = _rates(records[0])
    rows = []
    for number, (spec, record) in enumerate(zip(specs, records, strict=True)):
        rates = _rates(record)
        comparable = bool(number and rates and base)
        rows.append(
            ComparedRun(
                variant=str(spec.variant),
                valid=record.valid,
                rate=record.rate.total,
                ratio=stats.ratio(rates, base) if comparable else None,
                p_value=stats.different_p_value(rates, base) if comparable else None,
                tests_per_ray=record.counters.tests / record.rays.count,
            )
        )
    return Comparison(
        scene=records[0].scene,
        rays=records[0].rays,
        grid=str(specs[0].structure) if specs[0].structure else None,
        base=str(specs[0].variant),
        rows=rows,
        records=list(records),
    )


def _rates(record: Record) -> list[float]:
    """Rates of all repetitions; none when the check failed."""
    if not record.valid or not record.rate.total:
        return []
    return stats.rates_of(record.samples.total, record.rays.count)


def interval_text(values: Interval, unit: float = 1.0) -> str:
    """`2.31 (2.28–2.35)`, each over `unit`."""
    return f"{values.median / unit:.3g} ({values.low / unit:.3g}–{values.high / unit:.3g})"


def comparison_table(result: Comparison) -> Table:
    """Table of a comparison: a row a variant."""
    reference = result.records[0].agreement.reference
    title = f"{result.scene.name}, {result.rays.count:,} {result.rays.kind} rays"
    title += f", grid {result.grid}" if result.grid else ""
    title += f"; median and 95 % interval; checked against {reference}"
    table = Table(title=escape(title), box=None, title_justify="left")
    for name in ("variant", "Mrays/s", "ratio", "p", "tests a ray", "agreement"):
        table.add_column(name, overflow="fold")
    chosen = next((record.grid.chosen for record in result.records if record.grid and record.grid.chosen), None)
    table.caption, table.caption_justify = chosen and escape(f"grid chosen: {chosen}"), "left"
    for row, record in zip(result.rows, result.records, strict=True):
        ratio = "1 (base)" if row.valid and row.variant == result.base else "–"
        table.add_row(
            escape(row.variant),
            interval_text(row.rate, 1e6) if row.rate else no_rate(record),
            interval_text(row.ratio) if row.ratio else ratio,
            f"{row.p_value:.3f}" if row.p_value is not None else "",
            f"{row.tests_per_ray:.1f}" if row.tests_per_ray else "–",
            class_counts(record.agreement),
        )
    return table
