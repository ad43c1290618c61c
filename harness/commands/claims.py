"""`defray claims`: judge the paper's claims by a sweep's records, on each machine of the folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.claims import claims_table, judge_all
from harness.claims.judge import as_document
from harness.commands.console import print_table
from harness.commands.options import JsonOption, print_json
from harness.report.page import read_machines

EPILOG = "Example:  [bold]defray claims results/out[/bold]"


def claims(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sweep, with its records.jsonl.")],
    json: JsonOption = False,
) -> None:
    """Judge the paper's claims by a sweep's records, on each machine of the folder.

    Reproduced, shape only, contradicted, inconclusive, or not attempted and why.
    The rules stand in harness/paper/claims.toml.
    """
    machines = read_machines(folder)
    judged = [judge_all(runs) for runs in machines]
    if json:
        documents = [as_document(one, runs) for one, runs in zip(judged, machines, strict=True)]
        print_json(documents[0] if len(documents) == 1 else documents)
        return
    for one, runs in zip(judged, machines, strict=True):
        print_table(claims_table(one, runs.machine or runs.device))
