"""The estimate of the time left."""

from __future__ import annotations

import pytest

from harness.campaign import progress
from harness.spec.run_spec import Variant
from harness.studies.study import guessed_seconds


def test_time_left_is_what_was_guessed_times_measured_over_guessed():
    time_left = progress.TimeLeft(60)
    assert time_left.left(0, 0, 0) == 60
    for cost, seconds in ((10, 20), (20, 70)):
        time_left.start(cost)
        time_left.measured(cost, seconds)
    assert time_left.left(0, 0, 0) == pytest.approx(30 * 90 / 30)


def test_time_left_falls_while_a_task_runs():
    time_left = progress.TimeLeft(15)
    time_left.start(10)
    steps = [time_left.left(10, 10 * share, share) for share in (0.0, 0.3, 0.6, 0.9)]
    assert steps == sorted(steps, reverse=True) and steps[0] == 15
    assert time_left.left(10, 30, 0.0) > 5, "an overdue task is not free"


def test_a_tracer_costs_by_what_it_does_not_by_its_name():
    def seconds(text: str) -> float:
        return guessed_seconds("sponza", [(Variant.parse(text), 1_000_000)], 0)

    assert seconds("brute:ray-space") > 20 * seconds("deferred:ray-space") > 20 * seconds("embree")
    assert seconds("streamed:ray-space") == seconds("deferred:ray-space") == seconds("forward:ray-space")


@pytest.mark.parametrize(
    ("seconds", "text"), [(3, "10 s"), (44, "40 s"), (130, "2 min"), (4000, "67 min"), (9000, "2.5 h")]
)
def test_time_left_has_no_false_digits(seconds, text):
    assert progress.about(seconds) == f"about {text} left"
