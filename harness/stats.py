"""Statistics of repeated timings, and the only place where rates are computed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.data import Samples
from harness.errors import DefrayError

RESAMPLES = 9999
RATED_STAGES = ("traverse", "intersect", "total")


@dataclass(frozen=True)
class Interval:
    """A median with its 95 % confidence interval, in the unit of the values it was computed from."""

    median: float
    low: float
    high: float

    def as_dict(self) -> dict[str, float]:
        """`{median, low, high}` as a record stores it."""
        return {"median": self.median, "low": self.low, "high": self.high}

    def __str__(self) -> str:
        return f"{self.median:.3g} [{self.low:.3g}, {self.high:.3g}]"


def median(values: Sequence[float]) -> float:
    """Median of one or more finite numbers; raises DefrayError otherwise."""
    return float(np.median(_finite(values)))


def interval(values: Sequence[float], confidence: float = 0.95) -> Interval:
    """Median and bootstrap interval of `values`, the same for the same input (the resampling is seeded).

    Fewer than three values cannot be resampled: the interval is then their smallest and largest.
    """
    sample = _finite(values)
    if len(sample) < 3:
        return Interval(float(np.median(sample)), float(sample.min()), float(sample.max()))
    return _bootstrap(len(sample), lambda rows: np.median(sample[rows], axis=-1), confidence)


def ratio(rates: Sequence[float], base_rates: Sequence[float], confidence: float = 0.95) -> Interval:
    """Median of `rates` over median of `base_rates`, both measured in the same interleaved repetitions.

    Repetition i of one is paired with repetition i of the other, and whole repetitions are resampled, so
    that a slow moment of the machine, which strikes both, does not widen the interval. Raises DefrayError
    when the two differ in length or a base rate is not positive.
    """
    sample, base = _finite(rates), _finite(base_rates)
    if len(sample) != len(base):
        raise DefrayError(f"a ratio needs paired repetitions: got {len(sample)} and {len(base)}")
    if (base <= 0).any():
        raise DefrayError("a ratio needs base rates above zero")
    if len(sample) < 3:
        quotients = sample / base
        return Interval(
            float(np.median(sample) / np.median(base)),
            float(quotients.min()),
            float(quotients.max()),
        )

    def quotient(rows: np.ndarray) -> np.ndarray:
        return np.median(sample[rows], axis=-1) / np.median(base[rows], axis=-1)

    return _bootstrap(len(sample), quotient, confidence)


def exponent(sizes: Sequence[float], values: Sequence[float], groups: Sequence[str]) -> Interval:
    """The power p of `values` proportional to `sizes` ** p, with a factor of its own for each group.

    Least squares through the logarithms, taken from their mean in each group; the interval resamples the points, and
    tells how well one power describes them, not the noise of a timing. Raises DefrayError where no group has two
    different sizes, or a number is not positive.
    """
    x, y = _finite(sizes), _finite(values)
    if len(x) != len(y) or len(x) != len(groups) or min(x.min(), y.min()) <= 0:
        raise DefrayError("a power needs as many sizes above zero as values above zero and groups")
    x, y = np.log(x), np.log(y)
    _, number = np.unique(np.asarray(groups), return_inverse=True)
    for column in (x, y):
        column -= (np.bincount(number, weights=column) / np.bincount(number))[number]
    if not (x * x).sum() > 1e-12:
        raise DefrayError("a power needs a group with two different sizes")

    def slope(rows: np.ndarray) -> np.ndarray:
        spread = (x[rows] ** 2).sum(axis=-1)
        # Where only points of a group's mean size are drawn, nothing is learnt: the power of all points stands.
        whole = (x * y).sum() / (x * x).sum()
        return np.where(spread > 1e-12, (x[rows] * y[rows]).sum(axis=-1) / np.maximum(spread, 1e-12), whole)

    return _bootstrap(len(x), slope, 0.95)


def different_p_value(first: Sequence[float], second: Sequence[float]) -> float:
    """Two-sided p value of the Mann-Whitney U test: small when the two samples differ."""
    from scipy.stats import mannwhitneyu

    return float(mannwhitneyu(_finite(first), _finite(second), alternative="two-sided").pvalue)


def different(first: Sequence[float], second: Sequence[float], alpha: float = 0.05) -> bool:
    """Whether two samples differ by the Mann-Whitney U test.

    With three repetitions each the smallest possible p value is 0.1, so this cannot be true at 0.05: four
    or more are needed.
    """
    return different_p_value(first, second) < alpha


def rate_bound(events: int, trials: int) -> float:
    """Upper end of the one-sided 95 % interval of a rate: 3/N for none of N, else Clopper and Pearson 1934.

    Raises DefrayError for no trials, or more events than trials.
    """
    if not 0 <= events <= trials or trials < 1:
        raise DefrayError(f"{events} of {trials} is not a rate")
    if events == 0:
        return min(3 / trials, 1.0)
    from scipy.stats import beta

    return float(beta.ppf(0.95, events + 1, trials - events)) if events < trials else 1.0


def rates_of(seconds: Sequence[float], rays: int) -> list[float]:
    """Rays per second of each repetition; `seconds` must be above zero."""
    times = _finite(seconds)
    if (times <= 0).any():
        raise DefrayError("a rate needs times above zero")
    return [float(rays / time) for time in times]


def rates(samples: Samples, rays: int, valid: bool = True) -> dict[str, dict[str, float] | None]:
    """The `rate` of a record: for each rated stage `{median, low, high}` in rays per second.

    A stage that the tracer lacks, or that is too short for the device's clock, has no rate (None). A run
    whose check failed has none at all.
    """
    return {stage: _rate(getattr(samples, stage), rays) if valid else None for stage in RATED_STAGES}


def _rate(seconds: Sequence[float], rays: int) -> dict[str, float] | None:
    if len(seconds) == 0 or min(seconds) <= 0:
        return None
    return interval(rates_of(seconds, rays)).as_dict()


def _bootstrap(count: int, statistic: Callable[[np.ndarray], np.ndarray], confidence: float) -> Interval:
    """Percentile bootstrap; `statistic` maps row indices int[..., count] to values [...]."""
    rows = np.random.default_rng(0).integers(0, count, size=(RESAMPLES, count))
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(statistic(rows), [tail, 1.0 - tail])
    return Interval(float(statistic(np.arange(count))), float(low), float(high))


def _finite(values: Sequence[float]) -> np.ndarray:
    sample = np.asarray(values, dtype=np.float64)
    if sample.ndim != 1 or len(sample) == 0 or not np.isfinite(sample).all():
        raise DefrayError("statistics need at least one value, and finite ones")
    return sample
