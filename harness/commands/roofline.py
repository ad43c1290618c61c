"""`defray roofline`: time every kernel beside the device's ceilings, and count what it computes and moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from harness.campaign.executors import Local
from harness.campaign.runner import run
from harness.campaign.tasks import ROOFLINE_VARIANTS, device_variants, roofline_tasks
from harness.commands.options import (
    DeviceOption,
    JsonOption,
    KindOption,
    RaysOption,
    ResumeOption,
    SeedOption,
    StructureOption,
    again,
    show_rows,
)
from harness.device.opened import open_device
from harness.errors import CheckFailed
from harness.records.roofline_row import CeilingValues, KernelRow, RooflineBody
from harness.studies.roofline.instructions import inner_loop

EPILOG = "Example:  [bold]defray roofline sponza --structure 'adaptive density=0.3' --out results/mine[/bold]"


def roofline(
    scenes: Annotated[list[str], typer.Argument(metavar="SCENE ...", help="Scenes or mesh files.")],
    variants: Annotated[
        str, typer.Option(metavar="A,B,...", help="Tracers of the device: tracer:intersector[:option=value...].")
    ] = ROOFLINE_VARIANTS,
    out: Annotated[Path, typer.Option(help="Folder for roofline.jsonl; made if it is not there.")] = Path(
        "results/out"
    ),
    rays: RaysOption = "1M",
    kind: KindOption = "diffuse",
    seed: SeedOption = 1,
    structure: StructureOption = "8/128",
    repetitions: Annotated[int, typer.Option(min=1, help="Timed repetitions, ceilings among them.")] = 5,
    check: Annotated[str, typer.Option(help="Compare hits with 'embree' or with 'exact' arithmetic.")] = "embree",
    instructions: Annotated[
        bool,
        typer.Option("--instructions", help="Also count instructions of each deferred variant's loop (PoCL)."),
    ] = False,
    resume: ResumeOption = False,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Time every kernel beside the device's ceilings, and count what it computes and moves.

    Ceilings (copying from memory and from the last cache, fused multiply-adds) are measured in the same repetitions.
    The report draws the rows as a roofline.
    """
    tasks = roofline_tasks(scenes, variants, rays, kind, seed, structure, repetitions, check)
    found = run(tasks, Local(open_device(device)), out, resume, again())
    show_rows(found.rows, json, console_table)
    if found.stopped:
        raise typer.Exit(found.code)
    if instructions:
        print_instructions(device_variants(variants))
    for row in found.rows:
        if not row.valid:
            raise CheckFailed(f"check failed: {row.scene.name} {row.variant}; no times are reported")
    raise typer.Exit(found.code)


def console_table(row: RooflineBody) -> None:
    """Ceilings and kernels of one row on standard output."""
    fields, rays = ceiling_text(row.ceilings), row.rays.count
    total = sorted(row.seconds)[len(row.seconds) // 2] / rays * 1e9 if row.seconds else 0
    table = Table(title=f"{row.scene.name} {row.variant}: {total:.0f} ns a ray\n{fields}")
    for name in ("kernel", "ns a ray", "flops a ray", "bytes a ray", "uncached", "flops/byte", "Gflop/s", "GB/s"):
        table.add_column(name, justify="left" if name == "kernel" else "right")
    for kernel in row.kernels:
        table.add_row(*kernel_cells(kernel, rays))
    Console(width=118, highlight=False).print(table)


def print_instructions(variants: list) -> None:
    """Instructions of the loop over triangles of every deferred variant, on standard error."""
    for variant in variants:
        if variant.tracer == "deferred":
            found = inner_loop(variant.intersector or "ray-space", **variant.options)
            typer.echo(
                f"{variant}: {found.instructions} instructions a triangle and vector of rays, of these "
                f"{found.arithmetic} floating-point, {found.stack} on the stack",
                err=True,
            )


def ceiling_text(ceilings: CeilingValues) -> str:
    """The three ceilings in words."""
    giga = {name: getattr(ceilings, name).rate.median / 1e9 for name in ("memory", "cache", "fma")}
    return (
        f"copy {giga['memory']:.3g} GB/s from memory, {giga['cache']:.3g} GB/s from the last cache; "
        f"fma {giga['fma']:.3g} Gflop/s"
    )


def kernel_cells(kernel: KernelRow, rays: int) -> list[str]:
    """One kernel's row of the table; a dash for what is not stated."""
    time = kernel.nanoseconds.median
    shown = [kernel.name, f"{time:.1f}"]
    if not kernel.is_stated:
        return [*shown, *["–"] * 6]
    flops, moved, uncached = (work / rays for work in (kernel.flops, kernel.bytes, kernel.uncached_bytes))
    shown += [f"{flops:,.0f}", f"{moved:,.0f}", f"{uncached:,.0f}", f"{flops / moved:.2f}" if moved else "–"]
    return [*shown, *([f"{flops / time:.2f}", f"{moved / time:.2f}"] if time else ["–", "–"])]
