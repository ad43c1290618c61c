"""The chosen grid: sampled work is the work counted, the fit finds the coefficients, the choice keeps its rules."""

from __future__ import annotations

import dataclasses
import sys

import numpy as np
import pytest
from shapes import icosphere, random_rays, soup

from harness import engine as pipeline
from harness import structures, tracers
from harness.campaign.plan import expand
from harness.data import Scene, differing
from harness.records.schema import GridFacts
from harness.spec import intersectors
from harness.spec.structure import AUTO, Adaptive, parse_structure
from harness.structures.adaptive import levels_of
from harness.studies import choice
from harness.tracers.prepared import Prepared
from harness.tuning import choose as auto
from harness.tuning import fit as calibrate
from harness.tuning.choose import Candidate, explain, pick, waves
from harness.tuning.cost_model import CostModel, TimedRun, fit
from harness.tuning.sampling import (
    CELLS_KEPT,
    Chances,
    RayWork,
    Sample,
    counted_work,
    padding,
    sample_rays,
    unused_slots,
    wave_ends,
)

TEST = intersectors.find("ray-space")
MESH = np.concatenate([icosphere(3, 0.5, (0.5, 0.5, 0.5)), soup(600, size=0.05)])
MODEL = CostModel(
    tracer="deferred",
    coefficients={"traverse": {"active": 30.0, "steps": 4.0, "cell_waves": 6.0},
                  "intersect": {"slots": 14.0, "lane_tests": 0.6}, "rest": {"one": 20.0}},
    exponents={"steps": 0.6, "pairs": 0.0, "tests": -1.5, "nonempty": 2.1, "references": 1.0},
    padding=0.7,
)  # fmt: skip


@pytest.fixture
def prepared(device):
    """A small scene with its grid."""
    made = Prepared.on_device(Scene("soup", MESH), device)
    return made.with_structure(Adaptive(auto.TRIAL))


def deferred(prepared, **options):
    return tracers.find("deferred")(prepared, TEST, {"arrange": "record", **options})


@pytest.mark.parametrize(("wave", "growth"), [(1, 1), (2, 1), (2, 2), (4, 1)])
def test_work_of_the_sample_is_what_the_tracer_counts(prepared, wave, growth):
    rays = random_rays(1500)
    tracer = deferred(prepared, wave=str(wave), growth=str(growth))
    counted = counted_work(tracer.count(rays), len(rays), prepared.structure.nonempty)
    work, per_wave = sample_rays(tracer, rays).deferred_work(wave, growth, len(rays))
    for name in ("pairs", "tests", "active", "steps"):
        assert getattr(work, name) == pytest.approx(getattr(counted, name), rel=0.04), name
    assert per_wave.sum() == pytest.approx(work.pairs) and len(per_wave) == round(counted.waves * len(rays))


def test_forward_work_of_the_sample_is_what_the_tracer_counts(prepared):
    rays = random_rays(500)
    tracer = tracers.find("forward")(prepared, TEST, {})
    counted, work = tracer.count(rays), sample_rays(tracer, rays).forward_work()
    assert [work.steps, work.pairs, work.tests] == [
        pytest.approx(value / 500) for value in (counted.steps, counted.pairs, counted.tests)
    ]


def test_predicted_size_is_the_size_that_is_built(prepared):
    for density in (auto.TRIAL / 4, auto.TRIAL, auto.TRIAL * 4):
        built = structures.build(prepared.device_scene, Adaptive(density))
        finer, _, size = auto._size(MODEL, prepared.structure, density, len(MESH))
        assert finer == pytest.approx(calibrate.per_axis(built) / calibrate.per_axis(prepared.structure))
        assert size == pytest.approx(built.bytes, rel=0.25)
    assert (8 ** levels_of(prepared.structure.top_counts, auto.TRIAL, 4)).sum() == prepared.structure.leaf_cells


def test_waves_end_where_they_should():
    assert list(wave_ends(4, 1, 9)) == [4, 8, 12] and list(wave_ends(2, 2, 9)) == [2, 6, 14]


def test_padding_of_one_pair_a_bin_and_of_full_bins():
    assert padding(np.array([1.0]), 1e6, 8) == pytest.approx(7.0, rel=1e-3)
    assert padding(np.array([1e6]), 100, 8) == pytest.approx(350.0, rel=1e-3)
    assert padding(np.array([1e6]), 100, 1) == 0.0


@pytest.mark.parametrize("spread", [0.0, 1.0, 2.0])
def test_spread_of_chances_and_padding_are_found_from_a_sample(spread):
    generator, cells, lanes = np.random.default_rng(7), 20_000, 8
    chances = np.exp(spread * generator.standard_normal(cells))
    met = generator.choice(cells, (2048, CELLS_KEPT), p=chances / chances.sum())
    full = np.full(2048, CELLS_KEPT)
    found = Sample(met, met, met, full, full, full, full, full).chances(cells)
    assert found.spread == pytest.approx(spread, abs=0.2) and found.part > 0.8
    binned = np.bincount(generator.choice(cells, 300_000, p=chances / chances.sum()), minlength=cells)
    unused = padding(np.array([300_000.0]), found.part * cells, lanes, found.spread)
    assert unused == pytest.approx((-binned % lanes).sum(), rel=0.15)


