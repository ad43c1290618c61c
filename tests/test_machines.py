"""Folders of two machines become one whose report shows both; real geometry and stand-in are both shown."""

from __future__ import annotations

import copy
import json

import pytest
from made_up_accuracy import write_accuracy
from made_up_report import deferred, make_folder, one_record, scene_records

from harness.digest import sealed
from harness.errors import DefrayError
from harness.machines import merge
from harness.report import read_machines, redraw

OTHER = {"cpu": "Other CPU", "cores": 64, "device": "another device", "platform": "Another platform"}


def elsewhere(records: list[dict], slower: float = 2.0) -> list[dict]:
    """The same runs on another machine."""
    records = copy.deepcopy(records)
    for record in records:
        record["machine"] |= OTHER
        for rate in filter(None, record["rate"].values()):
            for end in rate:
                rate[end] /= slower
    return records


@pytest.fixture
def two(tmp_path):
    """Folders of two machines that made the same runs, and one for both."""
    records = scene_records("sponza")
    make_folder(tmp_path / "mine", records, ["sponza"])
    make_folder(tmp_path / "yours", elsewhere(records[:5]))
    return tmp_path / "mine", tmp_path / "yours", tmp_path / "ours"


def test_a_merged_folder_shows_each_machine_with_its_own_numbers(two):
    mine, yours, ours = two
    assert merge([mine, yours], ours) == {"records.jsonl": len(scene_records("sponza")) + 5}
    first, second = read_machines(ours)
    assert (len(first.all), len(second.all)) == (len(scene_records("sponza")), 5)
    assert set(second.all["device"]) == {"another device"} and "64 cores" in second.machine
    assert (first.home / "env.json").read_text() == (mine / "env.json").read_text()
    assert (second.home / "env.json").read_text() == (yours / "env.json").read_text()
    files = redraw(ours, "stages")
    assert len(files) == 2
    assert all(path.is_file() for path in files)
    assert "another device" in files[1].read_text()  # beside the id
    origins = [json.loads(path.with_suffix(".json").read_text()) for path in files]
    assert [origin["machine"]["cpu"] for origin in origins] == ["Test CPU", "Other CPU"]
    assert origins[0]["id"] != origins[1]["id"]
    digests = [{one["digest"] for one in origin["records"]} for origin in origins]
    assert not digests[0] & digests[1]


def test_merging_the_same_folder_twice_keeps_each_record_once(two):
    mine, yours, ours = two
    merge([mine, yours, mine], ours)
    assert len(ours.joinpath("records.jsonl").read_text().splitlines()) == len(scene_records("sponza")) + 5


def test_the_order_of_folders_does_not_matter(two, tmp_path):
    mine, yours, ours = two
    merge([mine, yours], ours)
    merge([yours, mine], tmp_path / "again")
    one, other = (read_machines(folder) for folder in (ours, tmp_path / "again"))
    assert [list(runs.all["run"]) for runs in one] == [list(runs.all["run"]) for runs in other]


def test_an_edited_record_is_not_merged(two):
    mine, yours, ours = two
    file = yours / "records.jsonl"
    file.write_text(file.read_text().replace('"dirty": false', '"dirty": true', 1))
    with pytest.raises(DefrayError, match=r"records.jsonl, line 1 \(id .*edited"):
        merge([mine, yours], ours)
    assert not ours.exists()


def test_a_folder_that_is_not_empty_is_refused(two):
    mine, yours, _ = two
    with pytest.raises(DefrayError, match="is not empty"):
        merge([mine], yours)


def test_rows_of_accuracy_stay_with_their_machine(two):
    mine, yours, ours = two
    write_accuracy(mine, ("sponza",))
    merge([mine, yours], ours)
    first, second = read_machines(ours)
    assert len(first.accuracy) == 8 and second.accuracy == []
    assert first.stability and not second.stability


def test_a_real_scene_and_its_stand_in_are_both_shown(tmp_path):
    real = [deferred("sponza"), one_record("sponza", "work-optimal", "ray-space", {"intersect": 900})]
    stand_in = copy.deepcopy(real)
    for record in stand_in:
        record["scene"] |= {"source": "stand-in", "sha256": "cd" * 32}
    make_folder(tmp_path, real + stand_in)
    runs = read_machines(tmp_path)[0]
    assert list(runs.scenes["title"]) == ["Sponza", "Sponza (stand-in)"]
    from harness.figures import intersection_speedup
    from harness.report_text import notices

    assert list(intersection_speedup.select(runs)["scene"].unique()) == ["Sponza", "Sponza (stand-in)"]
    assert any("Real geometry and stand-in were both measured" in notice for notice in notices(runs))


def test_one_row_sealed_twice_is_one_digest():
    record = deferred("sponza")
    assert sealed(record)["digest"] == sealed(sealed(record))["digest"]
