"""The stress suite: what it must find, what must pass it, and that it can fail."""

from __future__ import annotations

import dataclasses
import json
import resource

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.commands.main import app
from harness.data import Hits, Rays
from harness.errors import DefrayError
from harness.records.digest import digest_of, sealed
from harness.records.schema import SCHEMA, Machine
from harness.records.stability_row import FILE, ResultsFile, StressRow, read_results
from harness.spec.intersectors import DEFAULT, INTERSECTORS, find
from harness.spec.stress_suite import families, select
from harness.studies.stability import offsets
from harness.studies.stability import whole_scenes as scenes
from harness.studies.stability.closed_meshes import closed_mesh, icosphere
from harness.studies.stability.failures import Judge, merge
from harness.studies.stability.pairs import Answers, Pairs, PairTester, contracts
from harness.studies.stability.stress_run import (
    TRIALS,
    check_inputs,
    chosen,
    generators,
    measure_family,
    methods_of,
)

ROW_ON_FILE = {
    "intersector": "ray-space", "contraction": "off", "family": "A1", "size": "smoke", "rays": 10, "leaks": None,
    "double_hits": None, "band_ulp": 0.5, "residual_p99_ulp": 1.0, "gross": 0, "nonfinite": 0, "self_hits": None,
    "tunnels": None, "passed": True,
}  # fmt: skip
MACHINE = {
    "cpu": "a cpu", "cores": 2, "os": "an os", "device": "one", "platform": "a platform", "driver": "1",
    "versions": {},
}  # fmt: skip
ROBUST = ("ray-space", "ray-space-orthonormal", "woop-benthin-wald-kahan")


@pytest.fixture(scope="module")
def smoke_rows(device):
    """Every intersector through every family in both modes, at the smoke size."""
    methods = methods_of(chosen("all", device))
    return [row for family in select(None) for row in measure_family(device, family, methods, "smoke")]


def metrics_of(device, name, family, mode="off"):
    """Metrics of one intersector."""
    trial = TRIALS[families()[family].kind](device, families()[family], "smoke")
    return merge(trial.measure(find(name), mode))


def test_every_intersector_runs_every_family_in_both_modes(smoke_rows, device):
    methods = {(row.intersector, row.contraction) for row in smoke_rows}
    assert len(methods) == 2 * len(chosen("all", device)) >= 24
    assert len(smoke_rows) == len(methods) * len(families())
    assert len({row.key for row in smoke_rows}) == len(smoke_rows)


def test_the_default_passes_everything(smoke_rows):
    rows = [row for row in smoke_rows if row.intersector == DEFAULT]
    assert rows and [row.family for row in rows if not row.passed] == []
    assert INTERSECTORS[DEFAULT].watertight


@pytest.mark.parametrize("name", ROBUST)
def test_differences_of_products_pass_w_a_d_and_g_in_both_modes(smoke_rows, name):
    rows = [row for row in smoke_rows if row.intersector == name and row.family[0] in "WADG"]
    assert len(rows) > 20 and [(r.family, r.contraction) for r in rows if not r.passed] == []


def test_no_intersector_registered_as_watertight_leaks(smoke_rows):
    rows = [row for row in smoke_rows if INTERSECTORS[row.intersector].watertight and row.leaks is not None]
    assert rows and not any(row.leaks for row in rows)


def test_the_known_failures_are_found(smoke_rows):
    """A suite in which nothing fails has no power."""
    failed = {(row.intersector, row.family) for row in smoke_rows if not row.passed}
    expected = {
        ("moller-trumbore", "W1"), ("moller-trumbore", "A1"), ("moller-trumbore-epsilon", "A4"),
        ("moller-trumbore-double", "W1"), ("plucker-zero", "W1"), ("pbrt", "A3"), ("baldwin-weber", "A2"),
        ("woop-unit-triangle", "W7"), ("havel-herout", "W2"), ("kensler-shirley", "W3"),
        ("woop-benthin-wald-kahan", "S1"),
    }  # fmt: skip
    assert expected <= failed


def test_contraction_is_what_the_modes_say(device):
    assert contracts(device)["off"] is False


def test_contraction_breaks_the_plain_watertight_tests(device):
    if not contracts(device)["on"]:
        pytest.skip("this compiler does not contract even when asked to")
    for name in ("woop-benthin-wald", "ray-space-plain"):
        for family in ("W2", "W3"):
            assert metrics_of(device, name, family, "off")["leaks"] == 0
            assert metrics_of(device, name, family, "on")["leaks"] > 0


def test_a_folded_origin_fails_far_from_the_world_s_origin(device):
    metrics = metrics_of(device, "ray-space-folded", "A2")
    assert metrics["band_ulp"] > 1000 and not families()["A2"].passes(metrics)


def test_a_comparison_that_accepts_nan_fails(device, mutate):
    """Written to reject instead of to accept, the test lets NaN through; the driver's comparison is what stops it."""
    mutate("signs-rejected")
    assert metrics_of(device, "ray-space-plain", "D2")["gross"] == 0
    mutate("signs-rejected", "nan-accepted")
    broken = metrics_of(device, "ray-space-plain", "D2")
    assert broken["nonfinite"] > 0 and broken["gross"] > 0 and not families()["D2"].passes(broken)


