"""Migration: rows of schema 1 gain digests and say so; nothing is written unless everything is good."""

from __future__ import annotations

import json

import pytest
from made_up_accuracy import accuracy_row, precision_row, stability
from test_record import make_record

from harness.accuracy_rows import accuracy_file, precision_file
from harness.digest import sealed
from harness.errors import DefrayError
from harness.migrate import migrate
from harness.record import RecordFile
from harness.stability.report import read_results


@pytest.fixture
def old(tmp_path):
    """A folder as the version with schema 1 left it, but for its first record, which is of this version."""
    rows = {"records.jsonl": [make_record("b"), make_record("c")],
            "accuracy.jsonl": [accuracy_row("sponza", "deferred:ray-space")],
            "precision.jsonl": [precision_row("sponza", "grid", "8/64", 0.3, 1e-8)]}
    for name, found in rows.items():
        (tmp_path / name).write_text("".join(json.dumps(row | {"schema": 1}) + "\n" for row in found))
    records = tmp_path / "records.jsonl"
    records.write_text(json.dumps(sealed(make_record("a"))) + "\n" + records.read_text())
    (tmp_path / "stability.json").write_text(json.dumps(stability() | {"schema": 1}))
    return tmp_path


def test_old_rows_are_read_after_migration_and_say_that_they_were_migrated(old):
    with pytest.raises(DefrayError, match="defray migrate"):
        RecordFile(old / "records.jsonl").read()
    assert migrate(old) == {"records.jsonl": 2, "accuracy.jsonl": 1, "precision.jsonl": 1, "stability.json": 1}
    records = RecordFile(old / "records.jsonl").read()
    assert [record["id"] for record in records] == ["a", "b", "c"]
    assert ["migrated_utc" in record for record in records] == [False, True, True]
    assert accuracy_file(old).read()[0]["migrated_utc"] and precision_file(old).read()[0]["migrated_utc"]
    assert read_results(old).migrated_utc
    before = {path.name: path.read_bytes() for path in old.iterdir()}
    assert set(migrate(old).values()) == {0}
    assert {path.name: path.read_bytes() for path in old.iterdir()} == before


def test_a_bad_row_stops_the_migration_by_name_and_leaves_every_file(old):
    with open(old / "precision.jsonl", "a") as file:
        file.write(json.dumps({**precision_row("sponza", "grid", "8/9", 0.3, 1e-8), "id": "bad", "rays": -1}) + "\n")
    before = {path.name: path.read_bytes() for path in old.iterdir()}
    with pytest.raises(DefrayError, match=r"precision.jsonl, line 2 \(id bad"):
        migrate(old)
    assert {path.name: path.read_bytes() for path in old.iterdir()} == before


def test_an_edited_row_cannot_be_migrated(old):
    records = old / "records.jsonl"
    records.write_text(records.read_text().replace("defray trace sponza", "defray trace spanza", 1))
    with pytest.raises(DefrayError, match=r"line 1 \(id a, .*edited"):
        migrate(old)
