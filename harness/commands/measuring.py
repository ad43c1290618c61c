"""What `defray trace` and `defray compare` share: fields of their runs, one group measured at once, failed checks."""

from __future__ import annotations

import typer
from rich.console import Console
from rich.markup import escape

from harness import tracers
from harness.commands.options import print_error
from harness.device.machine import machine_description
from harness.device.opened import open_device
from harness.errors import known
from harness.inputs.memory import announcements
from harness.inputs.scenes_by_name import expected_triangles
from harness.measure.pipeline import run_group
from harness.measure.scene import Scenes
from harness.records.agreement import why_failed
from harness.records.origin import finish
from harness.records.run_row import Record
from harness.spec.run_spec import parse_count
from harness.studies.runs import run_name


def common_fields(rays: str, kind: str, seed: int, view: str | None, repetitions: int, check: str) -> dict:
    """Checked fields that all runs of one command share; raises DefrayError."""
    checks = ("embree", "exact", "none")
    if check not in checks:
        raise known("check", check, checks)
    return {
        "rays": parse_count(rays),
        "kind": kind,
        "seed": seed,
        "view": view,
        "repetitions": repetitions,
        "check": check,
    }


def measured_group(specs: list, device_part: str | None) -> list[Record]:
    """Finished records of one group, in the order of `specs`; progress goes to standard error."""
    console = Console(stderr=True)
    done = {}
    needed = any(tracers.find(spec.variant.tracer).needs_device for spec in specs)
    device = open_device(device_part) if needed else None
    for line in announcements([(specs[0].scene, expected_triangles(specs[0].scene))]):
        console.print(line, highlight=False, soft_wrap=True, markup=False)
    with console.status("starting") as status:

        def progress(step) -> None:
            what = run_name(step.spec) if step.spec else specs[0].scene
            status.update(f"{escape(what)}: {escape(step.stage)} ({step.done:.0%})")

        for spec, body in run_group(specs, Scenes(device), progress):
            done[spec.id] = finish(Record, body, machine_description(device), id=spec.id)
    return [done[spec.id] for spec in specs]


def exit_by_checks(records: list[Record]) -> None:
    """Exit 1, with a line on standard error, when a check failed."""
    failed = [record for record in records if record.failed]
    for record in failed:
        name = f"{record.scene.name} {record.tracer}:{record.intersector or ''}".rstrip(":")
        print_error(f"check failed: {name}: {why_failed(record.agreement)}; no rate is reported")
    if failed:
        raise typer.Exit(1)
