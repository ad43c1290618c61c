"""`defray doctor`: probe every OpenCL device by compiling and running a kernel; says what to do when none works."""

from __future__ import annotations

import json as json_text
import sys
from dataclasses import asdict

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from harness.commands.options import JsonOption
from harness.device.machine import machine_description
from harness.device.opened import REMEDY, Probe, default_order, probe_all


def doctor(json: JsonOption = False) -> None:
    """Probe every OpenCL device by compiling and running a kernel; says what to do when none works."""
    raise typer.Exit(run_doctor(json=json))


def run_doctor(json: bool) -> int:
    """Print every device and its probe's verdict; 0 when one works, else 1 after printing the remedy."""
    probes = sorted(probe_all(), key=default_order)
    works = any(probe.ok for probe in probes)
    if json:
        print(json_text.dumps(_answer(probes, works), indent=2))
    else:
        _print(probes, works)
    return 0 if works else 1


def _answer(probes: list[Probe], works: bool) -> dict:
    """What `--json` prints."""
    return {
        "works": works,
        "remedy": "" if works else _remedy(probes),
        "devices": [asdict(probe) for probe in probes],
        "machine": machine_description(None).as_json(),
    }


def _print(probes: list[Probe], works: bool) -> None:
    """A table of the devices, then one line: the default device, or the remedy."""
    console = Console()
    if probes:
        # Long names fold instead of being cut, so that none is hidden.
        columns = ("platform", "device", "version", "probe")
        table = Table(*(Column(name, overflow="fold") for name in columns))
        for probe in probes:
            verdict = ("[green]ok[/]: " if probe.ok else "[red]failed[/]: ") + escape(probe.message)
            table.add_row(escape(probe.platform), escape(probe.name), escape(probe.version), verdict)
        console.print(table)
    if works:
        first = next(probe for probe in probes if probe.ok)
        print(f"default device: {first.title} (DEFRAY_DEVICE or --device chooses another)")
    else:
        print(f"no working OpenCL device: {_remedy(probes)}")


def _remedy(probes: list[Probe]) -> str:
    """The first failed device's remedy, or the general one where there is no device at all."""
    return next((probe.remedy for probe in probes if probe.remedy), REMEDY)


if __name__ == "__main__":
    sys.exit(run_doctor("--json" in sys.argv[1:]))
