"""Folders of two machines become one whose report shows both; real geometry and stand-in are both shown."""

from __future__ import annotations

import copy
import json
import re

import pandas as pd
import pytest
from made_up_accuracy import write_accuracy
from made_up_report import deferred, make_folder, one_record, scene_records
from typer.testing import CliRunner

from harness.claims import judge_all
from harness.commands.main import app
from harness.errors import DefrayError
from harness.records.digest import sealed
from harness.records.machines import merge
from harness.report.claims_section import claims_html
from harness.report.contents import contents
from harness.report.entry import Machines
from harness.report.entry_origin import index_records
from harness.report.figures import view_pairs
from harness.report.page import read_machines, redraw
from harness.report.write_entry import whole_caption

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


def test_a_text_with_a_line_separator_in_it_stays_one_row(tmp_path):
    record = deferred("sponza") | {"command": "defray trace 'a\u2028b.ply'"}
    make_folder(tmp_path / "mine", [record])
    assert merge([tmp_path / "mine"], tmp_path / "ours") == {"records.jsonl": 1}
    assert list(index_records(tmp_path / "ours")) == [record["id"]]


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
    from harness.report.figures import intersection_speedup
    from harness.report.text import notices

    assert list(intersection_speedup.select(runs)["scene"].unique()) == ["Sponza", "Sponza (stand-in)"]
    assert any("Real geometry and stand-in were both measured" in notice for notice in notices(runs))
    (file,) = redraw(tmp_path, "intersection_speedup")
    named = {one["digest"] for one in json.loads(file.with_suffix(".json").read_text())["records"]}
    assert named == {row["digest"] for row in map(json.loads, (tmp_path / "records.jsonl").read_text().splitlines())}


def test_one_row_sealed_twice_is_one_digest():
    record = deferred("sponza")
    assert sealed(record)["digest"] == sealed(sealed(record))["digest"]


@pytest.mark.parametrize("name", ["traversal_rate", "intersection_speedup", "speed_accuracy"])
def test_main_figures_show_both_machines_in_one(two, name):
    mine, yours, ours = two
    write_accuracy(mine, ("sponza",))
    rows = [json.loads(line) for line in (mine / "accuracy.jsonl").read_text().splitlines()]
    bare = [{key: value for key, value in row.items() if key != "digest"} for row in rows]
    moved = [sealed(row | {"machine": row["machine"] | OTHER}) for row in bare]
    (yours / "accuracy.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in moved))
    merge([mine, yours], ours)
    (file,) = redraw(ours, name)
    titles = [runs.machine for runs in read_machines(ours)]
    drawn = " ".join(re.findall(r"<!-- (.*?) -->", file.read_text()))  # a line of words is a comment
    assert all(" ".join(title.split()[:2]) in drawn for title in titles)
    numbers = pd.read_csv(ours / "tables" / f"{name}.csv", keep_default_na=False)
    assert set(titles) == set(numbers["machine"]) - {""}
    origin = json.loads(file.with_suffix(".json").read_text())
    assert [machine["cpu"] for machine in origin["machines"]] == ["Test CPU", "Other CPU"]
    assert {one["digest"] for one in origin["records"]} & {row["digest"] for row in rows_of(mine)}
    assert {one["digest"] for one in origin["records"]} & {row["digest"] for row in rows_of(yours)}


def rows_of(folder) -> list[dict]:
    """Records and rows of accuracy of a folder."""
    return [
        json.loads(line)
        for name in ("records.jsonl", "accuracy.jsonl")
        for line in (folder / name).read_text().splitlines()
    ]


def test_the_papers_rates_stand_once_beside_two_machines(two):
    mine, yours, ours = two
    merge([mine, yours], ours)
    redraw(ours, "traversal_rate")
    numbers = pd.read_csv(ours / "tables" / "traversal_rate.csv", keep_default_na=False)
    paper = numbers[numbers["series"] == "paper"]
    assert list(paper["machine"]) == [""] and (numbers["series"] == "ours").sum() == 3


def test_every_other_figure_and_table_names_its_machine(two):
    mine, yours, ours = two
    merge([mine, yours], ours)
    seen = 0
    for listed in contents():
        entry = listed.entry
        for runs in read_machines(ours):
            numbers = entry.select(runs)
            if len(numbers) and entry.machines is Machines.APART:
                assert runs.machine in whole_caption(runs, entry, numbers, runs.machine), entry.name
                seen += 1
    assert seen > 8


def test_what_is_the_same_on_every_machine_is_shown_once(two):
    mine, yours, ours = two
    merge([mine, yours], ours)
    (file,) = redraw(ours, "scenes")
    assert file.read_text().count("Sponza") == 1


def test_claims_of_two_machines_stand_side_by_side(two):
    mine, yours, ours = two
    merge([mine, yours], ours)
    found = [(runs.machine, judge_all(runs)) for runs in read_machines(ours)]
    page = claims_html(found)
    assert page.count("<tr>") == 1 + len(found[0][1])
    assert page.count('class="verdict"') == 2 * len(found[0][1])
    assert all(f'<th scope="col">verdict on {machine}</th>' in page for machine, _ in found)
    done = CliRunner().invoke(app, ["claims", str(ours)])
    assert done.exit_code == 0 and all(machine.split(",")[0] in done.output for machine, _ in found)


def test_runs_without_a_device_belong_to_every_device_of_their_processor(tmp_path):
    records = scene_records("sponza")
    for record in records:
        if record["tracer"] == "embree":
            record["machine"]["device"] = record["machine"]["platform"] = None
    other = copy.deepcopy([record for record in records if record["tracer"] != "embree"])
    for record in other:
        record["machine"] |= {"device": "second device", "platform": "Second platform"}
    make_folder(tmp_path, records + other)
    first, second = read_machines(tmp_path)
    assert all((runs.valid["tracer"] == "embree").sum() == 2 for runs in (first, second))


def test_a_run_without_a_device_is_traced_to_its_own_machine(two):
    mine, yours, ours = two
    records = scene_records("sponza")
    embree = [record for record in records if record["tracer"] == "embree"]
    for record in embree:
        record["machine"]["device"] = record["machine"]["platform"] = None
    theirs = elsewhere(records)
    for record in theirs:
        if record["tracer"] == "embree":
            record["machine"]["device"] = record["machine"]["platform"] = None
    make_folder(mine, records)
    make_folder(yours, theirs)
    merge([mine, yours], ours)
    files = redraw(ours, "end_to_end")
    digests = [
        {one["digest"] for one in json.loads(file.with_suffix(".json").read_text())["records"]} for file in files
    ]
    assert len(digests) == 2 and not digests[0] & digests[1]


def test_a_folder_of_stand_ins_alone_has_no_pairs_of_views(tmp_path):
    make_folder(tmp_path, scene_records("hairball"), ["hairball"])
    assert view_pairs.select(read_machines(tmp_path)[0]).empty
