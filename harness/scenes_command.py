"""`defray scenes`: list them, fetch the real ones, and hold the stand-ins against them."""

from __future__ import annotations

from typing import Annotated

import typer

from harness.options import DeviceOption, JsonOption, print_json

scenes_app = typer.Typer(rich_markup_mode="rich")


@scenes_app.callback(invoke_without_command=True)
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
    from harness.scene import list_scenes

    statuses = list_scenes()
    if json:
        from dataclasses import asdict

        print_json([asdict(status) for status in statuses])
        return
    from harness.show import print_table, scene_table

    print_table(scene_table(statuses))


@scenes_app.command("fetch", epilog="Example:  [bold]defray scenes fetch sponza[/bold]")
def scenes_fetch(
    name: Annotated[str, typer.Argument(metavar="NAME|all", help="A scene of the paper, or all of them.")],
    yes: Annotated[bool, typer.Option("--yes", help="Accept the licence shown, without a question.")] = False,
) -> None:
    """Fetch a real scene from its author's archive: licence shown first, download verified, geometry converted."""
    from harness.fetch import run_fetch

    raise typer.Exit(run_fetch(name, yes))


def _measure(only: str | None, device: str | None, json: bool, cost: bool) -> None:
    """Print how like the real scenes the stand-ins behave, or what they cost; exit 1 if any is out of bounds."""
    from rich.console import Console

    from harness.calibration import calibrate, calibrated_names
    from harness.cost import costs
    from harness.device import open_device
    from harness.show import measured_tables, print_table

    names = calibrated_names(only)
    with Console(stderr=True).status("starting") as status:
        tell = status.update
        results = costs(names, device, tell) if cost else calibrate(names, open_device(device), tell)
    if json:
        print_json([result.to_json() for result in results])
    else:
        for table in measured_tables(results):
            print_table(table)
    raise typer.Exit(not all(result.inside for result in results))
