"""Accuracy of whole tracers: errors stand beside every rate, and what goes wrong is counted."""

from __future__ import annotations

import json

import made_up_accuracy
import numpy as np
import pytest
from shapes import icosphere
from typer.testing import CliRunner

from harness.campaign.executors import Local
from harness.campaign.runner import Ledger, run
from harness.campaign.tasks import AccuracyScene, accuracy_scenes, accuracy_tasks, precision_tasks
from harness.commands.main import app
from harness.data import Hits, Rays, Scene, View
from harness.device.machine import machine_description
from harness.errors import DefrayError
from harness.measure.group import scene_facts
from harness.measure.scene import SharedScene
from harness.records.accuracy_row import AccuracyRow, accuracy_file
from harness.records.digest import sealed, unsealed
from harness.records.origin import finish, latest_rows
from harness.records.precision_row import PrecisionBody, precision_file
from harness.records.schema import checked
from harness.reference.errors_of_t import distance_rmse, residual_p99
from harness.spec.structure import Uniform
from harness.studies import errors_and_leaks as accuracy
from harness.studies.errors_and_leaks import (
    AccuracyStudy,
    Contender,
    Plan,
    default_contenders,
    measure_accuracy,
    parse_contenders,
)
from harness.studies.needed_precision import SAMPLES

PLAN = Plan(rays=2_000, aimed=4_000, repetitions=2, structure=Uniform(4, 16))
VARIANTS = ("deferred:ray-space", "deferred:moller-trumbore", "embree", "embree:robust=false")


def measured(device, texts=VARIANTS, plan=PLAN) -> dict[str, AccuracyRow]:
    """Whole rows of a sphere seen from inside, by variant."""
    triangles = icosphere(3)
    scene = Scene("ball", triangles, (View((0.1, 0.05, -0.08), (1, 0.2, 0.3)),), sha256="0" * 64)
    bodies = measure_accuracy(SharedScene(scene, device), [Contender.parse(text) for text in texts], plan, device)
    machine = machine_description(device)
    return {body.variant: finish(AccuracyRow, body, machine, id="feed") for body in bodies}


@pytest.fixture(scope="module")
def rows(device):
    return measured(device)


@pytest.fixture
def row(rows):
    """A row as JSON has it."""
    return json.loads(json.dumps(rows["deferred:ray-space"].as_json()))


def test_leaks_separate_methods_and_rates_are_kept(rows):
    assert list(rows) == list(VARIANTS)
    assert rows["deferred:ray-space"].aimed.leaks == 0
    assert rows["deferred:moller-trumbore"].aimed.leaks > 50
    for row in rows.values():
        assert 0 < row.rate.low <= row.rate.median <= row.rate.high
        assert row.aimed.rays == 4_000 and len(row.seconds) == 2
        assert row.t_error.p99 < 1e-5 and row.distance_rmse < 1e-5 and row.residual_p99_ulp < 64
    assert rows["embree"].grid is None and rows["embree"].contraction is None
    assert rows["deferred:ray-space"].contraction == "off"
    assert rows["deferred:ray-space"].overlap == "padded"


def lossy(monkeypatch, change) -> None:
    """Let `change(hits)` damage the hits of every repetition and of every aimed ray."""
    trace = accuracy.AccuracyGroup.trace

    def damaged(self, entry, rays):
        hits, seconds = trace(self, entry, rays)
        change(hits)
        return hits, seconds

    monkeypatch.setattr(accuracy.AccuracyGroup, "trace", damaged)


def test_dropped_hits_are_leaks_and_disagree(device, monkeypatch):
    def drop(hits: Hits) -> None:
        hits.t[::100], hits.primitive[::100] = np.inf, -1

    lossy(monkeypatch, drop)
    row = measured(device, ["deferred:ray-space"])["deferred:ray-space"]
    assert row.aimed.leaks == 40 and row.agreement.missed == 20
    assert not row.valid and row.distance_rmse > 1e-2


def test_a_t_that_is_no_number_is_a_leak_and_counted(device, monkeypatch):
    def spoil(hits: Hits) -> None:
        hits.t[::200] = np.nan

    lossy(monkeypatch, spoil)
    row = measured(device, ["deferred:ray-space"])["deferred:ray-space"]
    assert row.aimed.leaks == 20 and row.agreement.nonfinite == 10


def test_an_inaccurate_t_is_measured(device, monkeypatch):
    def shift(hits: Hits) -> None:
        hits.t[:] *= np.float32(1 + 1e-4)

    lossy(monkeypatch, shift)
    row = measured(device, ["deferred:ray-space"])["deferred:ray-space"]
    assert row.t_error.p50 == pytest.approx(1e-4, rel=0.02)
    assert row.residual_p99_ulp > 100 and row.distance_rmse > 1e-6


