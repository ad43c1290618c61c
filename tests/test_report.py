"""The report: every figure in three formats, the same bytes again, one page that needs nothing else."""

from __future__ import annotations

import hashlib
import json
import re

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from made_up_accuracy import write_accuracy
from made_up_roofline import write_roofline

from harness import record as record_module
from harness.data import Samples
from harness.digest import sealed
from harness.errors import DefrayError
from harness.figures import figures
from harness.figures.runs import read_published
from harness.report import read_runs, write_report
from harness.stats import rates
from harness.tables import tables

SIZES = {"sponza": 279_163, "conference": 331_179, "hairball": 2_880_000, "crown": 3_540_215,
         "san-miguel": 9_390_000}
STAND_INS = ("hairball",)
# Invented nanoseconds a ray on the paper's grid: walk, arrange, deferred intersection, work-optimal.
TIMES = {"sponza": (70, 29, 91, 1823), "conference": (45, 32, 54, 308), "hairball": (900, 210, 1400, 9100),
         "crown": (430, 80, 610, 4532), "san-miguel": (240, 116, 178, 3900)}
EMBREE = {"sponza": 270, "conference": 82, "hairball": 400, "crown": 204, "san-miguel": 314}
RAYS = 1_000_000
SMOKE = ("sponza", "hairball")


def agreement(rays: int, wrong: int = 0) -> dict:
    """Agreement with the keys that this version of the record declares."""
    full = {"reference": "embree", "rays": rays, "same": rays - 120 - wrong, "tie": 118, "t_off": 2,
            "wrong": wrong, "missed": 0, "phantom": 0, "reference_wrong": 3, "settled": 5, "nonfinite": 0,
            "worst_band_ulp": 2.5, "t_relative_error": {"p50": 1e-8, "p99": 3e-7, "max": 4e-5},
            "valid": wrong == 0, "reason": f"{wrong} rays hit a wrong primitive" if wrong else ""}
    return {key: value for key, value in full.items() if key in record_module.Agreement.model_fields}


def one_record(scene, tracer, intersector, stages, *, options=None, grid=(8, 128, "total"), rays=RAYS,
               wrong=0, repetitions=5) -> dict:
    """A record with made-up times: `stages` maps a stage to nanoseconds a ray."""
    name = json.dumps([scene, tracer, intersector, options, grid, rays])
    identity = hashlib.sha256(name.encode()).hexdigest()[:16]
    random = np.random.default_rng(int(identity, 16) % 2**32)
    seconds = {stage: [float(value * rays * 1e-9 * factor)
                       for factor in random.lognormal(0, 0.03, repetitions)]
               for stage, value in stages.items()}
    samples = {stage: seconds.get(stage, []) for stage in ("traverse", "arrange", "intersect", "compact")}
    samples["total"] = seconds.get("total") or [float(sum(part) * 1.06) for part in
                                               zip(*filter(None, samples.values()), strict=True)]
    rate = rates(Samples(**samples), rays, valid=wrong == 0)
    cells = (grid[1] * (grid[0] if grid[2] == "per-cell" else 1)) ** 3 // 20 if grid else 0
    return {
        "schema": record_module.SCHEMA, "id": identity, "time_utc": "2026-01-02T03:04:05Z",
        "command": f"defray trace {scene} --tracer {tracer}", "commit": "0123456789abcdef", "dirty": False,
        "machine": {"cpu": "Test CPU", "cores": 2, "os": "Linux", "device": "pthread-test AVX-512 device",
                    "platform": "Portable Computing Language", "driver": "3.1",
                    "versions": {"numpy": "2.0", "pyopencl": "2026.1"}},
        "scene": {"name": scene, "source": "stand-in" if scene in STAND_INS else "real",
                  "triangles": SIZES[scene], "sha256": "ab" * 32},
        "view": None, "rays": {"kind": "diffuse", "count": rays, "seed": 1},
        "grid": {"top": grid[0], "leaf": grid[1], "reading": grid[2], "cells": cells, "nonempty": cells // 9,
                 "references": SIZES[scene] * 3, "bytes": SIZES[scene] * 12 + cells * 4,
                 "build_seconds": 1.5} if grid else None,
        "tracer": tracer, "intersector": intersector, "options": options or {}, "repetitions": repetitions,
        "spec": {}, "samples": samples, "rate": rate,
        "counters": {"steps": 33 * rays, "pairs": 8 * rays, "tests": 140 * rays, "lane_tests": 149 * rays,
                     "waves": 6, "finished_per_wave": [rays], "padding": 4 * rays},
        "agreement": agreement(rays, wrong), "valid": wrong == 0,
    }


