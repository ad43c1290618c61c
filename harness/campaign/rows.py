"""What `defray roofline` and `defray coherence` share: their specs, and rows that are stored as they come."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from harness.campaign.folder import locked
from harness.campaign.plan import interleaved
from harness.campaign.progress import scene_progress
from harness.device.machine import machine_description
from harness.device.opened import open_device
from harness.inputs.scenes import check_name
from harness.records.origin import finish
from harness.records.record_file import RecordFile
from harness.records.schema import Body, Row


def scene_specs(scenes: Sequence[str], variants: list, grid, **common) -> dict[str, list]:
    """Specs of each scene, by its name; `common` as `harness.plan.interleaved` takes it. Raises DefrayError."""
    for name in scenes:
        check_name(name)
    return {name: list(interleaved(name, variants, [grid], **common)) for name in dict.fromkeys(scenes)}


def measured_rows(
    groups: dict[str, list],
    device: str | None,
    out: Path,
    file_of: Callable[[Path], RecordFile],
    measure: Callable[[list, Any, Callable[[str], None]], Iterable[Body]],
) -> list[Row]:
    """Rows of all scenes, each stored in `file_of(out)` as soon as `measure(specs, device, tell)` yields it."""
    console, opened, rows = Console(stderr=True), open_device(device), []
    with locked(out), scene_progress(console, len(groups)) as progress:
        file = file_of(out)
        file.repair()
        for name, specs in groups.items():
            progress.start(name)
            for body in measure(specs, opened, lambda stage: progress.tell(stage, 0.5)):
                rows.append(finish(file.row, body, machine_description(opened)))
                file.append(rows[-1])
            progress.end()
    return rows
