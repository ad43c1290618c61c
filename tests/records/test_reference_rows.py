"""Committed rows are read, and written again to the same bytes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from harness.files import append_line
from harness.records.accuracy_row import accuracy_file
from harness.records.coherence_row import coherence_file
from harness.records.digest import sealed
from harness.records.precision_row import precision_file
from harness.records.record_file import RecordFile
from harness.records.roofline_row import roofline_file
from harness.records.stability_row import FILE, read_results, write_results

REFERENCE = Path(__file__).resolve().parents[2] / "results" / "reference"
FOLDERS = sorted(path.parent for path in REFERENCE.glob("*/records.jsonl"))
FILES = {
    "records": lambda folder: RecordFile(folder / "records.jsonl"),
    "accuracy": accuracy_file,
    "precision": precision_file,
    "coherence": coherence_file,
    "roofline": roofline_file,
}


def test_there_are_reference_results():
    assert FOLDERS


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_every_committed_row_is_written_again_to_the_same_line(folder, name, tmp_path):
    file = FILES[name](folder)
    lines = file.path.read_text(encoding="utf-8").removesuffix("\n").split("\n")
    rows = file.read()
    for row, line in zip(rows, lines, strict=True):
        append_line(tmp_path / "again.jsonl", sealed(row.as_json()))
        again = (tmp_path / "again.jsonl").read_text(encoding="utf-8")
        assert again == line + "\n", f"{name} {row.id}"
        (tmp_path / "again.jsonl").unlink()
    assert rows


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_the_committed_results_of_the_stress_suite_are_written_again_to_the_same_bytes(folder, tmp_path):
    write_results(tmp_path / FILE, read_results(folder))
    assert (tmp_path / FILE).read_bytes() == (folder / FILE).read_bytes()


def test_the_overlap_test_is_read_and_written_under_the_key_of_schema_2():
    row = accuracy_file(FOLDERS[0]).read()[0]
    assert row.overlap == "padded"
    stored = json.loads(json.dumps(row.as_json()))
    assert stored["binning"] == "padded" and "overlap" not in stored