def deferred(scene, intersector="ray-space", walk=1.0, work=1.0, **keys) -> dict:
    """A deferred record whose stages are the table's times by these factors."""
    traverse, arrange, intersect, _ = TIMES[scene]
    slower = 1.4 if intersector == "moller-trumbore" else 1.0
    return one_record(scene, "deferred", intersector, {
        "traverse": traverse * walk, "arrange": arrange * walk, "intersect": intersect * slower * work,
        "compact": arrange * 0.2}, **keys)


def scene_records(scene: str) -> list[dict]:
    """What the paper tier measures on one scene, without the sweep of resolutions."""
    optimal = TIMES[scene][3]
    found = []
    for name, slower in (("ray-space", 1.0), ("moller-trumbore", 1.15)):
        found += [deferred(scene, name),
                  one_record(scene, "work-optimal", name, {"intersect": optimal * slower}),
                  one_record(scene, "work-optimal", name, {"intersect": optimal * slower / 2.5},
                             options={"lanes": "8"}),
                  one_record(scene, "forward", name, {"total": optimal * slower * 1.1})]
    found += [deferred(scene, options={"arrange": "sort"}, walk=3.0),
              deferred(scene, options={"arrange": "record"}, walk=0.7),
              deferred(scene, options={"arrange": "record", "wave": "8"}, walk=0.7),
              deferred(scene, grid=(8, 128, "per-cell"), walk=5.0, work=0.5)]
    found += [one_record(scene, "embree", None, {"total": EMBREE[scene] * slower}, options={"robust": robust},
                         grid=None) for robust, slower in (("true", 1.0), ("false", 0.9))]
    found += [deferred(scene, options=options, work=work) for options, work in (
        ({"wave": "2"}, 0.9), ({"wave": "all"}, 1.8), ({"compaction": "false"}, 1.1))]
    return [*found, one_record(scene, "brute", "ray-space", {"total": 900 * SIZES[scene] / 1000}, grid=None,
                               rays=20_000)]


