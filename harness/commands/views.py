"""`defray views`: render the view of each scene of a sweep by ambient occlusion, for the report."""

from __future__ import annotations

import typer

from harness.commands.options import DeviceOption, FolderArgument, records_of
from harness.device.opened import open_device
from harness.records.record_file import RecordFile
from harness.studies.pictures import write_views


def views(folder: FolderArgument, device: DeviceOption = None) -> None:
    """Render the view of each scene of a sweep by ambient occlusion, for the report."""
    records = RecordFile(records_of(folder)).read()
    # A mesh file is called by its stem in records, and found by its path.
    scenes = {record.scene.name: record.spec["scene"] for record in records if record.view}
    for file in write_views(folder / "views", scenes, open_device(device)):
        typer.echo(file)
