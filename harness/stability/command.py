"""`defray stability`: the stress suite from the command line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from harness.options import DeviceOption, JsonOption, print_json


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
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Test intersectors where methods fail: edges, slivers, distance, degenerate input, the grid, ray offsets.

    Every one runs with floating-point contraction off and on.
    Exits with 1 where one that is registered as watertight leaks, or the default one fails any family.
    """
    from harness.device import machine_description, open_device
    from harness.intersectors import DEFAULT, find
    from harness.stability import report
    from harness.stability.pairs import contracts
    from harness.stability.run import chosen
    from harness.stability.suite import select, size_of

    families, size = select(family), size_of(size)
    if intersector not in ("all", "default"):
        find(intersector)
    opened = open_device(device)
    modes = contracts(opened)
    _tell_of_contraction(opened.name, modes)
    file = None if out is None else report.ResultsFile(out, machine_description(opened), modes)
    rows = _measure(opened, chosen(intersector, opened), families, size, file)
    if json:
        print_json(rows)
    else:
        from rich.console import Console

        console = Console(width=None if sys.stdout.isatty() else 240)
        console.print(report.table(rows))
        console.print(report.LEGEND, highlight=False)
    failed = [row for row in rows if not row["passed"] and is_promised(row, DEFAULT)]
    for row in failed:
        name = f"{row['intersector']}, contraction {row['contraction']}"
        print(f"error: {name} fails family {row['family']}", file=sys.stderr)
    raise typer.Exit(1 if failed else 0)


def _tell_of_contraction(device: str, modes: dict[str, bool]) -> None:
    """A note on standard error for each mode in which the compiler does not do as it was told."""
    for mode, expected in (("off", False), ("on", True)):
        if modes[mode] is not expected:
            verb = "contracts all the same" if modes[mode] else "does not contract"
            print(f"note: with contraction {mode}, the compiler of {device} {verb}", file=sys.stderr)


def is_promised(row: dict, default: str) -> bool:
    """Whether passing is promised: everything of the default, no leak of one registered as watertight."""
    from harness.intersectors import INTERSECTORS

    return row["intersector"] == default or (INTERSECTORS[row["intersector"]].watertight and bool(row["leaks"]))


def _measure(device, entries, families, size: str, file) -> list[dict]:
    """All rows, with a progress bar on standard error; into `file`, and with the test rates, where there is one."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from harness.stability.rates import kernel_rates
    from harness.stability.run import run_suite

    console, rows = Console(stderr=True), []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=None)

        def tell(what: str, done: int, total: int) -> None:
            bar.update(task, description=what, completed=done, total=total)

        for row in run_suite(device, entries, families, size, lambda step: tell(step.what, step.done, step.total)):
            rows.append(row)
            if file:
                file.add([row])
        if file:
            file.add(kernel_rates=kernel_rates(device, entries, tell))
    return rows
