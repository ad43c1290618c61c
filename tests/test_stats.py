"""Statistics against examples computed by hand."""

import math

import numpy as np
import pytest

from harness import stats
from harness.data import Samples
from harness.errors import DefrayError


def test_median_of_odd_and_even_counts():
    assert stats.median([3.0, 1.0, 2.0]) == 2.0
    assert stats.median([4.0, 1.0, 2.0, 3.0]) == 2.5


@pytest.mark.parametrize("values", [[], [1.0, float("nan")], [float("inf")]])
def test_median_refuses_nothing_and_non_finite(values):
    with pytest.raises(DefrayError):
        stats.median(values)


def test_interval_of_few_values_is_their_range():
    assert stats.interval([2.0]) == stats.Interval(2.0, 2.0, 2.0)
    assert stats.interval([4.0, 2.0]) == stats.Interval(3.0, 2.0, 4.0)


def test_interval_of_three_values_reaches_both_ends():
    # A resample of three has the smallest as its median with probability 7/27, far above 2.5 %.
    assert stats.interval([1.0, 2.0, 5.0]) == stats.Interval(2.0, 1.0, 5.0)


def test_interval_of_nine_values_matches_the_binomial():
    # Median of a resample of 9 is <= the 2nd value when 5 or more draws are among the lowest 2:
    # binomial(9, 2/9), P(X >= 5) = 0.0298 > 0.025; <= the 1st: binomial(9, 1/9), P = 0.0014 < 0.025.
    assert stats.interval([float(value) for value in range(1, 10)]) == stats.Interval(5.0, 2.0, 8.0)


def test_interval_is_repeatable_and_ignores_order():
    values = [1.0, 1.2, 0.9, 1.1, 1.05]
    assert stats.interval(values) == stats.interval(values)
    assert stats.interval(values).median == stats.interval(values[::-1]).median


def test_ratio_of_paired_repetitions_ignores_a_common_slowdown():
    base = [10.0, 5.0, 8.0, 20.0, 9.0]
    result = stats.ratio([2 * rate for rate in base], base)
    assert (result.median, result.low, result.high) == (2.0, 2.0, 2.0)


def test_ratio_of_one_repetition():
    assert stats.ratio([6.0], [3.0]) == stats.Interval(2.0, 2.0, 2.0)


def test_ratio_widens_with_noise():
    result = stats.ratio([1.0, 2.0, 3.0], [1.0, 1.0, 1.0])
    assert result == stats.Interval(2.0, 1.0, 3.0)


def test_ratio_refuses_unpaired_samples_and_zero():
    with pytest.raises(DefrayError, match="got 2 and 3"):
        stats.ratio([1.0, 2.0], [1.0, 2.0, 3.0])
    with pytest.raises(DefrayError, match="above zero"):
        stats.ratio([1.0], [0.0])


def test_four_repetitions_are_needed_to_tell_samples_apart():
    # Disjoint samples: p = 2 / C(2n, n), so 2/20 for n = 3 and 2/70 for n = 4.
    assert stats.different_p_value([1, 2, 3], [4, 5, 6]) == pytest.approx(0.1)
    assert stats.different_p_value([1, 2, 3, 4], [5, 6, 7, 8]) == pytest.approx(2 / 70)
    assert stats.different_p_value([1, 3, 5, 7], [2, 4, 6, 8]) > 0.05


def test_rates_are_rays_over_seconds_stage_by_stage():
    samples = Samples(traverse=[0.5, 0.25, 1.0], total=[2.0, 1.0, 4.0], intersect=[0.0, 0.0, 0.0])
    result = stats.rates(samples, rays=100)
    assert result == {
        "traverse": stats.Interval(200.0, 100.0, 400.0),
        "intersect": None,
        "total": stats.Interval(50.0, 25.0, 100.0),
    }


def test_an_invalid_run_has_no_rate():
    assert stats.rates(Samples(total=[1.0]), 10, valid=False) == dict.fromkeys(stats.RATED_STAGES)


