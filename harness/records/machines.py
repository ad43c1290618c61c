"""Which machine a row was measured on, and folders of several machines merged into one.

A merged folder holds every machine's rows in the same files, for each names its machine; what a folder has only
one of (`env.json`, `sweep.json`, `errors.jsonl`, `stability.json`) lies in `machines/NAME` of the machine meant.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from pathlib import Path
from typing import TypeVar

from harness.errors import DefrayError
from harness.records.digest import KEY, needs_digest, row_place, split_lines, unsealed
from harness.records.schema import MachineKey, Row

RowType = TypeVar("RowType", bound=Row)
OWN_FILES = ("env.json", "sweep.json", "errors.jsonl", "stability.json")
FOLDER = "machines"


def by_machine(rows: list[RowType]) -> dict[MachineKey, list[RowType]]:
    """Rows of each machine, that with most first; those without a device join every machine of their processor."""
    found: dict[MachineKey, list[RowType]] = {}
    for row in rows:
        found.setdefault(row.machine.key, []).append(row)
    for key in [key for key in found if key.device is None]:
        same = [other for other in found if other.device is not None and other.holds(key)]
        if same:
            rows_of_processor = found.pop(key)
            for other in same:
                found[other] = found[other] + rows_of_processor
    return dict(sorted(found.items(), key=lambda item: (-len(item[1]), item[0].device is None, str(tuple(item[0])))))


def own_folder(folder: Path, key: MachineKey) -> Path:
    """Where the files of one machine's own lie."""
    apart = folder / FOLDER / key.file_name
    return apart if apart.is_dir() else folder


def merge(folders: list[Path], out: Path) -> dict[str, int]:
    """Put the rows of `folders` into the new folder `out`; how many rows each file then has.

    A row that is in two folders is kept once. A run measured twice on one machine stays twice, in the order of time,
    and the report takes the later. Raises DefrayError where `out` exists, a row is not as it was written, or two
    folders disagree about what a machine has only one of.
    """
    if out.exists() and any(out.iterdir()):
        raise DefrayError(f"{out} is not empty; name a new folder")
    for folder in folders:
        if not (folder / "records.jsonl").is_file():
            raise DefrayError(f"{folder} has no records.jsonl")
    names = sorted({path.name for folder in folders for path in folder.glob("*.jsonl")} - set(OWN_FILES))
    lines = {name: _merged_lines([folder / name for folder in folders]) for name in names}
    out.mkdir(parents=True, exist_ok=True)
    for name, kept in lines.items():
        (out / name).write_text("".join(f"{line}\n" for line in kept), encoding="utf-8")
    for folder in folders:
        _copy_own_files(folder, out)
        _copy_views(folder / "views", out / "views")
    return {name: len(kept) for name, kept in lines.items()}


def _merged_lines(paths: list[Path]) -> list[str]:
    """Lines of all files, each once, those of one run on one machine in the order of time."""
    kept: dict[str, tuple[str, str]] = {}
    for path in paths:
        for number, line in enumerate(split_lines(path.read_text(encoding="utf-8")) if path.is_file() else [], 1):
            try:
                row = json.loads(line)
            except ValueError:
                raise DefrayError(f"{path}, line {number}: not JSON; repair it with --resume first") from None
            where = row_place(row, path, number)
            unsealed(row, where)
            needs_digest(row, where)
            kept.setdefault(row[KEY], (str(row.get("time_utc", "")), line))
    return [line for _, line in sorted(kept.values(), key=lambda entry: entry[0])]


def _copy_own_files(folder: Path, out: Path) -> None:
    """The files that a folder has one of, to the machine that they are about: the one of most of its records."""
    for apart in (folder / FOLDER).glob("*"):
        for path in apart.iterdir():
            _copy(path, out / FOLDER / apart.name / path.name)
    rows = [json.loads(line) for line in split_lines((folder / "records.jsonl").read_text(encoding="utf-8"))]
    usual = Counter(MachineKey.read(row["machine"]) for row in rows).most_common(1)
    for name in OWN_FILES:
        path = folder / name
        if path.is_file():
            about = _machine_in(path) or (usual[0][0] if usual else None)
            if about:
                _copy(path, out / FOLDER / about.file_name / name)


def _machine_in(path: Path) -> MachineKey | None:
    """The machine that a file names: `env.json` is one, `stability.json` has one."""
    if path.name not in ("env.json", "stability.json"):
        return None
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        raise DefrayError(f"{path} is not JSON; remove it or write it again") from None
    machine = facts.get("machine", {}) if path.name == "stability.json" else facts
    return MachineKey.read(machine) if machine.get("device") else None


def _copy(path: Path, to: Path) -> None:
    if to.exists() and to.read_bytes() != path.read_bytes():
        raise DefrayError(f"{path} differs from that of another folder for the same machine; keep one of the two")
    to.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, to)


def _copy_views(views: Path, to: Path) -> None:
    for picture in views.glob("*.png") if views.is_dir() else ():
        to.mkdir(exist_ok=True)
        if not (to / picture.name).exists():
            shutil.copyfile(picture, to / picture.name)
