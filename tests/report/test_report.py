"""The report: every figure in three formats, the same bytes again, one page that needs nothing else."""

from __future__ import annotations

import re

import pandas as pd
import pytest
from made_up_accuracy import as_row
from made_up_report import (
    RAYS,
    SMOKE,
    deferred,
    make_folder,
    numbers_of,
    one_record,
    page_of,
    scene_records,
    without_scripts,
)
from made_up_roofline import coherence_row, roofline_row

from harness.analysis.names import beside_text, grid_text
from harness.analysis.results import read_published
from harness.data import Samples
from harness.errors import DefrayError
from harness.records.coherence_row import CoherenceRow, coherence_file
from harness.records.roofline_row import RooflineRow, roofline_file
from harness.report.figures import figures
from harness.report.page import read_runs, write_report
from harness.report.tables import tables
from harness.spec.structure import structure_from_json
from harness.stats import rates


def test_every_figure_has_three_formats_and_every_entry_its_numbers(drawn):
    for name in figures():
        for suffix, start in (("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG")):
            assert (drawn / "figures" / f"{name}.{suffix}").read_bytes().startswith(start), name
    for name in {**figures(), **tables()}:
        assert len(numbers_of(drawn, name)) > 0, name


@pytest.mark.slow
def test_redraw_is_the_same_bytes(drawn):
    before = {path: path.read_bytes() for path in sorted(drawn.rglob("*")) if path.is_file()}
    write_report(drawn)
    after = {path: path.read_bytes() for path in sorted(drawn.rglob("*")) if path.is_file()}
    assert before.keys() == after.keys()
    assert [path.name for path in before if before[path] != after[path]] == []


def test_page_needs_nothing_else(drawn):
    whole = page_of(drawn)
    assert not re.search(r"<script[^>]+src", whole)
    page = without_scripts(whole)
    links = re.findall(r"""(?:src|href)\s*=\s*["']?([^"'\s>]+)""", page)
    assert links
    assert {link for link in links if not link.startswith(("#", "data:"))} == set()
    assert "@import" not in page and "url(h" not in page
    assert len(whole.encode()) < 8_000_000
    assert not re.search(r"<(link|iframe|object|embed)\b", page)


def test_ids_of_the_page_are_unique_and_references_resolve(drawn):
    page = without_scripts(page_of(drawn))
    names = re.findall(r'\bid="([^"]+)"', page)
    # matplotlib repeats the ids of markers' definitions inside one figure, always with the same content
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(names)
    assert set(re.findall(r"url\(#([^)]+)\)", page)) <= set(names)


def test_stand_ins_are_called_stand_ins(drawn):
    assert "Hairball (stand-in)" in page_of(drawn)
    assert "1 stand-in" in page_of(drawn)
    for name in ("views", "intersection_speedup", "traversal_rate", "end_to_end", "agreement"):
        scenes = set(numbers_of(drawn, name)["scene"])
        assert "Hairball (stand-in)" in scenes and "Hairball" not in scenes, name


def test_failed_runs_are_red_and_drawn_nowhere(drawn):
    page = page_of(drawn)
    alarm = page[page.index('class="alarm"') : page.index("</section>")]
    assert "compaction=broken" in alarm and "check failed" in alarm
    assert "17" in alarm and "ran out of memory" in alarm and "wave=1" in alarm
    assert "1 failed check" in page and "1 run stopped by an error" in page
    for name in figures():
        assert "compaction=broken" not in (drawn / "tables" / f"{name}.csv").read_text(), name
    refused = numbers_of(drawn, "agreement").query("not valid")
    assert list(refused["variant"]) == ["deferred:ray-space:compaction=broken"]
    assert 'class="refused"' in page


def test_speedups_are_ratios_of_intersection_rates(drawn):
    numbers = numbers_of(drawn, "intersection_speedup")
    one = numbers.query("scene == 'Sponza' and intersector == 'ray-space'").set_index("baseline")["speedup"]
    assert one["same intersector"] == pytest.approx(1823 / 91, rel=0.1)
    assert one["fastest work-optimal"] == pytest.approx(1823 / 2.5 / 91, rel=0.1)
    assert (numbers["speedup_low"] <= numbers["speedup"]).all()
    assert (numbers["speedup"] <= numbers["speedup_high"]).all()
    assert set(numbers["grid"]) == {"8/128 total"}


