"""What several commands share: options, and how they print JSON. Imports no more, so that `--help` is instant."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer

DeviceOption = Annotated[
    str | None, typer.Option(metavar="PART", help="Part of 'platform / name' as 'defray doctor' prints it.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print JSON on standard output, nothing else there.")
]
RaysOption = Annotated[str, typer.Option(metavar="COUNT", help="Number of rays: 64k, 1M, 2500000.")]
KindOption = Annotated[str, typer.Option(help="primary, diffuse, ambient-occlusion or random.")]
SeedOption = Annotated[int, typer.Option(help="Seed of the rays; the same seed gives the same rays.")]
TopOption = Annotated[
    int | None,
    typer.Option(help="Cells per axis of the grid's first level: 8, or, of an adaptive grid, as the scene needs."),
]
LeafOption = Annotated[
    int | None,
    typer.Option(help="Cells per axis of its second level, see --reading: 128, or at most 16 if adaptive."),
]
DensityOption = Annotated[
    float | None, typer.Option(help="Leaf cells per triangle that an adaptive grid aims at; 0.3 by default.")
]
ReadingOption = Annotated[
    str,
    typer.Option(
        help="What --leaf counts: 'total', cells over the whole scene, or 'per-cell', inside every top cell; or "
        "'adaptive': at most so many inside a top cell, by its number of triangles."
    ),
]


def print_json(value: Any) -> None:
    """`value` on one line of standard output; raises ValueError for a number that is not finite."""
    typer.echo(json.dumps(value, allow_nan=False, ensure_ascii=False))
