"""`defray merge`: put the records of several machines into one folder, whose report shows each of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.records import machines

EPILOG = "Example:  [bold]defray merge results/mine results/yours --out results/ours[/bold]"


def merge(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR ...", help="Folders with records.jsonl.")],
    out: Annotated[Path, typer.Option(help="New folder for all of their records.")],
) -> None:
    """Put the records of several machines into one folder, whose report shows each of them."""
    for name, count in machines.merge(folders, out).items():
        typer.echo(f"{out / name}: {count} rows")
