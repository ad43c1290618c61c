"""Charts of speed against accuracy: frontiers, bounds for nothing observed, and rows that are not read."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from made_up_accuracy import DEVICE, VARIANTS, accuracy_row, as_results, as_row, stability, write_accuracy
from matplotlib.text import Text

from harness.analysis.results import Results, read_published
from harness.errors import DefrayError
from harness.records.accuracy_row import AccuracyRow
from harness.records.digest import sealed
from harness.records.schema import SCHEMA
from harness.report.figures import figures, kernel_accuracy, speed_accuracy, stability_map, style
from harness.report.figures.contenders import intersector_name
from harness.report.figures.metrics import METRICS, frontier
from harness.report.page import read_stability
from harness.report.tables import speed_at_floor
from harness.spec.intersectors import INTERSECTORS
from harness.stats import rate_bound


def runs_of(rows=(), tests=None, folder=None) -> Results:
    """Results of made-up rows and of a made-up stability.json."""
    suite = as_results(tests) if tests else None
    return Results(
        [],
        folder,
        DEVICE,
        read_published(),
        [as_row(AccuracyRow, row) for row in rows],
        stability=suite.rows if suite else [],
        kernel_rates=suite.kernel_rates if suite else [],
    )


def scene_rows(scene: str = "sponza", **changed) -> list[dict]:
    return [accuracy_row(scene, variant, **changed) for variant in VARIANTS]


def test_the_frontier_of_hand_made_points():
    leaks = [0.1, 0.1, 0.01, 0.01, 0.001, 0.5, float("nan")]
    rates = [5.0, 4.0, 3.0, 3.0, 1.0, 4.9, 9.0]
    found = frontier(leaks, rates, "leak_rate", "rate")
    #           best   slower  equal points  most exact  worse in both  no leak rate: the worst, but the fastest
    assert found.tolist() == [True, False, True, True, True, False, True]


def test_the_frontier_follows_the_directions_of_the_metrics():
    assert METRICS["rate"].better == "higher" and METRICS["band_ulp"].better == "lower"
    assert frontier([1, 2], [1, 2], "band_ulp", "tests_per_second").tolist() == [True, True]
    assert frontier([2, 1], [1, 2], "band_ulp", "tests_per_second").tolist() == [False, True]
    assert all(metric.label and np.isfinite(metric.worst) | (metric.better == "lower") for metric in METRICS.values())


def test_the_bound_of_a_rate():
    assert rate_bound(0, 100_000) == pytest.approx(3e-5)
    assert rate_bound(0, 1) == 1 and rate_bound(7, 7) == 1
    assert rate_bound(10, 100) == pytest.approx(0.1637, abs=1e-3)  # Clopper and Pearson, one-sided 95 %
    for events, trials in ((1, 0), (3, 2), (-1, 5)):
        with pytest.raises(DefrayError):
            rate_bound(events, trials)


def test_chart_1_draws_nothing_observed_at_its_bound():
    numbers = speed_accuracy.select(runs_of(scene_rows())).set_index("variant")
    assert numbers.loc["deferred:ray-space", "minus_log10_leak_bound"] == pytest.approx(-np.log10(3e-5))
    assert numbers.loc["embree", "minus_log10_leak_bound"] == pytest.approx(-np.log10(4.35e-3), abs=0.01)
    assert np.isfinite(numbers["minus_log10_leak_bound"]).all()


def test_one_leak_is_never_drawn_right_of_none():
    rows = [accuracy_row("sponza", "deferred:ray-space", leaks=0), accuracy_row("sponza", "deferred:pbrt", leaks=1)]
    numbers = speed_accuracy.select(runs_of(rows)).set_index("variant")["minus_log10_leak_bound"]
    assert numbers["deferred:pbrt"] < numbers["deferred:ray-space"]


def test_chart_1_frontiers_over_all_and_of_each_tracer():
    numbers = speed_accuracy.select(runs_of(scene_rows())).set_index("variant")
    all_of_them = set(numbers.index[numbers["on_frontier"]])
    assert all_of_them == {"embree:robust=false", "embree", "deferred:ray-space:contraction=on"}
    own = set(numbers.index[numbers["on_own_frontier"]])
    assert own - all_of_them == {"deferred:moller-trumbore", "forward:ray-space"}
    assert list(numbers.index[numbers["default"]]) == ["deferred:ray-space"]
    assert not numbers.loc["deferred:plucker", "within_noise"]


def test_chart_1_keeps_rates_of_other_counts_apart():
    rows = [*scene_rows(), accuracy_row("sponza", "deferred:pbrt", rays=1000)]
    assert "deferred:pbrt" not in set(speed_accuracy.select(runs_of(rows))["variant"])


@pytest.mark.parametrize("narrow", [False, True])
def test_names_of_chart_1_do_not_meet_in_dense_panels(narrow):
    names = [name for name in INTERSECTORS if "double" not in name]
    leaks = (0, 0, 5, 20, 80, 300)  # some near one another on the frontier, as in a dense scene
    dense = [
        accuracy_row(
            "crown", f"deferred:{name}:contraction=on", rate=0.3 + 5e-3 * min(place, 5), leaks=leaks[min(place, 5)]
        )
        for place, name in enumerate(names)
    ]
    rows = [*scene_rows(), *dense, *(row for row in scene_rows("crown") if row["tracer"] == "embree")]
    numbers = speed_accuracy.select(runs_of(rows))
    with style.style():
        figure = style.fix_layout(speed_accuracy.draw(runs_of(rows), numbers, narrow))
        for axis in figure.axes:
            names = [text for text in axis.texts if text.get_text()]
            boxes = [Text.get_window_extent(name).padded(-0.5) for name in names]  # an annotation's has its arrow
            assert len(boxes) >= 4
            assert all(box.count_overlaps(boxes) == 1 for box in boxes)
            own = numbers[numbers["scene"] == axis.get_title(loc="left")]
            points = axis.transData.transform(own[["minus_log10_leak_bound", "total_mrays_per_s"]].to_numpy(float))
            assert len(points) and not any(box.contains(*point) for box in boxes for point in points)
            frame = axis.get_window_extent()
            assert all(frame.y0 - 1 < box.y0 and box.y1 < frame.y1 + 1 for box in boxes)


def test_places_that_touch_move_apart_and_stay_inside():
    assert style.spread([0.5, 0.5], 0.2, 0, 1) == pytest.approx([0.4, 0.6])
    assert style.spread([0.9, 0.95, 1.0], [0.1, 0.3], 0, 1) == pytest.approx([0.6, 0.7, 1.0])
    assert style.spread([0.1, 0.9], 0.2, 0, 1) == pytest.approx([0.1, 0.9])
    assert np.diff(style.spread([0.5] * 5, 0.5, 0, 1)) == pytest.approx([0.25] * 4)
    assert style.spread([], 0.5, 0, 1) == []


def test_the_caption_of_chart_1_says_where_the_default_stands():
    rows = [*scene_rows(), accuracy_row("crown", "deferred:ray-space", rate=0.4)]
    numbers = speed_accuracy.select(runs_of(rows))
    text = speed_accuracy.caption(runs_of(rows), numbers)
    assert (
        "Sponza: off its tracer's frontier, off that of all; "
        "with as few leaks, ray space, contracted is 1.03 times as fast."
    ) in text
    assert "Crown: on its tracer's frontier, on that of all; nothing with as few leaks is faster." in text


@pytest.mark.parametrize("narrow", [False, True])
def test_charts_are_drawn_on_wide_and_narrow_pages(narrow):
    runs = runs_of([*scene_rows(), *scene_rows("crown"), *scene_rows("hairball")], stability())
    for module in (speed_accuracy, kernel_accuracy, stability_map):
        numbers = module.select(runs)
        assert len(numbers) and len(module.caption(runs, numbers)) > 100
        with style.style():
            assert "<svg" in style.svg_text(style.fix_layout(module.draw(runs, numbers, narrow)))


def test_every_accuracy_chart_is_in_the_report():
    assert {"speed_accuracy", "kernel_accuracy", "stability_map", "precision"} <= set(figures())


def test_without_files_there_are_no_charts():
    for module in (speed_accuracy, kernel_accuracy, stability_map, speed_at_floor):
        assert module.select(runs_of()).empty


def test_every_intersector_has_a_name():
    names = [intersector_name(name) for name in INTERSECTORS]
    assert len(set(names)) == len(names) and all(names)


def test_speed_at_each_floor_and_its_price():
    numbers = speed_at_floor.select(runs_of(scene_rows())).set_index("leak_rate_below")
    fastest = ["embree:robust=false", "embree", "deferred:ray-space:contraction=on", "none"]
    assert list(numbers["variant"].fillna("none")) == fastest
    assert numbers.loc["any", "deferred_variant"] == "deferred:moller-trumbore"
    assert numbers.loc["any", "price"] == 1
    assert numbers.loc["0.0001", "price"] == pytest.approx(0.36 / 0.31, rel=0.02)
    assert numbers.loc["0.0001", "price_low"] <= numbers.loc["0.0001", "price"] <= numbers.loc["0.0001", "price_high"]
    assert pd.isna(numbers.loc["3e-06", "deferred_variant"]), "100,000 rays cannot show 3e-6"


def test_a_million_rays_show_the_lowest_floor():
    numbers = speed_at_floor.select(runs_of(scene_rows(aimed=1_000_000))).set_index("leak_rate_below")
    assert numbers.loc["3e-06", "variant"] == "deferred:ray-space:contraction=on"


def test_cells_that_fail_and_cells_where_all_is_lost():
    tests = stability()
    tests["rows"][0] |= {"leaks": 20_000, "passed": False}
    numbers = stability_map.select(runs_of(tests=tests))
    assert numbers.loc[0, "all_lost"] and numbers["all_lost"].sum() == 1
    failed = numbers[~numbers["passed"]]
    assert set(failed["intersector"]) == {"ray-space", "moller-trumbore"}
    assert (failed["severity"][1:] > 0).any() and (numbers[numbers["passed"]]["severity"] < 0.2).all()


def test_a_limit_other_than_leaks_is_seen():
    tests = stability(("W2",))
    tests["rows"][0] |= {"leaks": 0, "double_hits": 10_000, "passed": False}
    cell = stability_map.select(runs_of(tests=tests)).loc[0]
    assert cell["value"] == 0.5 and cell["severity"] > 0.9 and not cell["all_lost"]


def test_chart_2_takes_the_worst_of_three_families():
    tests = stability()
    tests["rows"][3]["band_ulp"] = 7.5
    numbers = kernel_accuracy.select(runs_of(tests=tests)).set_index(["intersector", "contraction"])
    assert numbers.loc[("ray-space", "off"), "band_ulp"] == 7.5
    assert numbers.loc[("ray-space", "on"), "band_ulp"] == 3.0
    assert numbers.loc[("ray-space", "on"), "on_band_ulp_frontier"]
    assert not numbers.loc[("moller-trumbore", "on"), "on_band_ulp_frontier"]


@pytest.mark.parametrize("band", [0.0, None])
def test_chart_2_is_drawn_where_no_test_errs_and_where_all_err_without_bound(band):
    tests = stability()
    for row in tests["rows"]:
        row |= {"band_ulp": band, "residual_p99_ulp": band} if row["family"][0] == "A" else {}
    runs = runs_of(tests=tests)
    with style.style():
        assert "<svg" in style.svg_text(
            style.fix_layout(kernel_accuracy.draw(runs, kernel_accuracy.select(runs), False))
        )


def test_a_damaged_stability_file_is_named(tmp_path):
    (tmp_path / "stability.json").write_text(json.dumps(sealed({"schema": SCHEMA, "rows": [{}]})))
    with pytest.raises(DefrayError, match=r"stability\.json is no result"):
        read_stability(tmp_path, DEVICE)


def test_stability_of_another_device_and_rates_of_wrong_tests_are_not_drawn(tmp_path):
    tests = stability()
    tests["kernel_rates"][0] |= {"wrong": 7, "tests_per_second": None}
    (tmp_path / "stability.json").write_text(json.dumps(sealed(tests)))
    rows, rates = read_stability(tmp_path, DEVICE)
    assert len(rows) == 36 and len(rates) == 5
    assert read_stability(tmp_path, "another device") == ([], [])


def test_write_accuracy_is_read_back(tmp_path):
    from harness.records.accuracy_row import accuracy_file
    from harness.records.precision_row import precision_file

    write_accuracy(tmp_path, ("sponza",))
    assert len(accuracy_file(tmp_path).read()) == len(VARIANTS) and len(precision_file(tmp_path).read()) == 10