def test_paper_traversal_rates_stand_beside_ours(drawn):
    numbers = numbers_of(drawn, "traversal_rate").query("series == 'paper'")
    expected = {"Sponza": 70, "Hairball (stand-in)": 23, "Crown": 65}
    assert dict(zip(numbers["scene"], numbers["traversal_mrays_per_s"], strict=True)) == expected


def test_intersector_ratio_is_reported_as_it_is(drawn):
    numbers = numbers_of(drawn, "intersectors")
    assert numbers["intersection_ratio"].to_numpy() == pytest.approx(1.4, rel=0.1)


def test_end_to_end_names_the_fastest_and_marks_fewer_rays(drawn):
    numbers = numbers_of(drawn, "end_to_end").query("scene == 'Crown'").set_index("series")
    fastest = numbers_of(drawn, "end_to_end").query("scene == 'Crown' and tracer == 'deferred'")
    assert numbers.loc["deferred, fastest", "total_mrays_per_s"] == fastest["total_mrays_per_s"].max()
    assert {"Embree robust", "Embree fast", "forward, fastest", "brute force"} <= set(numbers.index)
    assert numbers.loc["brute force", "fewer_rays"] and not numbers.loc["Embree fast", "fewer_rays"]
    assert "work-optimal" not in set(numbers["tracer"])


def test_figures_do_not_mix_numbers_of_rays(drawn):
    for name in ("intersection_speedup", "stages"):
        assert set(numbers_of(drawn, name)["rays"]) == {RAYS}, name
    resolution = numbers_of(drawn, "resolution")
    assert set(resolution["rays"]) == {RAYS // 10}
    assert sorted(set(resolution["cells_per_axis"])) == [32, 64, 128, 256, 512]


def test_order_of_records_does_not_matter(tmp_path):
    records = scene_records("sponza")
    make_folder(tmp_path / "one", records)
    make_folder(tmp_path / "two", records[::-1])
    one, two = (read_runs(tmp_path / name) for name in ("one", "two"))
    for name, entry in {**figures(), **tables()}.items():
        pd.testing.assert_frame_equal(entry.select(one), entry.select(two), obj=name)


def test_another_grid_than_the_papers_is_named(tmp_path):
    grid = (8, 64, "total")
    make_folder(
        tmp_path,
        [
            deferred("sponza", grid=grid),
            one_record("sponza", "work-optimal", "ray-space", {"intersect": 900}, grid=grid),
        ],
    )
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert set(numbers_of(tmp_path, "intersection_speedup")["grid"]) == {"8/64 total"}
    assert page.count("nothing was measured on the paper&#39;s 8/128 total") >= 3


def test_a_run_without_a_check_is_named_so(tmp_path):
    record = deferred("sponza", wrong=1)
    record["agreement"] |= {"reference": "none", "wrong": 0} | (
        {"reason": "not checked"} if "reason" in record["agreement"] else {}
    )
    make_folder(tmp_path, [record])
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "1 run without a check" in page and "0 failed checks" in page and "no check: not checked" in page


def test_stages_add_up_to_the_total(drawn):
    numbers = numbers_of(drawn, "stages")
    parts = numbers[[f"{stage}_ns" for stage in ("traverse", "arrange", "intersect", "compact", "other")]]
    assert parts.sum(axis=1).to_numpy() == pytest.approx(numbers["total_ns"].to_numpy(), rel=1e-6)


@pytest.mark.slow
def test_smoke_tier_with_one_repetition_and_no_sweep(tmp_path):
    records = [record for scene in SMOKE for record in scene_records(scene)]
    for record in records:
        record["repetitions"] = 1
        record["samples"] = {stage: values[:1] for stage, values in record["samples"].items()}
        found = rates(Samples(**record["samples"]), record["rays"]["count"])
        record["rate"] = {stage: rate and rate.as_dict() for stage, rate in found.items()}
    make_folder(tmp_path, records)
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "needs diffuse runs of one scene on at least three resolutions" in page
    assert "single repetition" in page and 'class="alarm"' not in page
    assert not (tmp_path / "figures" / "resolution.svg").exists()
    assert (tmp_path / "figures" / "intersection_speedup.svg").exists()


@pytest.mark.parametrize("tracer", ["deferred", "embree", "brute"])
def test_a_lone_run_makes_a_report(tmp_path, tracer):
    grid = (8, 128, "total") if tracer == "deferred" else None
    name = None if tracer == "embree" else "ray-space"
    make_folder(tmp_path, [one_record("sponza", tracer, name, {"total": 300}, grid=grid)])
    assert "1 run " in write_report(tmp_path).read_text(encoding="utf-8")


@pytest.mark.parametrize("options", [{}, {"least": "4", "axis": "x"}])
def test_a_structure_that_is_no_grid_goes_by_its_name_and_options(tmp_path, options):
    structure = {"reading": "all-triangles", "options": options}
    name = "all-triangles axis=x least=4" if options else "all-triangles"
    size = {key: 1 for key in ("cells", "nonempty", "references", "bytes", "build_seconds")}
    records = [record for record in scene_records("sponza") if record["grid"]]
    for place, record in enumerate(records[1::2]):
        record |= {"id": f"{place:016}", "grid": structure | size, "spec": {"grid": structure}}
    make_folder(tmp_path, records)
    grid = structure | size
    for kind, file, row in (
        (RooflineRow, roofline_file, roofline_row("sponza", "deferred") | {"grid": grid}),
        (CoherenceRow, coherence_file, coherence_row("sponza") | {"grid": grid}),
    ):
        file(tmp_path).append(as_row(kind, row))
    write_report(tmp_path)
    shown = {table.stem: table.read_text(encoding="utf-8") for table in (tmp_path / "tables").glob("*.csv")}
    for stem in ("grids", "counters", "agreement", "kernel_times", "roofline", "coherence", "end_to_end"):
        assert name in shown[stem], stem
    assert "None" not in without_scripts(page_of(tmp_path)) + "".join(shown.values())
    run = next(run for run in read_runs(tmp_path).records if run.grid.top is None)
    assert grid_text(run.grid) == beside_text(run) == str(structure_from_json(structure)) == name


def test_only_failed_runs_make_a_report_without_figures_of_rates(tmp_path):
    make_folder(tmp_path, [deferred("sponza", wrong=3)])
    assert "1 failed check" in write_report(tmp_path).read_text(encoding="utf-8")
    assert sorted(path.name for path in (tmp_path / "figures").glob("*.svg")) == ["views.svg"]


def test_a_run_measured_again_counts_once(tmp_path):
    records = [record for record in scene_records("sponza") if record["tracer"] == "deferred"]
    make_folder(tmp_path, records + records)
    assert len(read_runs(tmp_path).valid) == len(records)


def test_stale_files_do_not_survive(tmp_path):
    make_folder(tmp_path, [deferred("sponza", wrong=1)])
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "old.svg").write_text("old")
    (tmp_path / "figures" / "notes.txt").write_text("not ours")
    write_report(tmp_path)
    assert not (tmp_path / "figures" / "old.svg").exists()
    assert (tmp_path / "figures" / "notes.txt").exists()