def test_quotient_of_separate_runs_is_wider_than_a_paired_ratio():
    base = [10.0, 5.0, 8.0, 20.0, 9.0]
    paired, apart = stats.ratio([2 * rate for rate in base], base), stats.quotient([2 * rate for rate in base], base)
    assert apart.median == paired.median == 2.0 and apart.low < paired.low and apart.high > paired.high
    assert stats.quotient([4.0, 6.0], [1.0, 2.0]) == stats.Interval(10 / 3, 2.0, 6.0)
    with pytest.raises(DefrayError, match="above zero"):
        stats.quotient([1.0], [0.0])


def test_geometric_mean_over_scenes():
    pairs = [([2.0, 2.0, 2.0], [1.0, 1.0, 1.0]), ([8.0, 8.0, 8.0], [1.0, 1.0, 1.0])]
    found = stats.geometric_mean(pairs)
    assert (found.median, found.low, found.high) == pytest.approx((4, 4, 4))
    noisy = stats.geometric_mean([pairs[0], ([4.0, 8.0, 16.0], [1.0, 1.0, 1.0])])
    assert noisy.low == pytest.approx(math.sqrt(8)) and noisy.high == pytest.approx(math.sqrt(32))
    for wrong in ([], [([1.0], [0.0])]):
        with pytest.raises(DefrayError):
            stats.geometric_mean(wrong)


def test_an_exponents_interval_is_students():
    # Residuals 0, 1, -1, 0 of log y over log x = -3, -1, 1, 3: slope -0.1, squares 1.8, t(2) = 4.3027.
    x, y = np.exp([-3.0, -1.0, 1.0, 3.0]), np.exp([0.0, 1.0, -1.0, 0.0])
    found = stats.exponent(x, y, ["a"] * 4)
    half = 4.302653 * math.sqrt(1.8 / 2 / 20)
    assert (found.median, found.low, found.high) == pytest.approx((-0.1, -0.1 - half, -0.1 + half), rel=1e-6)
    with pytest.raises(DefrayError, match="more points"):
        stats.exponent([1.0, 2.0], [1.0, 2.0], ["a", "a"])


@pytest.mark.parametrize(
    ("curve", "model"),
    [(lambda x: 3 + 0 * x, "constant"), (lambda x: 2 + 5 * x, "linear"), (lambda x: 4 * x**0.5, "power")],
)
def test_the_curve_that_made_the_points_is_preferred(curve, model):
    x = np.geomspace(0.1, 30, 8)
    noise = 1 + 0.01 * np.array([1, -1, 1, 1, -1, -1, 1, -1])
    best = stats.fits(x * 1e6, curve(x) * noise)[0]
    assert best.model == model
    middle, low, high = best.at(x * 1e6)
    assert middle == pytest.approx(curve(x), rel=0.02) and (low < middle).all() and (middle < high).all()
    if model == "power":
        power = best.parameter(1)
        assert power.low < 0.5 < power.high and power.high - power.low < 0.02


def test_few_points_carry_no_trend():
    x = np.array([1.0, 2.0, 4.0, 8.0])
    ranked = stats.fits(x, x * [1.1, 0.9, 1.1, 0.9])
    assert ranked[0].model == "constant" and math.isinf(ranked[1].aicc)
    scattered = stats.fits([1, 2, 8, 10, 30], [3.1, 1.6, 2.3, 7.3, 5.9])
    assert scattered[0].model == "constant", "five scattered scenes are described by their mean"
    with pytest.raises(DefrayError, match="three or more"):
        stats.fits([1, 2], [1, 2])


def test_aicc_of_a_constant_by_hand():
    values = np.exp([0.0, 1.0, 2.0, 1.0])
    constant = next(fit for fit in stats.fits([1, 2, 3, 4], values) if fit.model == "constant")
    assert constant.aicc == pytest.approx(4 * math.log(2 / 4) + 4 + 12)
    assert constant.parameters[0] == pytest.approx(math.e)
    middle, low, high = constant.at([7.0])
    half = 3.182446 * math.sqrt(2 / 3 / 4)
    assert np.log([low[0], middle[0], high[0]]) == pytest.approx([1 - half, 1, 1 + half], rel=1e-5)
