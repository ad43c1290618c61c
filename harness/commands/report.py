"""`defray report`: draw figures and tables of a folder, judge the claims, write report.html and report.pdf."""

from __future__ import annotations

from typing import Annotated

import typer

from harness.commands.options import FolderArgument, records_of
from harness.report.page import redraw, write_report


def report(
    folder: FolderArgument,
    only: Annotated[
        str | None, typer.Option(metavar="FIGURE", help="Redraw one figure or table alone: fig05, or its name.")
    ] = None,
) -> None:
    """Draw figures and tables of a sweep's records, judge the claims, write report.html and report.pdf."""
    records_of(folder)
    for file in redraw(folder, only) if only else [write_report(folder)]:
        typer.echo(file)
