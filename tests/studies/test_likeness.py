"""Calibration of the stand-ins: the figures by hand on small meshes, and checks that can fail."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from harness import structures
from harness.commands.main import app
from harness.data import Rays, Scene, View
from harness.errors import DefrayError
from harness.spec.intersectors import find
from harness.spec.structure import Uniform
from harness.studies.stand_ins import footprint as cost
from harness.studies.stand_ins import likeness as calibration
from harness.studies.stand_ins.likeness import (
    Calibration,
    ComparedFigure,
    calibrate,
    cell_figures,
    compare,
    measure,
    stored_figures,
)
from harness.tracers.deferred.tracer import Deferred
from harness.tracers.prepared import Prepared
from scenes import recipes

FAR_CORNERS = [[[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[8, 8, 8], [7.9, 8, 8], [8, 7.9, 8]]]


def test_cells_are_counted_as_by_hand():
    # Four cells hold 1, 1, 2 and 6 references.
    figures = cell_figures(np.array([0, 1, 2, 4, 10]), triangles=5, cells=64)
    assert figures == {
        "non-empty cells, share": 4 / 64,
        "references a triangle": 2.0,
        "triangles a cell, mean": 2.5,
        "triangles a cell, 95 %": pytest.approx(2 + 0.85 * 4),
        "triangles a cell, 99 %": pytest.approx(2 + 0.97 * 4),
    }


def test_a_rays_cells_are_those_up_to_its_limit(device):
    # Two triangles in opposite corners of an 8^3 grid with cells a little over 1 wide.
    scene = Scene("corners", np.array(FAR_CORNERS, np.float32))
    prepared = Prepared.on_device(scene, device)
    grid = structures.build(prepared.device_scene, Uniform(8, 8))
    tracer = Deferred(Prepared(scene, device, prepared.device_scene, grid), find("ray-space"), {})
    origin, along = np.array([[0.5, 0.5, 0.5]], np.float32), np.array([[1, 0, 0]], np.float32)

    def walked(limit: float) -> tuple[int, int]:
        counted = tracer.walk_counts(Rays(origin, along, np.array([limit], np.float32)))
        return counted.steps, counted.pairs

    assert walked(np.inf) == (8, 1)
    assert walked(0.2) == (1, 1)
    assert walked(2.1) == (3, 1)


def test_a_scene_of_one_wall_is_measured_as_by_hand(device):
    wall = np.array([[[0, 0, 0], [8, 0, 0], [0, 8, 0]], [[8, 8, 0], [0, 8, 0], [8, 0, 0]]], np.float32)
    scene = Scene("wall", wall, (View((4, 4, 8), (4, 4, 0), fov_degrees=30.0),))
    figures = measure(scene, device, rays=512)
    assert figures["triangles"] == 2
    assert figures["rays that hit, share"] == 0
    for resolution in calibration.RESOLUTIONS:
        share = figures[f"{resolution}: non-empty cells, share"]
        # The wall is flat, so that its one layer of cells (two where it lies on a plane between them) is all.
        assert 0.9 / resolution < share <= 2 / resolution
        mean = figures[f"{resolution}: triangles a cell, mean"]
        assert figures[f"{resolution}: references a triangle"] == pytest.approx(mean * share * resolution**3 / 2)
        assert 1 <= mean < 1.2
        assert figures[f"{resolution}: cells a ray, all"] >= figures[f"{resolution}: cells a ray, non-empty"] > 0


def test_an_altered_figure_fails_the_check():
    real = {"triangles": 1000.0, "a": 2.0, "b": 5.0}
    assert Calibration("x", "stored", compare(real, dict(real))).inside
    for name, value in (("a", 4.1), ("a", 0.9), ("b", math.nan), ("b", 0.0), ("triangles", 1060.0)):
        result = Calibration("x", "stored", compare(real, {**real, name: value}))
        assert not result.inside
        assert [f.name for f in result.figures if not f.inside] == [name]
    assert ComparedFigure("a", 0.0, 0.0).inside and not ComparedFigure("a", 0.0, 1.0).inside
    assert not ComparedFigure("a", 1.0, math.inf).inside
    with pytest.raises(DefrayError, match="only one of real scene and stand-in: b"):
        compare(real, {"triangles": 1.0, "a": 1.0})


def test_every_stand_in_has_stored_figures_of_its_own_files(tmp_path):
    for name in calibration.calibrated_names():
        figures = stored_figures(recipes()[name])
        assert figures["triangles"] == recipes()[name].triangles
        assert len(figures) == 2 + 7 * len(calibration.RESOLUTIONS)
    text = calibration.STORED.read_text(encoding="utf-8")
    other = tmp_path / "other.toml"
    other.write_text(text.replace("edc6ab86", "00000000"), encoding="utf-8")
    with pytest.raises(DefrayError, match="measured of other files"):
        stored_figures(recipes()["sponza"], other)


@pytest.fixture
def quick(monkeypatch):
    """Two scenes' figures without measuring: one stand-in as it should be, one not."""

    def fake(names, device, progress=None):
        figures = {"triangles": 10.0, "x": 1.0}
        return [
            Calibration(n, "stored", compare(figures, {**figures, "x": 1.5 if n == "sponza" else 2.5})) for n in names
        ]

    monkeypatch.setattr("harness.commands.scenes.calibrate", fake)


def run(capsys, *arguments: str) -> tuple[int, str]:
    """Exit code and standard output of `defray scenes`."""
    with pytest.raises(SystemExit) as stopped:
        app(["scenes", *arguments], prog_name="defray")
    return stopped.value.code, capsys.readouterr().out


def test_the_command_prints_every_ratio_and_fails_where_one_is_outside(quick, capsys):
    code, out = run(capsys, "--calibration", "--only", "sponza", "--json")
    result = json.loads(out)
    assert code == 0 and result[0]["inside"] and result[0]["scene"] == "sponza"
    assert result[0]["figures"][1] == {"name": "x", "real": 1.0, "stand_in": 1.5, "ratio": 1.5, "inside": True}
    code, out = run(capsys, "--calibration", "--only", "sponza,crown")
    assert code == 1
    assert out.count("outside") == 1 and "2.50" in out and "1.50" in out


def test_an_unknown_scene_is_named():
    with pytest.raises(DefrayError, match="unknown scene with a stand-in 'bunny'"):
        calibration.calibrated_names("sponza,bunny")


def test_costs_are_of_a_process_of_their_own():
    result = cost.measure_footprint("sponza", "generate")
    assert result.triangles > 250_000 and min(result.seconds, result.cpu_seconds) > 0
    assert 2**24 < result.peak_bytes < 2**31 and result.inside
    assert not cost.Footprint("x", "build", 1, 1.0, 1.0, 13 * 2**30).inside
    with pytest.raises(DefrayError, match="unknown step 'fly'"):
        cost.measure_footprint("sponza", "fly")


@pytest.mark.slow
@pytest.mark.parametrize("name", calibration.calibrated_names())
def test_a_stand_in_behaves_like_the_real_scene(name, device):
    (result,) = calibrate([name], device)
    assert not [(f.name, f.ratio) for f in result.figures if not f.inside]
