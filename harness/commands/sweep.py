"""`defray sweep`: run all measurements of a tier, storing each at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.campaign.sweeps import SweepRequest, run_sweep
from harness.commands.options import DeviceOption

EPILOG = "Example:  [bold]defray sweep harness/paper/sweeps.toml --tier smoke --out results/out[/bold]"


def sweep(
    file: Annotated[Path, typer.Argument(metavar="FILE.toml", help="Sweep file; see harness/paper/sweeps.toml.")],
    out: Annotated[Path, typer.Option(help="Folder for the records; made if it is not there.")],
    tier: Annotated[
        str, typer.Option(help="Tier of the file to run; the project's own file has smoke, paper and full.")
    ] = "paper",
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a sweep that was stopped; finished runs are kept.")
    ] = False,
    device: DeviceOption = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the order of the runs; drawn and recorded by default.")
    ] = None,
) -> None:
    """Run all measurements of a tier, storing each at once; a stopped sweep goes on with --resume."""
    raise typer.Exit(run_sweep(SweepRequest(file, tier, out, resume, device, seed)).code)