def test_a_variant_that_leaks_enough_is_given_no_more_rays(device, monkeypatch):
    monkeypatch.setattr(accuracy, "AIMED_BLOCK", 500)
    monkeypatch.setattr(accuracy, "ENOUGH_LEAKS", 40)
    rows = measured(device, VARIANTS[:2])
    assert rows["deferred:ray-space"].aimed.rays == 4_000
    leaky = rows["deferred:moller-trumbore"].aimed
    assert leaky.rays < 4_000 and leaky.leaks >= 40


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"surprise": 1}, "surprise: unknown key"),
        ({"schema": 99}, "schema 99"),
        ({"rate": None}, "rate"),
        ({"aimed": None}, "aimed"),
        ({"seconds": []}, "seconds"),
        ({"residual_p99_ulp": float("nan")}, "residual_p99_ulp"),
        ({"aimed": {"leaks": 4_001}}, "more leaks than rays"),
        ({"aimed": {"rays": 0}}, "aimed.rays"),
    ],
)
def test_a_bad_row_is_refused_in_one_line(row, change, what):
    if change.get("aimed"):
        change = {"aimed": row["aimed"] | change["aimed"]}
    with pytest.raises(DefrayError, match=what) as caught:
        checked(AccuracyRow, row | change, "accuracy.jsonl, line 3")
    assert "line 3" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("part", ["t_error", "agreement", "aimed", "distance_rmse"])
def test_a_rate_without_errors_is_impossible(row, part):
    del row[part]
    with pytest.raises(DefrayError, match=f"{part}: missing key"):
        checked(AccuracyRow, row, "row")


def test_hits_that_nobody_checked_have_no_row(row):
    row["agreement"]["reference"] = "none"
    with pytest.raises(DefrayError, match="compared with a reference"):
        checked(AccuracyRow, row, "row")
    row["agreement"] |= {"reference": "embree", "missed": 1}
    with pytest.raises(DefrayError, match="add up"):
        checked(AccuracyRow, row, "row")


def test_a_corrupted_line_is_named(tmp_path, row):
    file = accuracy_file(tmp_path)
    file.append(checked(AccuracyRow, row, "row"))
    text = file.path.read_text()
    file.path.write_text(text + text.replace('"leaks"', '"laeks"') + text)
    with pytest.raises(DefrayError, match=r"line 2 .*edited after it was written"):
        accuracy_file(tmp_path).read()


def test_the_last_row_of_a_measurement_counts(row):
    first, again = (checked(AccuracyRow, row | {"distance_rmse": error}, "row") for error in (0.1, 0.5))
    assert latest_rows([first, again]) == [again]


def run_accuracy(scene: AccuracyScene, out, device, resume=True):
    """`defray accuracy` of one scene, by an executor that has kept nothing from another time."""
    executor = Local(device)
    found = run(accuracy_tasks([scene], device), executor, out, resume)
    more = precision_tasks([scene])
    return run(more, executor, out, True) if more and not found.code else found


def test_a_second_run_needs_resume_and_measures_nothing_again(tmp_path, device, monkeypatch):
    contenders = [Contender.parse("deferred:ray-space")]
    scene = AccuracyScene(save_mesh(tmp_path / "ball.npz", icosphere(2)), PLAN, contenders)
    first = run_accuracy(scene, tmp_path, device, resume=False).rows
    assert len(first) == 1
    with pytest.raises(DefrayError, match="--resume"):
        run_accuracy(scene, tmp_path, device, resume=False)
    with monkeypatch.context() as patch:
        patch.setattr(accuracy.AccuracyGroup, "trace", None)
        again = run_accuracy(scene, tmp_path, device).rows
    assert again == first
    file = accuracy_file(tmp_path).path
    rows = [unsealed(json.loads(line), "") for line in file.read_text().splitlines()]
    moved = [row | {"machine": row["machine"] | {"device": "another"}} for row in rows]
    file.write_text("".join(json.dumps(sealed(row)) + "\n" for row in moved))
    run_accuracy(scene, tmp_path, device)  # rows of another device do not stand for this one's
    assert [row.machine.device for row in accuracy_file(tmp_path).read()] == ["another", device.name]


def save_mesh(path, triangles) -> str:
    np.savez(path, vertices=triangles.reshape(-1, 3), faces=np.arange(3 * len(triangles)).reshape(-1, 3))
    return str(path)


