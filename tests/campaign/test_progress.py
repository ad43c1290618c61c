"""The estimate of the time left."""

from __future__ import annotations

import pytest

from harness.campaign import progress
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import Uniform


def spec_on(scene: str, tracer: str = "deferred:ray-space", rays: int = 1_000_000) -> RunSpec:
    return RunSpec(scene=scene, variant=Variant.parse(tracer), structure=Uniform(), rays=rays)


def test_time_left_learns_from_measured_groups():
    time_left = progress.TimeLeft({"small": 100_000, "large": 5_000_000})
    small, large = [spec_on("small")], [spec_on("large")]
    assert time_left.predict(large) > 3 * time_left.predict(small), "not a plain mean"
    time_left.measured(small, 10 * time_left.guess(small))
    assert time_left.predict(large) == pytest.approx(10 * time_left.guess(large))
    time_left.measured(large, 30 * time_left.guess(large))
    assert 20 < time_left.predict(large) / time_left.guess(large) < 30, "the same scene weighs more"


def test_time_left_falls_while_a_group_runs():
    time_left = progress.TimeLeft({})
    group, waiting = [spec_on("a")], [[spec_on("b")]]
    whole = time_left.predict(group)
    steps = [time_left.left(group, share * whole, share, waiting) for share in (0.0, 0.3, 0.6, 0.9)]
    assert steps == sorted(steps, reverse=True)
    assert steps[0] == pytest.approx(whole + time_left.predict(waiting[0]))
    assert time_left.left(group, 3 * whole, 0.0, []) > 0, "an overdue group is not free"


def test_cost_model_orders_tracers():
    brute = progress.guessed_seconds(spec_on("a", "brute:ray-space"), 300_000)
    embree = progress.guessed_seconds(spec_on("a", "embree"), 300_000)
    assert brute > 50 * progress.guessed_seconds(spec_on("a"), 300_000) > 50 * embree


@pytest.mark.parametrize(
    ("seconds", "text"), [(3, "10 s"), (44, "40 s"), (130, "2 min"), (4000, "67 min"), (9000, "2.5 h")]
)
def test_time_left_has_no_false_digits(seconds, text):
    assert progress.about(seconds) == f"about {text} left"
