"""`defray scenes`: list the scenes, fetch the real ones, hold the stand-ins against them."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer
from rich.console import Console

from harness.commands.console import measured_tables, print_table, scene_table
from harness.commands.fetch import run_fetch
from harness.commands.options import DeviceOption, JsonOption, print_json
from harness.device.opened import open_device
from harness.inputs.scenes_by_name import list_scenes
from harness.studies.stand_ins.footprint import footprints
from harness.studies.stand_ins.likeness import calibrate, calibrated_names

app = typer.Typer(rich_markup_mode="rich")


@app.callback(invoke_without_command=True)
def scenes(
    context: typer.Context,
    calibration: Annotated[
        bool, typer.Option("--calibration", help="Measure the stand-ins against the real scenes; minutes.")
    ] = False,
    cost: Annotated[
        bool, typer.Option("--cost", help="Time and peak memory of generating the stand-ins and of their grids.")
    ] = False,
    only: Annotated[
        str | None, typer.Option(metavar="A,B", help="Only these, with --calibration or --cost; all five else.")
    ] = None,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """List the scenes: number of triangles, whether real, stand-in or missing, and where they come from."""
    if context.invoked_subcommand:
        return
    if calibration or cost:
        _measure(only, device, json, cost)
        return
    statuses = list_scenes()
    if json:
        print_json([asdict(status) for status in statuses])
        return
    print_table(scene_table(statuses))


@app.command("fetch", epilog="Example:  [bold]defray scenes fetch sponza[/bold]")
def scenes_fetch(
    name: Annotated[str, typer.Argument(metavar="NAME|all", help="A scene of the paper, or all of them.")],
    yes: Annotated[bool, typer.Option("--yes", help="Accept the licence shown, without a question.")] = False,
) -> None:
    """Fetch a real scene from its author's archive: licence shown first, download verified, geometry converted."""
    raise typer.Exit(run_fetch(name, yes))


def _measure(only: str | None, device: str | None, json: bool, cost: bool) -> None:
    """Print how like the real scenes the stand-ins behave, or what they cost; exit 1 if any is out of bounds."""
    names = calibrated_names(only)
    with Console(stderr=True).status("starting") as status:
        tell = status.update
        results = footprints(names, device, tell) if cost else calibrate(names, open_device(device), tell)
    if json:
        print_json([result.to_json() for result in results])
    else:
        for table in measured_tables(results):
            print_table(table)
    raise typer.Exit(not all(result.inside for result in results))
