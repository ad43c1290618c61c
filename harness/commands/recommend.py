"""`defray recommend`: name the fastest variant that is shown to be accurate enough."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from harness.campaign import recommendation as module
from harness.commands.options import DeviceOption, JsonOption, print_json
from harness.inputs.scenes_by_name import check_name

EPILOG = "Example:  [bold]defray recommend sponza --max-leaks 1e-6[/bold]"


def recommend(
    scene: Annotated[str, typer.Argument(metavar="SCENE_OR_FILE", help="A scene, or a mesh file.")],
    max_leaks: Annotated[
        float, typer.Option(help="Largest share of rays aimed at edges and vertices that may leak.")
    ] = 1e-6,
    max_t_error: Annotated[
        float | None, typer.Option(help="Largest relative error of t, 99th percentile; none by default.")
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="DIR",
            help="Folder with accuracy.jsonl; by default results/out, then results/reference/*.",
        ),
    ] = None,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Name the fastest variant that is shown to be accurate enough; measures what the rows on file do not show."""
    check_name(scene)
    console = Console(stderr=True)
    with console.status(escape(scene)) as status:

        def say(text: str) -> None:
            status.update(escape(text))
            if not console.is_terminal and ":" in text:
                console.print(text, highlight=False, soft_wrap=True, markup=False)

        advice = module.recommend(scene, module.Limits(max_leaks, max_t_error), folder, device, say)
    if json:
        print_json(module.as_json(advice))
    else:
        for note in advice.notes:
            typer.echo(f"measured here: {note}")
        for line in module.advice_lines(advice):
            typer.echo(line, err=advice.choice is None)
    raise typer.Exit(0 if advice.choice else 1)
