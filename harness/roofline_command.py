"""`defray roofline`: which ceiling of the device each kernel is under, and how far."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import Annotated

import typer

from harness.options import DeviceOption, JsonOption

VARIANTS = "deferred:ray-space:arrange=record:pairs=copy,forward:ray-space"


def roofline(
    scenes: Annotated[list[str], typer.Argument(metavar="SCENE ...", help="Scenes or mesh files.")],
    variants: Annotated[
        str, typer.Option(metavar="A,B,...", help="Tracers of the device: tracer:intersector[:option=value...].")
    ] = VARIANTS,
    out: Annotated[Path, typer.Option(help="Folder for roofline.jsonl; made if it is not there.")] = Path(
        "results/out"
    ),
    rays: Annotated[str, typer.Option(metavar="COUNT", help="Number of rays: 64k, 1M, 2500000.")] = "1M",
    kind: Annotated[str, typer.Option(help="primary, diffuse, ambient-occlusion or random.")] = "diffuse",
    seed: Annotated[int, typer.Option(help="Seed of the rays.")] = 1,
    top: Annotated[int | None, typer.Option(help="Cells per axis of the grid's first level.")] = None,
    leaf: Annotated[int | None, typer.Option(help="Cells per axis of its second level.")] = None,
    reading: Annotated[str, typer.Option(help="total, per-cell or adaptive.")] = "total",
    density: Annotated[float | None, typer.Option(help="Leaf cells per triangle of an adaptive grid.")] = None,
    repetitions: Annotated[int, typer.Option(min=1, help="Timed repetitions, ceilings among them.")] = 5,
    check: Annotated[str, typer.Option(help="Compare hits with 'embree' or with 'exact' arithmetic.")] = "embree",
    instructions: Annotated[
        bool,
        typer.Option("--instructions", help="Also count instructions of each deferred variant's loop (PoCL)."),
    ] = False,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Time every kernel beside the device's ceilings, and count what it computes and moves.

    Ceilings (copying from memory and from the last cache, fused multiply-adds) are measured in the same repetitions.
    The report draws the rows as a roofline.
    """
    from rich.console import Console

    from harness.accuracy_command import row_facts, scene_progress
    from harness.device import open_device
    from harness.errors import DefrayError
    from harness.plan import interleaved, make_grid, parse_count
    from harness.roofline import measure_roofline
    from harness.roofline_rows import roofline_file
    from harness.scene import check_name
    from harness.spec import Variant
    from harness.sweep import locked

    parsed = [Variant.parse(part.strip()) for part in variants.split(",") if part.strip()]
    if not parsed:
        raise DefrayError(f"'{variants}' names no variant; write one, as in deferred:ray-space")
    if check not in ("embree", "exact"):
        raise DefrayError(f"times need a check, 'embree' or 'exact', not '{check}'")
    for name in scenes:
        check_name(name)
    grid = make_grid(top, leaf, reading, density)
    common = {"rays": parse_count(rays), "kind": kind, "seed": seed, "repetitions": repetitions, "check": check}
    groups = {name: list(interleaved(name, parsed, [grid], **common)) for name in dict.fromkeys(scenes)}
    console, opened, rows = Console(stderr=True), open_device(device), []
    with locked(out), scene_progress(console, len(groups)) as progress:
        file = roofline_file(out)
        file.repair()
        for name, specs in groups.items():
            progress.start(name)
            for row in measure_roofline(specs, opened, lambda stage: progress.tell(stage, 0.5)):
                row |= row_facts(opened)
                file.append(row)
                rows.append(row)
            progress.end()
    if json:
        typer.echo(json_module.dumps(rows, allow_nan=False, ensure_ascii=False))
    else:
        for row in rows:
            console_table(row)
    if instructions:
        print_instructions(parsed)
    if any(not row["valid"] for row in rows):
        failed = next(row for row in rows if not row["valid"])
        raise DefrayError(f"check failed: {failed['scene']['name']} {failed['variant']}; no times are reported")


def console_table(row: dict) -> None:
    """Ceilings and kernels of one row on standard output."""
    from rich.console import Console
    from rich.table import Table

    fields = ceiling_text(row["ceilings"])
    total = sorted(row["seconds"])[len(row["seconds"]) // 2] / row["rays"]["count"] * 1e9 if row["seconds"] else 0
    table = Table(title=f"{row['scene']['name']} {row['variant']}: {total:.0f} ns a ray\n{fields}")
    for name in ("kernel", "ns a ray", "flops a ray", "bytes a ray", "uncached", "flops/byte", "Gflop/s", "GB/s"):
        table.add_column(name, justify="left" if name == "kernel" else "right")
    for kernel in row["kernels"]:
        table.add_row(*kernel_cells(kernel, row["rays"]["count"]))
    Console(width=118, highlight=False).print(table)


def print_instructions(variants: list) -> None:
    """Instructions of the loop over triangles of every deferred variant, on standard error."""
    from harness.instructions import inner_loop

    for variant in variants:
        if variant.tracer == "deferred":
            found = inner_loop(variant.intersector or "ray-space", **variant.options)
            typer.echo(f"{variant}: {found.instructions} instructions a triangle and vector of rays, of these "
                       f"{found.arithmetic} floating-point, {found.stack} on the stack", err=True)


def ceiling_text(ceilings: dict) -> str:
    """The three ceilings in words."""
    giga = {name: ceilings[name]["rate"]["median"] / 1e9 for name in ("memory", "cache", "fma")}
    return (f"copy {giga['memory']:.3g} GB/s from memory, {giga['cache']:.3g} GB/s from the last cache; "
            f"fma {giga['fma']:.3g} Gflop/s")


def kernel_cells(kernel: dict, rays: int) -> list[str]:
    """One kernel's row of the table; a dash for what is not stated."""
    time = kernel["nanoseconds"]["median"]
    shown = [kernel["name"], f"{time:.1f}"]
    if kernel["bytes"] is None:
        return [*shown, *["–"] * 6]
    flops, moved, uncached = (kernel[key] / rays for key in ("flops", "bytes", "uncached_bytes"))
    shown += [f"{flops:,.0f}", f"{moved:,.0f}", f"{uncached:,.0f}", f"{flops / moved:.2f}" if moved else "–"]
    return [*shown, *([f"{flops / time:.2f}", f"{moved / time:.2f}"] if time else ["–", "–"])]


def register(app: typer.Typer) -> None:
    """Add the command to `defray`."""
    app.command(
        epilog="Example:  [bold]defray roofline sponza --reading adaptive --density 0.3 --out results/mine[/bold]"
    )(roofline)