def test_a_direction_that_is_not_scaled_fails(device, mutate):
    name = "ray-space-orthonormal"  # whose frame takes the square of the direction's length
    assert metrics_of(device, name, "A4")["gross"] == 0
    mutate("direction-not-scaled")
    assert metrics_of(device, name, "A4")["gross"] > 0


def test_spawned_rays_without_an_offset_hit_where_they_start(device):
    case, generator = next(iter(generators(families()["S1"])))
    inputs = offsets.offset_inputs(case, 1500, generator)
    found = {
        method: offsets.judge_offsets(device, case | {"method": method}, inputs, find(DEFAULT), "off", generator)
        for method in ("none", "error-bound")
    }
    assert found["none"]["self_hits"] > 100 and found["error-bound"]["self_hits"] == 0


def test_waechter_binder_tunnels_through_small_shapes(device):
    family = families()["S1"]
    case = dict(family.cases[2], method="waechter-binder")
    inputs = offsets.offset_inputs(case, 1500, np.random.default_rng(1))
    metrics = offsets.judge_offsets(device, case, inputs, find(DEFAULT), "off", np.random.default_rng(2))
    assert metrics["tunnels"] > 0 and not family.passes(metrics)


def test_an_intersector_that_misses_everything_fails_the_degenerate_scene():
    triangles, rays = scenes.degenerate_inputs({}, 500, np.random.default_rng(3))
    none = np.full(500, np.inf, np.float32), np.full(500, -1, np.int32), *np.zeros((2, 500), np.float32)
    assert scenes.judge_degenerate(triangles, rays, Hits(*none))["gross"] > 100


@pytest.fixture
def aimed():
    """Three rays at the middle of a square of two triangles, and a judge who knows."""
    triangles = np.array([[[0, 0, 0], [2, 0, 0], [2, 2, 0]], [[0, 0, 0], [2, 2, 0], [0, 2, 0]]], np.float32)
    origins = np.array([[1, 1, 1], [1.5, 0.5, 1], [0.5, 1.5, 1]], np.float32)
    rays = Rays(origins, np.float32([[0, 0, -1]] * 3), np.full(3, np.inf, np.float32))
    ray, triangle = np.divmod(np.arange(6, dtype=np.int32), 2)
    truth = np.array([True, True, True, False, False, True])
    t = np.ones(6, np.float32)
    pairs = Pairs(rays, triangles, ray, triangle)
    return pairs, Answers(truth, truth, t, t * 0, t * 0)


def test_true_answers_have_no_fault(aimed):
    pairs, answers = aimed
    assert Judge(pairs, "aimed").judge(answers) | {"rays": 3} == {
        **dict.fromkeys(("band_ulp", "residual_p99_ulp", "gross", "self_hits", "tunnels")),
        "rays": 3, "leaks": 0, "double_hits": 0, "nonfinite": 0,
    }  # fmt: skip
    assert Judge(pairs, "single").judge(answers)["gross"] == 0


def test_a_dropped_hit_a_double_hit_and_a_nan_are_counted(aimed):
    pairs, answers = aimed
    dropped, doubled, t = answers.accepted.copy(), answers.accepted.copy(), answers.t.copy()
    dropped[2], doubled[3], t[0] = False, True, np.nan
    assert Judge(pairs, "aimed").judge(dataclasses.replace(answers, accepted=dropped))["leaks"] == 1
    assert Judge(pairs, "aimed").judge(dataclasses.replace(answers, accepted=doubled))["double_hits"] == 1
    assert Judge(pairs, "aimed").judge(dataclasses.replace(answers, t=t))["nonfinite"] == 1


def test_a_hit_beside_the_triangle_and_a_t_off_its_plane_are_gross(aimed):
    pairs, answers = aimed
    beside, t = answers.accepted.copy(), answers.t.copy()
    beside[3], t[5] = True, 1.5
    judged = Judge(pairs, "single").judge(dataclasses.replace(answers, accepted=beside, t=t))
    assert judged["gross"] == 2 and judged["band_ulp"] > 1e6 and judged["residual_p99_ulp"] > 1e6


def test_a_coplanar_hit_must_lie_on_its_triangle():
    triangle = np.array([[[0, 0, 0], [4, 0, 0], [0, 4, 0]]], np.float32)
    rays = Rays(np.float32([[-1, 1, 0]]), np.float32([[1, 0, 0]]), np.full(1, np.inf, np.float32))
    judge = Judge(Pairs(rays, triangle, np.zeros(1, np.int32), np.zeros(1, np.int32)), "coplanar")
    for t, gross in ((2.0, 0), (4.0, 0), (4.5, 1), (0.5, 1)):
        yes, value = np.ones(1, bool), np.full(1, t, np.float32)
        assert judge.judge(Answers(yes, yes, value, value, value))["gross"] == gross


def test_inputs_that_are_not_the_frozen_bits_are_refused():
    family = families()["W1"]
    with pytest.raises(DefrayError, match="family W1 have SHA-256 abc"):
        check_inputs(family, "smoke", "abc")


