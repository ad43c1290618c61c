"""`defray reproduce`: measure a tier of the paper, draw the report and judge the claims."""

from __future__ import annotations

import contextlib
import io
import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from harness.campaign.executors import Local, one_line
from harness.campaign.reproduction import Reproduction, read_tier
from harness.campaign.runner import code_of, terminable
from harness.commands.main import load
from harness.commands.options import DeviceOption, print_error
from harness.device.opened import open_device
from harness.errors import DefrayError

EPILOG = "Example:  [bold]defray reproduce smoke --out results/out[/bold]"
STOPPED = 128  # exit codes from here on are a signal's


def reproduce(
    tier: Annotated[str, typer.Argument(metavar="TIER", help="smoke, paper or full; see harness/paper.")] = "paper",
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for records and report.")] = Path("results/out"),
    report: Annotated[
        bool, typer.Option("--report/--no-report", help="Draw and judge what was measured, or only measure.")
    ] = True,
    device: DeviceOption = None,
) -> None:
    """Measure a tier of the paper, draw the report and judge the claims.

    What is on file is not measured again: the same command goes on with what was stopped. A part that fails costs
    no other its results; the exit code is then that of the first one that failed.
    """
    read_tier(tier)
    command = ["defray", "reproduce", tier, "--out", str(out)] + ([] if report else ["--no-report"])
    command = shlex.join(command + (["--device", device] if device else []))
    try:
        with terminable():
            codes = reproduced(tier, out, command, report, device)
    except KeyboardInterrupt as stop:
        print_error(f"stopped; go on with: {command}")
        raise typer.Exit(code_of(stop)) from None
    failed = {name: code for name, code in codes.items() if code}
    stopped = max(failed.values(), default=0) >= STOPPED
    for name, code in failed.items() if not stopped else ():
        print_error(f"{name} failed (exit code {code}); go on with: {command}")
    raise typer.Exit(max(failed.values()) if stopped else next(iter(failed.values()), 0))


def reproduced(tier: str, out: Path, command: str, report: bool, device: str | None) -> dict[str, int]:
    """Exit codes of all parts, in order; nothing is drawn of what was stopped, or of a folder without runs."""
    opened = open_device(device)
    codes = Reproduction(tier, out, opened, Local(opened), command, Console(stderr=True), device).measure()
    if report and max(codes.values(), default=0) < STOPPED and (out / "records.jsonl").is_file():
        with contextlib.redirect_stdout(io.StringIO()):
            codes["views"] = called("views", folder=out, device=device)
            codes["report"] = called("report", folder=out)
        if (out / "report.html").is_file():
            typer.echo(f"report: {out / 'report.html'}")
        codes["claims"] = called("claims", folder=out)
    return codes


def called(name: str, **arguments) -> int:
    """The exit code of another command, imported only now: a machine that measures need not be able to draw."""
    try:
        load(name).callback(**arguments)
    except typer.Exit as end:
        return end.exit_code
    except Exception as error:  # the other commands still have their turn
        print_error(f"{name}: {one_line(error)}")
        return error.exit_code if isinstance(error, DefrayError) else 2
    return 0
