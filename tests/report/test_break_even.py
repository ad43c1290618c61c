"""The break-even is where two straight lines cross, and the table finds the runs and builds it compares."""

from __future__ import annotations

import math

import pytest
from made_up_report import make_folder, one_record

from harness.errors import DefrayError
from harness.report.figures import end_to_end
from harness.report.page import read_runs
from harness.report.tables import break_even_table
from harness.stats import BuildAndRate, rays_to_break_even


@pytest.mark.parametrize(
    ("ours", "theirs", "rays"),
    [
        ((2.0, 2e6), (1.0, 1e6), 2e6),  # 1 s later, half a microsecond saved a ray
        ((0.5, 2e6), (1.0, 1e6), 0.0),  # sooner and faster
        ((1.0, 1e6), (1.0, 1e6), 0.0),  # never slower
        ((2.0, 1e6), (1.0, 1e6), math.inf),
        ((2.0, 1e6), (1.0, 2e6), math.inf),
        ((0.5, 1e6), (1.0, 2e6), math.inf),  # ahead for few rays only
    ],
)
def test_break_even(ours, theirs, rays):
    assert rays_to_break_even(BuildAndRate(*ours), BuildAndRate(*theirs)) == pytest.approx(rays)


def test_costs_are_equal_at_the_break_even():
    ours, theirs = BuildAndRate(3.1, 2.3e6), BuildAndRate(0.7, 1.9e6)
    rays = rays_to_break_even(ours, theirs)
    assert ours.seconds(rays) == pytest.approx(theirs.seconds(rays))
    assert ours.seconds(0.9 * rays) > theirs.seconds(0.9 * rays)


@pytest.mark.parametrize("bad", [(-1.0, 1e6), (math.nan, 1e6), (1.0, 0.0), (1.0, math.nan)])
def test_nonsense_is_refused(bad):
    with pytest.raises(DefrayError, match="break-even needs"):
        BuildAndRate(*bad)


def records(embree_build):
    first, second, forward = (
        one_record("sponza", tracer, "ray-space", {"total": ns}, options=options)
        for tracer, ns, options in (("deferred", 400, {"wave": "8"}), ("deferred", 500, None), ("forward", 900, None))
    )
    embree = one_record("sponza", "embree", None, {"total": 600}, grid=None)
    first["grid"]["build_seconds"], second["grid"]["build_seconds"] = 4.0, 2.0  # the first build compiled
    forward["grid"] |= {"build_seconds": 1.0, "cells": 77}
    embree["hierarchy_build_seconds"] = embree_build
    return [first, second, forward, embree]


def table(tmp_path, embree_build):
    make_folder(tmp_path, records(embree_build))
    return break_even_table.select(read_runs(tmp_path)).iloc[0]


def test_table_takes_the_fastest_runs_and_the_shortest_builds(tmp_path):
    row = table(tmp_path, 0.5)
    assert row["deferred_variant"] == "deferred:ray-space:wave=8"
    assert (row["deferred_build_seconds"], row["forward_build_seconds"], row["embree_build_seconds"]) == (2, 1, 0.5)
    assert row["rays_until_ahead_of_forward"] == pytest.approx(1.0 / 500e-9, rel=0.1)
    assert row["rays_until_ahead_of_embree"] == pytest.approx(1.5 / 200e-9, rel=0.2)


def test_embree_is_taken_from_beside_the_fastest_deferred_run(tmp_path):
    made = records(0.5)
    paired, lucky = (one_record("sponza", "embree", None, {"total": ns}, grid=None) for ns in (600, 300))
    for record in (made[0], paired):
        record["spec"] = {"grid": {"top": 0, "leaf": 0, "reading": "auto"}}
    lucky["spec"] = {"grid": {"top": 8, "leaf": 128, "reading": "total"}}
    paired["id"], lucky["id"] = "paired", "lucky"
    make_folder(tmp_path, [*made[:3], lucky, paired])
    runs = read_runs(tmp_path)
    assert "paired" in break_even_table.select(runs).iloc[0]["runs"].split()
    shown = end_to_end.select(runs).set_index("series")
    assert shown.loc["Embree robust", "runs"] == "paired" and "lucky" not in set(shown["runs"])


def test_a_build_that_is_not_known_has_no_break_even(tmp_path):
    row = table(tmp_path, None)
    assert row["rays_until_ahead_of_embree"] is None and row["rays_until_ahead_of_forward"] > 0


def test_deferred_runs_alone_make_no_table(tmp_path):
    make_folder(tmp_path, [record for record in records(0.5) if record["tracer"] == "deferred"])
    assert len(break_even_table.select(read_runs(tmp_path))) == 0
