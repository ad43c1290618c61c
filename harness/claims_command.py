"""`defray claims DIR`: every claim of the paper with its verdict."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.options import JsonOption


def claims(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sweep, with its records.jsonl.")],
    json: JsonOption = False,
) -> None:
    """Judge the paper's claims by a sweep's records: reproduced, shape only, contradicted, inconclusive, or not
    attempted and why. The rules stand in harness/paper/claims.toml."""
    import json as json_module

    from harness.claims import claims_table, judge_all
    from harness.claims.judge import as_document
    from harness.report import read_runs
    from harness.show import print_table

    runs = read_runs(folder)
    judged = judge_all(runs)
    if json:
        typer.echo(json_module.dumps(as_document(judged, runs), allow_nan=False, ensure_ascii=False))
    else:
        print_table(claims_table(judged, runs.device))


def register(app: typer.Typer) -> None:
    """Add the command to `defray`."""
    app.command(epilog="Example:  [bold]defray claims results/out[/bold]")(claims)