def test_cells_that_no_ray_meets_are_told_from_those_that_few_meet():
    """One cell in ten can be met, all of them alike: cells met often are missing, which a wide spread would have."""
    generator, cells = np.random.default_rng(7), 200_000
    met = generator.choice(cells // 10, (512, CELLS_KEPT))
    full = np.full(512, CELLS_KEPT)
    found = Sample(met, met, met, full, full, full, full, full).chances(cells)
    assert 0.1 < found.part < 0.4 and found.spread < 1.3


def made_up_runs(model: CostModel, seed: int = 4) -> list[TimedRun]:
    """Runs that take exactly what the model says, and whose counts follow its exponents."""
    generator, runs = np.random.default_rng(seed), []
    for scene in ("a", "b"):
        first = RayWork(*generator.uniform(1, 10, 11))
        for finer in (1.0, 2.0, 3.0):
            drawn = generator.uniform(1, 10, 3)
            work = dataclasses.replace(
                model.scaled(first, finer),
                active=drawn[0],
                cell_waves=drawn[1],
                slots=drawn[2],
                lane_tests=generator.uniform(10, 90),
            )
            parts = {
                stage: sum(value * getattr(work, term) for term, value in terms.items())
                for stage, terms in model.coefficients.items()
            }
            seconds = {stage: 1e-3 * value for stage, value in parts.items() if stage != "rest"}
            seconds["total"] = 1e-3 * sum(parts.values())
            numbers = [round(1e6 * finer ** model.exponents[name]) for name in ("nonempty", "references")]
            runs.append(TimedRun("deferred", scene, 1_000_000, seconds, work, finer, *numbers))
    return runs


def test_fit_finds_the_coefficients_and_exponents_that_made_the_runs():
    found = fit("deferred", made_up_runs(MODEL))
    for stage, terms in MODEL.coefficients.items():
        assert {term: found.coefficients[stage][term] for term in terms} == pytest.approx(terms, rel=1e-4)
    assert found.coefficients["compact"] == {"active": 0.0, "waves": 0.0}
    assert found.exponents == pytest.approx(MODEL.exponents, abs=1e-4)
    for run in made_up_runs(MODEL, seed=5):  # runs that nothing was fitted to
        assert found.nanoseconds(run.work) == pytest.approx(1e9 * run.seconds["total"] / run.rays, rel=1e-4)


def candidate(**fields) -> Candidate:
    return Candidate(
        **{
            "tracer": "deferred",
            "density": 0.3,
            "wave": 4,
            "growth": 1,
            "batch": 1 << 20,
            "nanoseconds": 100.0,
            "bytes": 1e6,
            **fields,
        }
    )


def test_the_smallest_of_those_near_the_best_is_taken_and_said_so():
    best, small, slow = (
        candidate(),
        candidate(density=0.1, nanoseconds=104.0, bytes=5e5),
        candidate(density=0.05, nanoseconds=106.0, bytes=1e5),
    )
    made = [best, small, slow]
    assert pick(made) is small
    assert "density 0.1" in explain(small, {"deferred": made}) and "4.0% faster" in explain(small, {"deferred": made})
    assert "best of 3" in explain(best, {"deferred": made}) and "\n" not in explain(small, {"deferred": made})
    assert pick([best, slow]) is best


def test_options_that_are_given_are_kept():
    assert waves({"wave": "5"}) == [(5, 1)] and waves({"wave": "4"}) == [(4, 1), (4, 2)]
    assert {growth for _, growth in waves({"growth": "2"})} == {2}
    assert auto.batches(10**6, {}) == [1 << 20] and auto.batches(3 * 10**6, {}) == [1 << 20, 1 << 22]
    assert auto.batches(3 * 10**6, {"batch": "4096"}) == [4096]
    choice = auto.Choice(None, {"deferred": candidate(wave=8, growth=2).options}, "", 0.0, 0.0)
    assert choice.options_for("deferred", {"wave": "3"})["wave"] == "3"
    assert "growth" not in choice.options_for("deferred", {"wave": "3"})
    assert choice.options_for("forward", {"lanes": "4"}) == {"lanes": "4"}


def test_choosing_takes_the_models_best(prepared, monkeypatch):
    monkeypatch.setattr(auto, "FEW_RAYS", 100)
    rays = random_rays(3000)
    for term, value, finest in (("lane_tests", 1e4, True), ("steps", 1e4, False)):
        model = MODEL.model_copy(update={"coefficients": {"rest": {term: value}}})
        monkeypatch.setattr(auto, "cost_models", lambda *_, model=model: {"deferred": model})
        choice = auto.choose(prepared, rays, "deferred", TEST)
        best = min(choice.candidates, key=lambda c: c.nanoseconds)
        assert best.density == (auto.DENSITIES[-1] if finest else auto.DENSITIES[0])
        assert choice.grid.spec.density == pick(list(choice.candidates)).density
        assert choice.seconds > 0 and str(choice.grid.spec.density) in choice.why
        facts = GridFacts(**choice.grid.describe(), **choice.describe()).model_dump()
        assert facts["chosen"] == choice.why and facts["density"] == choice.grid.density


def test_a_stream_is_chosen_for_by_its_own_model_and_told_which_tracer_is_faster(prepared, monkeypatch):
    monkeypatch.setattr(auto, "FEW_RAYS", 100)
    rays = random_rays(3000)
    for cost, than in ((1e3, "faster"), (1e6, "slower")):
        models = {
            "streamed": MODEL.model_copy(update={"tracer": "streamed", "coefficients": {"rest": {"slots": 1e4}}}),
            "deferred": MODEL.model_copy(update={"coefficients": {"rest": {"steps": cost}}}),
        }
        monkeypatch.setattr(auto, "cost_models", lambda *_, models=models: models)
        choice = auto.choose(prepared, rays, "streamed", TEST)
        assert f"; deferred, with density {auto.DENSITIES[0]}" in choice.why and f"predicted {than}" in choice.why
        assert "arrange" not in choice.options_for("streamed", {}) and "batch" in choice.options_for("streamed", {})
        assert choice.options_for("deferred", {})["arrange"] == "record"


def test_streams_with_bins_of_their_own_leave_more_slots_unused(prepared):
    made = [tracers.find("streamed")(prepared, TEST, {"streams": str(streams), "lanes": "8"}) for streams in (1, 2)]
    one, two = (unused_slots(tracer, 100, np.array([0.5]), 1000, Chances(1.0, 1.0)) for tracer in made)
    assert one < two < 2 * one


@pytest.mark.parametrize("few", [100, auto.FEW_RAYS])
def test_a_trace_on_a_chosen_grid_has_the_hits_of_any_other(device, monkeypatch, few):
    monkeypatch.setattr(auto, "FEW_RAYS", few)
    monkeypatch.setattr(auto, "cost_models", lambda *_: {"deferred": MODEL})
    scene, rays = Scene("soup", MESH), random_rays(2000)
    chosen = pipeline.trace(scene, rays, device=device)
    assert differing(chosen, pipeline.trace(scene, rays, structure="8/32", device=device)) == 0


def test_the_model_is_kept_on_file_and_another_state_of_the_kernels_is_another_file(device, tmp_path, monkeypatch):
    monkeypatch.setenv("DEFRAY_CACHE", str(tmp_path))
    monkeypatch.setattr(calibrate, "_fitting_scenes", lambda _: ())
    monkeypatch.setattr(calibrate, "measured_runs", lambda *_: both)
    heard, runs = [], made_up_runs(MODEL)
    both = [*runs, *(dataclasses.replace(run, tracer="streamed") for run in runs)]
    first = calibrate.cost_models(device, "deferred", TEST, heard.append)
    assert calibrate.cost_models(device, "deferred", TEST, heard.append) == first and len(heard) == 1
    file = calibrate.model_file(device, "deferred", TEST)
    file.write_text("{torn")
    assert calibrate.cost_models(device, "deferred", TEST, heard.append) == first and len(heard) == 2
    monkeypatch.setattr(calibrate, "kernels_digest", lambda: "another")
    assert calibrate.model_file(device, "deferred", TEST) != file


@pytest.mark.slow
def test_fitting_to_a_device_predicts_its_own_runs(device):
    runs = calibrate.measured_runs(device, ("deferred",), TEST, calibrate._fitting_scenes(1 << 17))
    model = fit("deferred", runs)
    ratios = [model.nanoseconds(run.work) * 1e-9 * run.rays / run.seconds["total"] for run in runs]
    assert np.median(np.abs(np.log(ratios))) < 0.3
    assert model.exponents["tests"] < 0 < model.exponents["nonempty"]


def test_auto_is_read_from_text_and_from_sweeps(tmp_path):
    assert parse_structure("auto") == AUTO and str(AUTO) == "auto"
    file = tmp_path / "sweep.toml"
    file.write_text(
        '[[tiers.one.sweeps]]\nname = "a"\nscenes = "sponza"\ngrids = ["auto", "8/64"]\nvariants = ["deferred"]\n'
    )
    assert [str(spec.structure) for spec in expand(file, "one")] == ["auto", "8/64 total"]


def test_a_validation_with_too_few_rays_to_choose_for_is_one_line(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["choice", "sponza", "--rays", "10k"])
    assert choice.main() == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err == "error: --rays 10k: of fewer than 65,536 nothing is chosen\n"