def resolution_records(scene: str) -> list[dict]:
    """Resolutions around the paper's 128, with fewer rays than figure 1."""
    found = []
    found += [deferred(scene, walk=leaf / 128, work=128 / leaf, grid=(16, leaf, "total"), rays=RAYS // 10)
              for leaf in (32, 64, 128)]
    found += [deferred(scene, walk=0.4, work=0.3, grid=(40, 16, "adaptive"), rays=RAYS // 10)]
    for leaf in (32, 64, 128, 256, 512):
        fine, grid = leaf / 128, (8, leaf, "total")
        optimal = TIMES[scene][3] * (0.4 / fine + 0.6)
        usual = {"grid": grid, "rays": RAYS // 10}
        found += [deferred(scene, walk=fine, work=0.8 / fine + 0.2, **usual),
                  one_record(scene, "work-optimal", "ray-space", {"intersect": optimal}, **usual),
                  one_record(scene, "forward", "ray-space", {"total": optimal * 1.1 + 99 * fine}, **usual)]
    return found


def ladder_records(scene: str) -> list[dict]:
    """Rungs of the size ladder with fewer rays than figure 1, the whole scene among them."""
    found = []
    for size, part in (("@1/64", 1 / 64), ("@1/16", 1 / 16), ("@1/4", 1 / 4), ("", 1.0)):
        optimal = {"intersect": TIMES[scene][3] * part**0.6}
        for record in (deferred(scene, walk=part**0.2, work=part**0.3, rays=RAYS // 5),
                       one_record(scene, "work-optimal", "ray-space", optimal, rays=RAYS // 5)):
            record["id"] = hashlib.sha256((record["id"] + size).encode()).hexdigest()[:16]
            record["scene"] |= {"name": scene + size, "triangles": int(SIZES[scene] * part)}
            found.append(record)
    return found


def ray_count_records(scene: str) -> list[dict]:
    """Few rays cost more each than many; those of figure 1 are the third point."""
    found = []
    for rays, dearer in ((RAYS // 16, 1.6), (RAYS // 4, 1.2), (RAYS * 4, 0.95)):
        found.append(deferred(scene, walk=dearer, work=dearer, rays=rays))
        found.append(one_record(scene, "embree", None, {"total": EMBREE[scene]}, options={"robust": "true"},
                                grid=None, rays=rays))
    return found


def make_folder(folder, records: list[dict], views=()) -> None:
    """An output folder as a sweep leaves it."""
    folder.mkdir(parents=True, exist_ok=True)
    text = "".join(json.dumps(sealed(record)) + "\n" for record in records)
    (folder / "records.jsonl").write_text(text, encoding="utf-8")
    (folder / "env.json").write_text(json.dumps(records[0]["machine"] if records else {}), encoding="utf-8")
    sweep = {"seed": 1, "tier": "paper", "command": "make reproduce TIER=paper"}
    (folder / "sweep.json").write_text(json.dumps(sweep), encoding="utf-8")
    (folder / "views").mkdir(exist_ok=True)
    for name in views:
        down, across = np.mgrid[0:96, 0:128]
        picture = 0.5 + 0.5 * np.sin(across / 9 + len(name)) * np.cos(down / 13)
        matplotlib.image.imsave(folder / "views" / f"{name}.png", picture, cmap="gray")


def paper_folder(folder, scenes=tuple(SIZES)):
    """A full folder: some scenes, a sweep of resolutions, one failed check, one run stopped by an error."""
    records = [one for scene in scenes for one in scene_records(scene)]
    records += [one for scene in scenes for one in resolution_records(scene)]
    records += [one for scene in scenes for one in ladder_records(scene)]
    records += [one for scene in scenes for one in ray_count_records(scene)]
    records.append(deferred("crown", options={"compaction": "broken"}, wrong=17))
    make_folder(folder, records, [*(name for name in scenes if name != "crown"), "sponza-stand-in"])
    error = {"id": "feedfeedfeedfeed", "scene": "crown", "run": "crown 8/128 deferred:ray-space:wave=1",
             "error": "the device ran out of memory"}
    (folder / "errors.jsonl").write_text(json.dumps(error) + "\n", encoding="utf-8")
    write_accuracy(folder)
    write_roofline(folder)
    return folder


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A full report, drawn once: its folder."""
    folder = paper_folder(tmp_path_factory.mktemp("report") / "out", ("sponza", "hairball", "crown"))
    assert write_report(folder) == folder / "report.html"
    return folder


def page_of(folder) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def without_scripts(page: str) -> str:
    """The page as a reader without scripts has it."""
    return re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def numbers_of(folder, name: str) -> pd.DataFrame:
    return pd.read_csv(folder / "tables" / f"{name}.csv", keep_default_na=False, na_values=[""])


def test_every_figure_has_three_formats_and_every_block_its_numbers(drawn):
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
    alarm = page[page.index('class="alarm"'):page.index("</section>")]
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
    for name, module in {**figures(), **tables()}.items():
        pd.testing.assert_frame_equal(module.select(one), module.select(two), obj=name)


def test_another_grid_than_the_papers_is_named(tmp_path):
    grid = (8, 64, "total")
    make_folder(tmp_path, [deferred("sponza", grid=grid),
                           one_record("sponza", "work-optimal", "ray-space", {"intersect": 900}, grid=grid)])
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert set(numbers_of(tmp_path, "intersection_speedup")["grid"]) == {"8/64 total"}
    assert page.count("nothing was measured on the paper&#39;s 8/128 total") >= 3


def test_a_run_without_a_check_is_named_so(tmp_path):
    record = deferred("sponza", wrong=1)
    record["agreement"] |= {"reference": "none", "wrong": 0} | (
        {"reason": "not checked"} if "reason" in record["agreement"] else {})
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
        record["rate"] = rates(Samples(**record["samples"]), record["rays"]["count"])
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