@pytest.mark.parametrize("precision", [False, True])
def test_resuming_measures_a_mesh_again_that_has_changed(tmp_path, device, precision, monkeypatch):
    mesh = save_mesh(tmp_path / "ball.npz", icosphere(2))
    if precision:  # of which a made-up row is enough
        monkeypatch.setattr(
            "harness.studies.needed_precision.measure_precision", lambda shared, *_: [precision_of(shared.scene)]
        )
    scene = AccuracyScene(mesh, PLAN, [Contender.parse("embree")], precision)
    run_accuracy(scene, tmp_path, device)
    save_mesh(tmp_path / "ball.npz", icosphere(2) * np.float32(1.5))
    for _ in range(2):  # the second time both are on file
        found = run_accuracy(scene, tmp_path, device).rows
    file = precision_file(tmp_path) if precision else accuracy_file(tmp_path)
    hashes = [row.scene.sha256 for row in file.read()]
    assert len(hashes) == len(set(hashes)) == 2
    assert [row.scene.sha256 for row in found] == hashes[1:]


def precision_of(scene: Scene, samples: int = SAMPLES[-1]) -> PrecisionBody:
    row = made_up_accuracy.precision_row("ball", "samples", str(samples), 0.3, 0.1)
    measured = {key: value for key, value in row.items() if key in PrecisionBody.model_fields}
    return PrecisionBody.model_validate(measured | {"scene": scene_facts(scene)})


def test_precision_that_was_stopped_between_its_rows_is_measured_again(tmp_path, device, monkeypatch):
    mesh = save_mesh(tmp_path / "ball.npz", icosphere(2))
    scene = AccuracyScene(mesh, PLAN, [Contender.parse("embree")], True)
    started = []

    def stopped_once(shared, *_):
        started.append(1)
        yield precision_of(shared.scene, SAMPLES[0])
        if len(started) == 1:
            raise KeyboardInterrupt
        yield precision_of(shared.scene, SAMPLES[-1])

    monkeypatch.setattr("harness.studies.needed_precision.measure_precision", stopped_once)
    assert run_accuracy(scene, tmp_path, device).code == 130
    for _ in range(2):  # the second time all are on file
        assert run_accuracy(scene, tmp_path, device).code == 0
    assert len(started) == 2
    assert [row.value for row in precision_file(tmp_path).read()] == ["1", "1", "64"]


def test_rows_of_a_stand_in_do_not_stand_for_the_real_scene(row):
    stand_in = row | {"scene": row["scene"] | {"source": "stand-in"}}
    (task,) = AccuracyStudy().tasks("ball", [Contender.parse("deferred:ray-space")], PLAN)
    (part,) = task.parts
    rows = [checked(AccuracyRow, one | {"id": part.id}, "row") for one in (row, stand_in)]
    here = row["machine"]["device"]
    for last in rows:
        ledger = Ledger(task.study, rows, here)
        ledger.note(last, "ball")
        assert ledger.row_of(task, part) == last
    elsewhere = Ledger(task.study, rows, "another")
    elsewhere.note(rows[0], "ball")
    assert elsewhere.missing(task) == [part]


def test_what_is_whole_is_stored_before_an_interruption(tmp_path, device, monkeypatch):
    contenders = [Contender.parse(text) for text in ("embree", "embree:robust=false")]
    scene = AccuracyScene(save_mesh(tmp_path / "ball.npz", icosphere(2)), PLAN, contenders)
    leaks_of = accuracy.AccuracyGroup.leaks_of

    def interrupted(self, entry, aimed):
        if entry.contender == contenders[1]:
            raise KeyboardInterrupt
        return leaks_of(self, entry, aimed)

    with monkeypatch.context() as patch:
        patch.setattr(accuracy.AccuracyGroup, "leaks_of", interrupted)
        assert run_accuracy(scene, tmp_path, device).code == 130
    assert [row.variant for row in accuracy_file(tmp_path).read()] == ["embree"]
    assert [row.variant for row in run_accuracy(scene, tmp_path, device).rows] == ["embree", "embree:robust=false"]


def test_a_variant_that_fails_costs_no_other_its_row(tmp_path, device, monkeypatch):
    contenders = [Contender.parse(text) for text in ("embree", "deferred:ray-space", "embree:robust=false")]
    scene = AccuracyScene(save_mesh(tmp_path / "ball.npz", icosphere(2)), PLAN, contenders)
    honest = accuracy.AccuracyGroup.trace

    def breaks(self, entry, rays):
        if entry.contender == contenders[1]:
            raise RuntimeError("out of\nresources")
        return honest(self, entry, rays)

    with monkeypatch.context() as patch:
        patch.setattr(accuracy.AccuracyGroup, "trace", breaks)
        found = run_accuracy(scene, tmp_path, device)
    assert found.code == 1 and [row.variant for row in found.rows] == ["embree", "embree:robust=false"]
    (error,) = [json.loads(line) for line in (tmp_path / "errors.jsonl").read_text().splitlines()]
    assert error["study"] == "accuracy" and error["run"].endswith("deferred:ray-space")
    assert error["error"] == "RuntimeError: out of resources"
    assert len(run_accuracy(scene, tmp_path, device).rows) == 3


