"""Figures of arrangements and of the number of rays: their numbers from records whose numbers are known."""

from __future__ import annotations

import pytest
from made_up_report import RAYS, as_records, deferred, one_record

from harness.analysis.results import Results, read_published
from harness.report.figures import arrangements, ray_count

DEVICE = "pthread-test AVX-512 device"


def runs_of(records: list[dict], folder) -> Results:
    return Results(as_records(records), folder, DEVICE, read_published())


def arranged(name: str | None, nanoseconds: float, **options) -> dict:
    """A run that arranges in so many nanoseconds a ray, eight pairs each."""
    stages = {"traverse": 80.0, "arrange": nanoseconds, "intersect": 90.0, "compact": 5.0}
    named = {"arrange": name} if name else {}
    return one_record("sponza", "deferred", "ray-space", stages, options={**named, **options})


def test_arranging_is_told_a_pair_a_second_and_as_a_share(tmp_path):
    records = [arranged(None, 8.0), arranged("record", 16.0), arranged("sort", 48.0), arranged("sort", 1.0, wave="8")]
    numbers = arrangements.select(runs_of(records, tmp_path)).set_index("arrangement")
    assert list(numbers.index) == ["two passes", "record, bin", "record, sort"], "other options are left out"
    sort = numbers.loc["record, sort"]
    assert sort["arrange_ns_per_pair"] == pytest.approx(6.0, rel=0.1)
    assert sort["mpairs_per_s_arranged"] == pytest.approx(1000 / 6.0, rel=0.1)
    assert sort["arrange_share"] == pytest.approx(48 / (223 * 1.06), rel=0.1)
    assert sort["sorting_over_binning"] == pytest.approx(3.0, rel=0.1)
    parts = numbers[["traverse_ns_per_pair", "arrange_ns_per_pair", "rest_ns_per_pair"]].sum(axis=1)
    assert parts.to_numpy() == pytest.approx(numbers["total_ns_per_pair"].to_numpy(), rel=1e-6)
    caption = arrangements.caption(runs_of(records, tmp_path), numbers.reset_index())
    assert "second walk" in caption and "1 ms per million pairs" in caption


def test_one_arrangement_is_no_comparison(tmp_path):
    assert arrangements.select(runs_of([arranged(None, 8.0)], tmp_path)).empty
    uncounted = [arranged(None, 8.0), arranged("sort", 8.0)]
    uncounted[1]["counters"]["pairs"] = 0
    assert arrangements.select(runs_of(uncounted, tmp_path)).empty


def test_the_power_of_the_number_of_rays_is_found(tmp_path):
    series = (RAYS // 16, 2.0), (RAYS // 4, 2**0.5), (RAYS, 1.0), (RAYS * 4, 0.5**0.5), (RAYS * 16, 0.5)
    records = [deferred("sponza", walk=f, work=f, rays=rays) for rays, f in series]
    records.append(deferred("crown", rays=RAYS))
    numbers = ray_count.select(runs_of(records, tmp_path))
    assert set(numbers["name"]) == {"sponza"}, "one number of rays is no series"
    assert numbers["exponent"].iloc[0] == pytest.approx(0.75, abs=0.05)
    assert numbers["exponent_many"].iloc[0] == pytest.approx(0.75, abs=0.08)
    assert (numbers["ns_per_ray"].diff().dropna() < 0).all()
    assert "goes as the power 0.7" in ray_count.caption(runs_of(records, tmp_path), numbers)


def test_two_numbers_of_rays_are_too_few(tmp_path):
    records = [deferred("sponza", rays=RAYS), deferred("sponza", rays=RAYS // 4)]
    assert ray_count.select(runs_of(records, tmp_path)).empty
