"""Command-line options that several commands share. Imports nothing but Typer, so that `--help` is instant."""

from __future__ import annotations

from typing import Annotated

import typer

DeviceOption = Annotated[
    str | None, typer.Option(metavar="PART", help="Part of a device's name in 'defray doctor'.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print JSON on standard output, nothing else there.")
]