def test_a_limit_on_what_is_not_measured_is_no_pass():
    metrics = {"rays": 10, "leaks": None, "nonfinite": 0}
    with pytest.raises(KeyError, match="W1 limits leaks"):
        families()["W1"].passes(metrics)


def test_a_mesh_with_a_hole_is_refused():
    vertices, faces = icosphere(1, np.random.default_rng(0))
    assert len(closed_mesh(vertices, faces).faces) == 80
    with pytest.raises(ValueError, match="not closed"):
        closed_mesh(vertices, faces[1:])


def test_a_device_without_doubles_is_refused(device, aimed):
    tester = PairTester(dataclasses.replace(device, has_double=False), aimed[0])
    with pytest.raises(DefrayError, match="no double precision, which moller-trumbore-double needs"):
        tester.run(find("moller-trumbore-double"))
    names = {entry.name for entry in chosen("all", dataclasses.replace(device, has_double=False))}
    assert DEFAULT in names and "moller-trumbore-double" not in names


def test_the_command_prints_json_and_writes_a_file_that_reads_back(tmp_path):
    arguments = ["stability", "--size", "smoke", "--family", "W2", "--out", str(tmp_path), "--json"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    rows = json.loads(result.stdout)
    assert [(row["contraction"], row["passed"]) for row in rows] == [("off", True), ("on", True)]
    results = read_results(tmp_path)
    assert [row.as_json() for row in results.rows] == rows
    assert all(rate.tests_per_second.median > 0 for rate in results.kernel_rates)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.studies.stability.suite.measure_family", None)
        patch.setattr("harness.studies.stability.suite.kernel_rates", None)
        again = CliRunner().invoke(app, [*arguments, "--resume"])
        shown = CliRunner().invoke(app, [*arguments[:-1], "--resume"])
    assert again.exit_code == 0 and json.loads(again.stdout) == rows, "and nothing is measured again"
    assert shown.exit_code == 0 and "ray-space" in shown.stdout and "self-hits" in shown.stdout


def test_a_results_file_of_another_schema_or_with_unknown_keys_is_refused(tmp_path):
    good = {"schema": SCHEMA, "machine": MACHINE, "contracts": {}, "rows": []}
    file = tmp_path / FILE
    file.write_text(json.dumps(sealed(good)))
    assert read_results(tmp_path).rows == []
    changes = [{"schema": 99}, {"more": 1}, {"rows": [{"passed": True}]}]
    changes += [{"rows": [ROW_ON_FILE | wrong]} for wrong in ({"rays": 0}, {"family": "Z9"}, {"band_ulp": np.nan})]
    file.write_text(json.dumps(sealed(good | {"rows": [ROW_ON_FILE]})))
    assert read_results(tmp_path).rows[0].passed
    texts = [json.dumps({**good, **change, "digest": digest_of(good)}) for change in changes]
    texts += [json.dumps(sealed(good | change)) for change in changes if "NaN" not in json.dumps(change)]
    for text in [*texts, json.dumps(good), "[]", "{", '{"schema_": 1}']:
        file.write_text(text)
        with pytest.raises(DefrayError, match=r"stability.json"):
            read_results(tmp_path)


def test_a_second_run_adds_to_the_file_and_another_device_is_refused(tmp_path):
    file = ResultsFile(tmp_path, Machine(**MACHINE), {"off": False, "on": True})
    file.add([StressRow(**ROW_ON_FILE), StressRow(**ROW_ON_FILE | {"family": "W2"})])
    again = ResultsFile(tmp_path, Machine(**MACHINE), {"off": False, "on": True})
    again.add([StressRow(**ROW_ON_FILE | {"passed": False})])
    rows = read_results(tmp_path).rows
    assert [(row.family, row.passed) for row in rows] == [("A1", False), ("W2", True)]
    with pytest.raises(DefrayError, match="holds results of one, not of two"):
        ResultsFile(tmp_path, Machine(**MACHINE | {"device": "two"}), {})


def test_a_folder_that_cannot_be_written_is_refused_before_measuring(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DefrayError, match="cannot write to"):
        ResultsFile(tmp_path / "file" / "below", Machine(**MACHINE), {})


def test_a_disk_that_fills_up_meanwhile_is_one_line(tmp_path):
    file = ResultsFile(tmp_path, Machine(**MACHINE), {"off": False, "on": True})
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))  # bytes that a file may have
    try:
        with pytest.raises(DefrayError, match=r"cannot write .*stability.json: File too large"):
            file.add([StressRow(**ROW_ON_FILE)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert read_results(tmp_path) is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--family", ""], "unknown family ''; known: "),
        (["--family", "X9"], "unknown family 'X9'; known: "),
        (["--intersector", "best"], "unknown intersector 'best'"),
        (["--size", "tiny"], "--size is full or smoke, not 'tiny'"),
    ],
)
def test_bad_arguments_are_one_line(arguments, message):
    with pytest.raises(DefrayError) as caught:
        CliRunner().invoke(app, ["stability", *arguments], catch_exceptions=False, standalone_mode=False)
    assert message in str(caught.value) and "\n" not in str(caught.value)