def test_text_of_records_is_escaped(tmp_path):
    record = deferred("sponza", wrong=1)
    record["command"] = "defray <b>trace</b> & more"
    make_folder(tmp_path, [record])
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "<b>trace" not in page and "&lt;b&gt;trace" in page


@pytest.mark.parametrize("content", [None, ""])
def test_no_records_is_one_clear_line(tmp_path, content):
    if content is not None:
        (tmp_path / "records.jsonl").write_text(content)
    with pytest.raises(DefrayError, match=r"no records in .*records\.jsonl") as caught:
        write_report(tmp_path)
    assert "\n" not in str(caught.value)


def test_foreign_schema_is_refused(tmp_path):
    make_folder(tmp_path, [{**deferred("sponza"), "schema": 999}])
    with pytest.raises(DefrayError, match="schema 999"):
        write_report(tmp_path)


@pytest.mark.parametrize("name", ["sweep.json", "env.json"])
def test_damaged_side_files_are_named(tmp_path, name):
    make_folder(tmp_path, [deferred("sponza")])
    (tmp_path / name).write_text("{")
    with pytest.raises(DefrayError, match=name):
        write_report(tmp_path)


def test_published_numbers_name_their_place():
    published = read_published()
    assert all(scene["place"] for scene in published["scene"])
    assert all(other["place"] and other["hardware"] and other["rays"] for other in published["other"])
