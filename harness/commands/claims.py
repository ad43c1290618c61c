"""`defray claims`: judge the paper's claims by a sweep's records, on each machine of the folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from harness.claims import Judged, judge_all
from harness.claims.judge import as_document
from harness.claims.wording import MARKS, claims_rows, counts_text
from harness.commands.console import print_table
from harness.commands.options import JsonOption, print_json
from harness.report.page import read_machines

COLOURS = {
    "reproduced": "green",
    "shape only": "yellow",
    "contradicted": "red",
    "inconclusive": "cyan",
    "not attempted": "dim",
}
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


def claims_table(judged: Sequence[Judged], device: str = "") -> Table:
    """Verdict, claim, numbers and what was needed, a row a claim."""
    where = f" on {escape(device)}" if device else ""
    title = f"The paper's claims{where}: {counts_text(judged)}"
    table = Table(title=title, box=None, title_justify="left", padding=(0, 1))
    for name, ratio in (("verdict", None), ("claim", 4), ("measured", 6), ("needed", 2)):
        table.add_column(name, ratio=ratio, no_wrap=name == "verdict")
    for row in claims_rows(judged):
        colour = COLOURS[row["verdict"]]
        table.add_row(
            f"[{colour}]{MARKS[row['verdict']]} {row['verdict']}[/{colour}]",
            *(escape(row[name]) for name in ("claim", "measured", "needed")),
        )
    return table
