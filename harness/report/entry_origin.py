"""Where each figure and table comes from: a JSON file beside its files, and the short id that the figure shows.

The id is made of the figure's name, its numbers and the digests of the records behind them: other records or other
numbers, another id; the same records drawn again, the same id, on whatever machine.
"""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from harness.analysis.results import Results
from harness.errors import DefrayError
from harness.files import ROOT
from harness.records.digest import KEY, split_lines
from harness.records.schema import MachineKey
from harness.report.entry import Entry, Found

SHARED = ("harness/report/figures/style.py", "harness/analysis/results.py", "harness/stats.py")
OWN = ("env.json", "sweep.json", "stability.json")
ROWS = ("*.jsonl", "stability.json")


def entry_origin(found: Found, index: dict, entry: Entry, numbers: pd.DataFrame, csv: str) -> dict:
    """What is known of one figure or table; JSON, equal from equal records.

    `found`: the machines that it shows, each with its own numbers, by whose id columns its `records` are found;
    `numbers`: what is drawn of all, as text in `csv`. `index`: as `index_records` makes it of the folder. `files`:
    what it reads beside the records, or every file of rows where its numbers name no record. Of several machines,
    `machine` is the first, `machines` all. Raises DefrayError for an id that no file of the folder has.
    """
    records = unique([one for runs, own in found for one in records_behind(runs, index, record_ids(own))])
    patterns = entry.files or (() if records else ROWS)
    files = {path: digest for runs, _ in found for path, digest in file_digests(runs, patterns).items()}
    machines = [machine_facts(runs) for runs, _ in found]
    parts = [entry.name, csv, *(one[KEY] for one in records), *files.values()]
    return {
        "id": hashlib.sha256("\n".join(parts).encode()).hexdigest()[:8],
        "name": entry.name,
        "title": entry.title,
        "filter": {"needs": entry.needs, "select": first_line(entry.select), **distinct_values(numbers)},
        "records": records,
        "files": files,
        "numbers_sha256": hashlib.sha256(csv.encode()).hexdigest(),
        "script": drawing_script(entry),
        "shared_scripts": {path: file_sha256(ROOT / path) for path in SHARED},
        "commits": list(dict.fromkeys(one["commit"] for one in records)),
        "commands": unique([one for runs, own in found for one in runs.command_of(record_ids(own))]),
        "redraw": f"defray report DIR --only {entry.name}",
        "machine": machines[0],
        **({"machines": machines} if len(machines) > 1 else {}),
    }


def unique(values: list) -> list:
    """Each value once, in order."""
    return [value for place, value in enumerate(values) if value not in values[:place]]


def record_ids(numbers: pd.DataFrame) -> list[str]:
    """Ids of the records that the rows name, each once, in order."""
    texts = [text for column in ("runs", "run") if column in numbers for text in numbers[column].dropna()]
    return list(dict.fromkeys(" ".join(map(str, texts)).split()))


def records_behind(runs: Results, index: dict, ids: list[str]) -> list[dict]:
    """Id, file, digest and commit of each record of this machine with one of these ids; the latest of each.

    A real scene and its stand-in share their ids, and so the latest of each geometry is among them. Raises
    DefrayError for an id that no file of the folder has.
    """
    machine = machine_key(runs)
    found = []
    for identity in ids:
        rows = index.get(identity, [])
        if not rows:
            raise DefrayError(f"a figure names record {identity}, which is in no file of {runs.folder}")
        here = [row for row in rows if machine.holds(row["machine"])] or rows
        latest = {row["geometry"]: row for row in here}
        found += [{key: row[key] for key in ("id", "file", KEY, "commit")} for row in latest.values()]
    return found


def index_records(folder: Path) -> dict[str, list[dict]]:
    """Every row of the folder's files by id, as they are on file."""
    found: dict[str, list[dict]] = {}
    for path in sorted(folder.glob("*.jsonl")):
        for line in split_lines(path.read_text(encoding="utf-8")):
            try:
                row = json.loads(line)
            except ValueError:
                continue  # a torn last line, which the reader has warned of
            if isinstance(row, dict) and KEY in row:
                found.setdefault(row["id"], []).append(
                    {
                        "id": row["id"],
                        "file": path.name,
                        KEY: row[KEY],
                        "commit": row["commit"],
                        "machine": MachineKey.read(row["machine"]),
                        "geometry": (row["scene"]["source"], row["scene"]["sha256"]),
                    }
                )
    return found


def file_digests(runs: Results, patterns: Sequence[str]) -> dict[str, str]:
    """SHA-256 of the files that match, by their path in the folder, or in the checkout for `harness/`."""
    found = {}
    for pattern in patterns:
        base = ROOT if pattern.startswith("harness/") else runs.home if pattern in OWN else runs.folder
        found |= {path.relative_to(base).as_posix(): file_sha256(path) for path in sorted(base.glob(pattern))}
    return found


def distinct_values(numbers: pd.DataFrame) -> dict[str, list]:
    """The scenes, tracers, grids, kinds and numbers of rays among the rows."""
    found = {}
    for column in ("scene", "tracer", "intersector", "grid", "kind", "rays"):
        if column in numbers:
            values = [value for value in dict.fromkeys(numbers[column].dropna()) if value != ""]
            found[column] = [value if isinstance(value, str) else int(value) for value in values]
    return found


def drawing_script(entry: Entry) -> dict[str, str]:
    """Path and SHA-256 of the file that the entry is stated in."""
    path = Path(inspect.getfile(entry.select))
    return {
        "path": path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name,
        "sha256": file_sha256(path),
    }


def file_sha256(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def first_line(function: Callable) -> str:
    """What a function says it does."""
    return (inspect.getdoc(function) or "").split("\n")[0]


def machine_key(runs: Results) -> MachineKey:
    """The key of the machine of these runs."""
    return MachineKey.read(machine_facts(runs))


def machine_facts(runs: Results) -> dict:
    """The machine as its records have it."""
    machines = [row.machine for row in (*runs.records, *runs.accuracy)]
    key = next((one.key for one in machines if one.device == runs.device), machines[0].key)
    return next(one for one in machines if one.key == key).as_json()
