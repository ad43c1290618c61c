"""Recommendations: the fastest variant that is shown to be accurate enough, and none that is merely hoped to be."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
from made_up_accuracy import VARIANTS, accuracy_row, as_row
from shapes import icosphere
from typer.testing import CliRunner

from harness.campaign import recommendation as module
from harness.campaign.recommendation import Deeper, Limits, advice_lines, advise, find_rows, measured_here
from harness.commands.main import app
from harness.data import Scene
from harness.device.machine import machine_description
from harness.errors import DefrayError
from harness.inputs.scenes_by_name import load_scene
from harness.measure.group import scene_facts
from harness.measure.scene import Scenes
from harness.records.accuracy_row import AccuracyBody, AccuracyRow, AimedCounts, accuracy_file
from harness.studies.errors_and_leaks import Contender, Plan, measure_accuracy

PLAN = Plan(rays=1_000, aimed=1_000, repetitions=1)


def row_of(variant: str, scene: str = "sponza", **changed) -> AccuracyRow:
    return as_row(AccuracyRow, accuracy_row(scene, variant, **changed))


def rows_of(**changed) -> list[AccuracyRow]:
    return [row_of(variant, **changed) for variant in VARIANTS]


def never(row: AccuracyBody) -> AccuracyBody:
    raise AssertionError(f"{row.variant} needs no more rays")


def test_the_fastest_that_meets_the_limit_and_the_next():
    advice = advise("sponza", rows_of(), Limits(1e-2), never)
    assert advice.choice.variant == "embree" and advice.following.variant == "deferred:ray-space:contraction=on"
    assert [row.variant for row, _ in advice.refused] == ["embree:robust=false"]
    watertight = advise("sponza", rows_of(), Limits(1e-4), never)
    assert watertight.choice.variant == "deferred:ray-space:contraction=on"
    assert watertight.following.variant == "deferred:ray-space" and watertight.meeting == 3


def test_observed_below_the_limit_is_not_shown_to_be():
    rows = [row_of("deferred:plucker", leaks=9, aimed=1_000_000)]
    assert advise("sponza", rows, Limits(1e-5), never).choice is None, "9 of a million may be 1.6e-5"
    assert advise("sponza", rows, Limits(1e-4), never).choice is not None


def test_the_error_of_t_counts_too():
    rows = [row_of("deferred:fast", rate=9.0, t_error=1e-3), *rows_of()]
    advice = advise("sponza", rows, Limits(1e-4, 1e-5), never)
    assert advice.choice.variant == "deferred:ray-space:contraction=on"
    assert "t error" in advice.refused[0][1]
    assert advise("sponza", rows, Limits(1e-4), never).choice.variant == "deferred:fast"


def test_too_few_rays_are_followed_by_more_for_the_fastest_alone():
    asked = []

    def deepen(row: AccuracyBody) -> AccuracyBody:
        asked.append(row.variant)
        leaks = int(row.variant.endswith("on"))
        aimed = AimedCounts(rays=3_000_000, leaks=leaks, at_vertices=1, vertex_leaks=0, seed=1)
        return row.model_copy(update={"aimed": aimed})

    advice = advise("sponza", rows_of(), Limits(1e-6), deepen)
    assert asked == ["deferred:ray-space:contraction=on", "deferred:ray-space"]
    assert advice.choice.variant == "deferred:ray-space"
    assert "shown with 100,000 aimed rays only" in "\n".join(advice_lines(advice))


def test_nothing_that_meets_the_limits_is_one_line():
    advice = advise("sponza", rows_of(leaks=5_000), Limits(1e-6), never)
    assert advice.choice is None and len(advice_lines(advice)) == 1


BALL = Scene("ball", icosphere(1), source="file", sha256="cd" * 32)


def stored(folder, device, variant="deferred:ray-space", scene=(), machine=(), **changed) -> None:
    """Append a made-up row of BALL on this machine, `scene` and `machine` over its facts."""
    row = accuracy_row("ball", variant, **changed)
    row["scene"] |= {"source": BALL.source, "sha256": BALL.sha256} | dict(scene)
    row["machine"] = machine_description(device).as_json() | dict(machine)
    row["id"] = hashlib.sha256(repr((variant, changed)).encode()).hexdigest()[:16]
    accuracy_file(folder).append(as_row(AccuracyRow, row))


def test_rows_come_from_the_folder_and_from_the_most_rays(tmp_path, device):
    stored(tmp_path, device, "embree")
    stored(tmp_path, device, "deferred:pbrt", rays=1000)
    assert [row.variant for row in find_rows(BALL, device, tmp_path)] == ["embree"]


@pytest.mark.parametrize("other", [{"sha256": "ef" * 32}, {"source": "stand-in"}, {"source": "real"}])
def test_rows_of_another_scene_of_the_same_name_are_left_alone(tmp_path, device, other):
    stored(tmp_path, device, scene=other)
    assert find_rows(BALL, device, tmp_path) == []


@pytest.mark.parametrize("other", [{"device": "other"}, {"platform": "other"}, {"cores": 999}, {"cpu": "other"}])
def test_rows_of_another_machine_are_left_alone(tmp_path, device, other):
    for variant in ("deferred:ray-space", "embree"):
        stored(tmp_path, device, variant, machine=other)
    found = [row.variant for row in find_rows(BALL, device, tmp_path)]
    same_cpu = not {"cpu", "cores"} & set(other)
    assert found == (["embree"] if same_cpu else []), "Embree's rate is the processor's, whatever device is opened"


def test_a_graphics_card_may_sit_beside_another_processor():
    row = row_of("deferred:ray-space", "ball")
    assert measured_here(row, row.machine.model_copy(update={"cpu": "another"}), on_cpu=False)
    assert not measured_here(row, row.machine.model_copy(update={"device": "another"}), on_cpu=False)


def test_a_variant_counts_once_with_the_most_aimed_rays_and_then_the_latest(tmp_path, device):
    stored(tmp_path, device, aimed=200_000, rate=0.29)
    stored(tmp_path, device, aimed=200_000, rate=0.30)
    stored(tmp_path, device, aimed=100_000, rate=0.31)
    (row,) = find_rows(BALL, device, tmp_path)
    assert row.aimed.rays == 200_000 and row.rate.median == pytest.approx(0.30e6, rel=0.01)


def test_an_unknown_device_is_refused_though_rows_are_on_file(tmp_path, device):
    stored(tmp_path, device)
    result = CliRunner().invoke(app, ["recommend", "teapot", "--from", str(tmp_path), "--device", "nope"])
    assert isinstance(result.exception, DefrayError) and "no OpenCL device matches 'nope'" in str(result.exception)


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(DefrayError, match=r"there is no folder .*nosuch; --from names one with accuracy\.jsonl"):
        module.recommend("teapot", Limits(), tmp_path / "nosuch", None, print)


@pytest.mark.parametrize("limits", [{"leaks": 0.0}, {"leaks": 2.0}, {"leaks": float("nan")}, {"t_error": -1.0}])
def test_limits_that_make_no_sense_are_refused(limits):
    with pytest.raises(DefrayError, match="must be above 0"):
        Limits(**limits)


def test_a_limit_that_takes_days_to_show_is_refused():
    with pytest.raises(DefrayError, match=r"3,000,000,00\d aimed rays"):
        module.recommend("sponza", Limits(1e-9), None, None, print)


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    triangles = icosphere(3)
    file = tmp_path_factory.mktemp("mesh") / "ball.npz"
    np.savez(file, vertices=triangles.reshape(-1, 3), faces=np.arange(3 * len(triangles)).reshape(-1, 3))
    return str(file)


def measured(mesh: str, device, *variants: str) -> list[AccuracyBody]:
    contenders = [Contender.parse(text) for text in variants]
    return list(measure_accuracy(Scenes(device).load(mesh), contenders, PLAN, device))


def test_more_rays_show_the_limit_of_a_watertight_variant_and_refute_another(mesh, device):
    good, bad = measured(mesh, device, "deferred:ray-space", "deferred:moller-trumbore")
    deeper = Deeper(mesh, Limits(1e-4), device, lambda _: None)
    assert deeper(good).aimed.as_json() | {"at_vertices": 0} == {
        "rays": 30_000,
        "leaks": 0,
        "at_vertices": 0,
        "vertex_leaks": 0,
        "seed": 1,
    }
    assert deeper(bad).aimed.leaks > 0


def test_a_scene_that_is_on_no_file_is_measured(mesh, device, monkeypatch, tmp_path):
    monkeypatch.setattr(module, "PLAN", PLAN)
    contenders = [Contender.parse(text) for text in ("deferred:ray-space", "deferred:moller-trumbore")]
    monkeypatch.setattr(module, "default_contenders", lambda _: contenders)
    command = ["recommend", mesh, "--max-leaks", "1e-3", "--from", str(tmp_path), "--device", device.title]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0
    assert "no rows of ball on" in result.output and "ball.npz: deferred:ray-space" in result.output
    shown = json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout)
    assert shown["choice"]["variant"] == "deferred:ray-space" and len(shown["notes"]) == 2


def test_nothing_accurate_enough_exits_with_1(mesh, device, tmp_path):
    stored(tmp_path, device, "embree", scene=scene_facts(load_scene(mesh)).as_json())
    result = CliRunner().invoke(app, ["recommend", mesh, "--from", str(tmp_path), "--device", device.title])
    assert result.exit_code == 1 and result.stdout == ""
    assert "ball.npz is shown to have leaks below 1e-06" in result.output
