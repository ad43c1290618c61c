"""The figures that carry the claims: what they select, what they mark, and what their captions dare to say."""

from __future__ import annotations

import pytest
from made_up_claims import BASE, OURS, SCENES, record, results, speedups
from made_up_report import as_records

from harness.analysis.ratios import speedup
from harness.analysis.results import Results
from harness.report.figures import end_to_end, intersection_speedup, published_rates, resolution_map, style, waves
from harness.report.tables import intersector_ratio


def runs_of(records: list[dict], **changes) -> Results:
    """Runs with a rate that follows from the seconds of `total`."""
    for one in records:
        rates = sorted(one["rays"]["count"] / seconds for seconds in one["samples"]["total"])
        one["rate"] = {
            "traverse": None,
            "intersect": None,
            "total": {"median": rates[len(rates) // 2], "low": rates[0], "high": rates[-1]},
        }
        if one["samples"]["intersect"]:
            one["rate"]["intersect"] = one["rate"]["total"]
    return results(records)


def drawn(module, runs: Results):
    """Numbers and caption, after drawing both widths."""
    numbers = module.select(runs)
    with style.style():
        for narrow in (False, True):
            style.fix_layout(module.draw(runs, numbers, narrow))
    return numbers, module.caption(runs, numbers)


def test_the_chart_of_whole_traces_says_of_each_run_its_own_rate():
    tests = ("ray-space", "moller-trumbore", "plucker")
    records = [record(f"deferred:{name}", "sponza", 1.0 + place, rays=9000) for place, name in enumerate(tests)]
    records += [record(OURS, "sponza", 5.0), record("forward:ray-space", "sponza", 7.0)]  # fewer rays, more tracers
    runs = runs_of(records)
    rows = end_to_end.chart(runs, end_to_end.select(runs))["data"]["values"]
    assert {row["tracer"] for row in rows} == {"deferred", "forward"}
    for row in rows:
        assert row["rate_text"].split(" [")[0] == f"{row['rate']:.4g}", row["name"]


def test_a_map_marks_the_fastest_uniform_grid_and_the_chosen_one():
    grids = {
        "4/64 total": 4.0,
        "8/64 total": 3.0,
        "8/128 total": 2.0,
        "16/64 total": 1.0,
        "16/128 total": 5.0,
        "40/16 adaptive": 0.5,
    }
    records = [record(OURS, "sponza", seconds, grid=grid) for grid, seconds in grids.items()]
    records.append(record(OURS + ":wave=8", "sponza", 0.7, grid="44/16 adaptive"))
    records[-1]["grid"]["chosen"] = "by the cost model"
    numbers, caption = drawn(resolution_map, runs_of(records))
    assert list(numbers[numbers["fastest"]]["grid"]) == ["16/64 total"]
    assert list(numbers[numbers["chosen"]]["grid"]) == ["44/16 adaptive"]
    assert "star" in caption and "adaptive" in caption


def test_runs_on_adaptive_grids_of_different_densities_are_not_held_against_each_other():
    def on_adaptive(variant: str, density: float, seconds: float) -> dict:
        made = record(variant, "sponza", seconds, grid="40/16 adaptive")
        asked = {"top": 0, "leaf": 16, "reading": "adaptive", "density": density}
        return made | {"spec": {"grid": asked}, "id": f"{made['id']} {density}"}

    other = "deferred:moller-trumbore"
    records = [on_adaptive(OURS, 0.3, 1.0), on_adaptive(other, 1.2, 4.0), on_adaptive(OURS, 1.2, 2.0)]
    numbers = intersector_ratio.select(runs_of(records))
    assert list(numbers["whole_trace_ratio"]) == [2.0], "the one at density 1.2"
    assert intersector_ratio.select(runs_of(records[:2])).empty


def test_only_interleaved_runs_are_paired():
    noisy = (1.0, 2.0, 4.0)
    auto = {"spec": {"grid": {"top": 0, "leaf": 0, "reading": "auto"}}}
    made = [record(OURS, "sponza", noisy), record(BASE, "sponza", noisy), record(BASE, "sponza", noisy) | auto]
    ours, base, other = as_records(made)
    together = speedup(ours, base, "intersect")
    assert together["ratio_low"] == together["ratio_high"] == 1
    apart = speedup(ours, other, "intersect")
    assert apart["ratio"] == 1 and apart["ratio_low"] < 1 < apart["ratio_high"]


def test_a_row_of_resolutions_is_no_map():
    records = [record(OURS, "sponza", 1.0, grid=f"8/{leaf} total") for leaf in (32, 64, 128)]
    assert resolution_map.select(runs_of(records)).empty


def test_waves_are_ordered_and_other_options_left_out():
    options = (
        "",
        ":wave=all",
        ":wave=16",
        ":wave=2",
        ":compaction=false",
        ":wave=2:arrange=record",
        ":wave=2:compaction=false",
    )
    records = [record(OURS + option, "sponza", 1.0, tests=2000, waves=3) for option in options]
    records.append(record(BASE, "sponza", 1.0, tests=1500))
    numbers, caption = drawn(waves, runs_of(records))
    assert list(numbers["setting"]) == ["2", waves.USUAL, "16", "all", waves.WITHOUT]
    assert set(numbers["tests_per_ray"]) == {2.0} and set(numbers["tests_needed"]) == {1.5}
    assert "wasted" in caption
    assert waves.select(runs_of(records[:2])).empty


def test_published_rates_stand_apart_from_ours():
    records = [record(OURS, scene, 1.0) for scene in SCENES] + [record("embree:", "sponza", 2.0, grid="8/128 total")]
    numbers, caption = drawn(published_rates, runs_of(records))
    ours = numbers[numbers["hardware"] == published_rates.OURS]
    assert set(ours["name"]) == set(SCENES) - {"hairball"}, "a stand-in is none of the scenes others measured"
    assert set(ours["runs"]) <= {one["id"] for one in records}
    others = numbers[numbers["hardware"] != published_rates.OURS]
    assert len(others) > 15 and (others["read_in"] != "").all() and "other hardware" in caption
    assert "ratio" not in " ".join(numbers.columns)
    stand_in = published_rates.select(runs_of([record(OURS, "hairball", 1.0)]))
    assert stand_in.empty


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ((3.07, 1.6, 2.3, 7.3, 5.9), "prefers a constant"),
        ((1.28, 1.33, 3.88, 4.53, 10.4), "prefers a line"),
        ((0.528, 0.576, 1.697, 1.88, 3.063), "prefers a power law"),
        ((3.0, 2.0, 4.0), "Too few scenes"),
    ],
)
def test_the_speed_up_over_size_claims_no_more_than_its_points_carry(factors, said):
    _, caption = drawn(intersection_speedup, runs_of(speedups(factors)))
    assert said in caption
    assert ("no trend" in caption) == ("constant (" in caption and "prefers a constant" in caption)


def test_many_options_at_fewer_rays_do_not_take_figure_1_over():
    records = speedups((2, 2, 2, 2, 2))
    records += [record(f"{OURS}:wave={wave}", "sponza", 1.0, rays=100) for wave in (1, 2, 3, 5, 6, 7)]
    records += [record(OURS, "sponza", 1.0, rays=100)]
    assert set(intersection_speedup.select(runs_of(records))["rays"]) == {1000}