def test_a_variant_written_in_two_ways_is_measured_once():
    found = parse_contenders("deferred, deferred:ray-space ,embree,deferred:ray-space:binning=padded")
    assert [str(one) for one in found] == ["deferred:ray-space", "embree"]


def test_default_variants_pair_contractions_and_hold_both_references(device):
    names = [str(one) for one in default_contenders(device)]
    assert len(set(names)) == len(names)
    deferred = [name for name in names if name.startswith("deferred") and "binning" not in name]
    assert {name + ":contraction=on" for name in deferred if "=on" not in name} == {n for n in deferred if "=on" in n}
    assert {"embree", "embree:robust=false"} <= set(names)


def test_variants_are_written_one_way_and_bad_ones_refused():
    assert str(Contender.parse("deferred:ray-space:contraction=off:binning=padded")) == "deferred:ray-space"
    assert (
        str(Contender.parse("forward:ray-space:binning=open:exit=reject"))
        == "forward:ray-space:binning=open:exit=reject"
    )
    assert Contender.parse("deferred:overlap=open") == Contender.parse("deferred:binning=open")
    wrong = {
        "embree:overlap=open": "walks no structure",
        "embree:binning=open": "walks no structure",
        "deferred:overlap=odd": "unknown overlap test 'odd'",
        "deferred:overlap=open:binning=box": "twice",
        "walk": "tracer",
    }
    for text, what in wrong.items():
        with pytest.raises(DefrayError, match=what):
            Contender.parse(text)


def test_distances_end_at_the_diagonal():
    rays = Rays(np.zeros((4, 3), np.float32), np.full((4, 3), [2, 0, 0], np.float32), np.full(4, np.inf, np.float32))
    truth = np.array([1.0, 1.0, np.inf, 1.0])
    assert distance_rmse(rays, np.array([1, 1, np.inf, 1], np.float32), truth, 10.0) == 0
    missed = distance_rmse(rays, np.array([1, np.inf, np.inf, 1], np.float32), truth, 10.0)
    assert missed == pytest.approx(np.sqrt(8**2 / 4) / 10)
    assert distance_rmse(rays, np.array([1, np.nan, np.inf, 1], np.float32), truth, 10.0) == missed
    assert distance_rmse(rays, np.array([1, -1, np.inf, 1], np.float32), truth, 10.0) == missed


def test_residual_without_a_hit_is_none():
    hits = Hits(*(np.full(3, value, kind) for value, kind in ((np.inf, "f4"), (-1, "i4"), (0, "f4"), (0, "f4"))))
    rays = Rays(np.zeros((3, 3), np.float32), np.ones((3, 3), np.float32), np.full(3, np.inf, np.float32))
    assert residual_p99(icosphere(1), rays, hits) is None


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("accuracy", "name a scene or a tier"),
        ("accuracy sponza --rays=", "'' is not a count"),
        ("accuracy sponza --variants=", "'' names no variant"),
        ("accuracy sponza --variants ,", "',' names no variant"),
        ("accuracy --tier huge", "unknown tier 'huge'"),
        ("accuracy nowhere", "unknown scene 'nowhere'"),
        ("accuracy sponza --rays none", "'none' is not a count"),
        ("accuracy sponza --variants walk:ray-space", "unknown tracer 'walk'"),
        ("recommend nowhere", "unknown scene 'nowhere'"),
        ("recommend sponza --max-leaks 0", "must be above 0"),
    ],
)
def test_each_mistake_is_one_line(command, message):
    result = CliRunner().invoke(app, command.split())
    assert isinstance(result.exception, DefrayError) and message in str(result.exception)


@pytest.mark.parametrize("tier", ["smoke", "paper", "full"])
def test_tiers_name_scenes_and_counts(tier):
    parts = accuracy_scenes([], tier, None, None, None)
    assert parts and all(part.plan.aimed >= 16_000 and part.plan.repetitions >= 2 for part in parts)
    only = accuracy_scenes(["sponza"], tier, "1k", None, 4)
    assert [(part.scene, part.plan.rays, part.plan.repetitions) for part in only] == [("sponza", 1000, 4)]
