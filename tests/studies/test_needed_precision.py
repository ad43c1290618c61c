"""What half precision, resolution and rays a pixel cost: errors that are known beforehand are found."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_accuracy import DEVICE, as_row, precision_row, precision_rows
from shapes import icosphere

from harness.analysis.results import Results, read_published
from harness.data import Scene, View
from harness.device.machine import machine_description
from harness.errors import DefrayError
from harness.measure.scene import SharedScene
from harness.records.origin import finish
from harness.records.precision_row import PrecisionRow
from harness.report.figures import enough_precision, style
from harness.studies import needed_precision as module


def test_half_precision_rounds_within_the_box():
    triangles = icosphere(3, radius=50.0, centre=(1e4, 0, -7))
    rounded = module.half_precision(triangles)
    error = np.abs(rounded.astype(np.float64) - triangles).max()
    assert rounded.dtype == np.float32 and 0 < error <= 100 * 2.0**-12 + 1e-3
    again = module.half_precision(rounded)
    assert np.abs(again.astype(np.float64) - rounded).max() <= 2e-3  # of float32 at 10,000


def test_rmse_of_hand_made_images():
    assert module.rmse(np.array([0.0, 1.0]), np.array([0.0, 0.0])) == pytest.approx(0.5**0.5)


@pytest.fixture(scope="module")
def rows(device):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "RESOLUTIONS", (16, 32))
        patch.setattr(module, "USUAL", 32)
        patch.setattr(module, "IMAGE", (16, 12))
        patch.setattr(module, "MANY", 64)
        inner, outer = icosphere(2, radius=0.4, centre=(0.3, 0.1, 0.2)), icosphere(3)
        scene = Scene("balls", np.concatenate([inner, outer]), (View((-0.6, 0.1, -0.2), (0.3, 0.1, 0.2)),), "file")
        found = list(module.measure_precision(SharedScene(scene, device), 4_000, 2, device))
    return {
        (body.knob, body.value): finish(PrecisionRow, body, machine_description(device), id="feed") for body in found
    }


def test_half_precision_is_the_error_and_resolution_is_none(rows):
    half, single = rows["precision", "half"], rows["precision", "float"]
    assert 1e-6 < half.error < 1e-2 and single.error < 1e-6
    assert half.differing > single.differing == 0
    assert {rows["grid", value].error for value in ("8/16", "8/32")} == {single.error}
    assert half.image_error > 0 and single.image_error is None


def test_noise_falls_as_rays_a_pixel_grow(rows):
    errors = [rows["samples", str(count)].error for count in module.SAMPLES]
    assert all(rows["samples", str(count)].differing == 0 for count in module.SAMPLES)
    assert errors[0] > 2 * errors[2] and errors[1] > errors[3]


def test_every_row_has_a_rate_and_an_error(rows):
    for row in rows.values():
        assert row.rate.median > 0 and np.isfinite(row.error)
    row = next(iter(rows.values())).as_json()
    del row["error"]
    with pytest.raises(DefrayError, match="error: missing key"):
        as_row(PrecisionRow, row)


def runs_of(rows) -> Results:
    return Results([], None, DEVICE, read_published(), precision=[as_row(PrecisionRow, row) for row in rows])


def test_the_caption_says_when_half_precision_is_enough():
    select, caption = enough_precision.select, enough_precision.caption
    numbers = select(runs_of(precision_rows("sponza")))
    assert "Sponza: at all of them, up to 64 rays a pixel" in caption(runs_of([]), numbers)
    rough = [row | ({"image_error": 0.15} if row["value"] == "half" else {}) for row in precision_rows("sponza")]
    assert "Sponza: up to 4 rays a pixel" in enough_precision.caption(
        runs_of([]), enough_precision.select(runs_of(rough))
    )
    worse = [row | ({"image_error": 0.9} if row["value"] == "half" else {}) for row in precision_rows("sponza")]
    assert "Sponza: at no number measured" in enough_precision.caption(
        runs_of([]), enough_precision.select(runs_of(worse))
    )


@pytest.mark.parametrize("narrow", [False, True])
def test_the_chart_is_drawn(narrow):
    runs = runs_of(
        [
            *precision_rows("sponza"),
            *precision_rows("crown"),
            precision_row("crown", "precision", "perfect", 0.1, 0.0),
        ]
    )
    with style.style():
        figure = style.fix_layout(enough_precision.draw(runs, enough_precision.select(runs), narrow))
        assert "<svg" in style.svg_text(figure)
