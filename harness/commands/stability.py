"""`defray stability`: test intersectors where methods fail: edges, slivers, distance, degenerate input."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from harness.analysis.names import two_digits
from harness.campaign.executors import Local
from harness.campaign.runner import run
from harness.campaign.tasks import check_suite, stability_tasks
from harness.commands.options import DeviceOption, JsonOption, ResumeOption, again, print_json
from harness.device.opened import open_device
from harness.records.stability_row import StressRow
from harness.spec.stress_suite import families
from harness.studies.stability.suite import is_promised, is_test

EPILOG = "Examples:  [bold]defray stability[/bold]   [bold]defray stability --intersector all --family W2[/bold]"


def stability(
    intersector: Annotated[
        str, typer.Option(metavar="NAME", help="An intersector by name, 'default' or 'all'.")
    ] = "default",
    family: Annotated[
        str | None, typer.Option(metavar="ID", help="W, A, D, G, S, or one family as in W2; all by default.")
    ] = None,
    size: Annotated[str, typer.Option(help="'full', a million aimed rays a family, or 'smoke'.")] = "full",
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also add to DIR/stability.json, with test rates.")
    ] = None,
    resume: ResumeOption = False,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Test intersectors where methods fail: edges, slivers, distance, degenerate input, the grid, ray offsets.

    Every one runs with floating-point contraction off and on.
    Exits with 1 where one that is registered as watertight leaks, or the default one fails any family.
    """
    check_suite(intersector, family, size)
    executor = Local(open_device(device))
    tasks = stability_tasks(executor.device, intersector, family, size, rates=out is not None)
    tell_of_contraction(executor.device.name, tasks[0].study.contracts)
    found = run(tasks, executor, out, resume, again() if out else "")
    rows = [row for row in found.rows if is_test(row)]
    if json:
        print_json([row.as_json() for row in rows])
    else:
        console = Console(width=None if sys.stdout.isatty() else 240)
        console.print(table(rows))
        console.print(LEGEND, highlight=False)
    for row in rows:
        if not row.passed and is_promised(row):
            name = f"{row.intersector}, contraction {row.contraction}"
            print(f"error: {name} fails family {row.family}", file=sys.stderr)
    raise typer.Exit(found.code)


def tell_of_contraction(device: str, modes: dict[str, bool]) -> None:
    """A note on standard error for each mode in which the compiler does not do as it was told."""
    for mode, expected in (("off", False), ("on", True)):
        if modes[mode] is not expected:
            verb = "contracts all the same" if modes[mode] else "does not contract"
            print(f"note: with contraction {mode}, the compiler of {device} {verb}", file=sys.stderr)


LEGEND = (
    "W, G: leaks a million rays; A: worst band | 99th percentile of t's distance from the plane, local ulp; "
    "A4, D: gross errors; S: self-hits, tunnels a million rays; ✗: not passed"
)


def table(rows: Sequence[StressRow]) -> Table:
    """Methods by families: the figure that decides, red where the family is failed."""
    order = [family for family in families() if any(row.family == family for row in rows)]
    found = {row.key: row for row in rows}
    result = Table(box=None)
    result.add_column("intersector")
    result.add_column("contraction")
    for family in order:
        result.add_column(family, justify="right")
    for name, mode in dict.fromkeys((row.intersector, row.contraction) for row in rows):
        cells = [_cell(found.get((name, mode, family))) for family in order]
        result.add_row(name, mode, *cells)
    return result


def _cell(row: StressRow | None) -> str:
    if row is None:
        return "–"
    if row.band_ulp is not None and row.residual_p99_ulp is not None and row.family != "A4":
        text = f"{two_digits(row.band_ulp)}|{two_digits(row.residual_p99_ulp)}"
    elif row.leaks is not None:
        text = two_digits(1e6 * row.leaks / row.rays)
    elif row.self_hits is not None:
        text = f"{two_digits(1e6 * row.self_hits / row.rays)},{two_digits(1e6 * row.tunnels / row.rays)}"
    else:
        text = two_digits(row.gross)
    return text if row.passed else f"[red]{text} ✗[/red]"
