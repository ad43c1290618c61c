"""Statistics of repeated timings, and the only place where rates are computed."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ConfigDict
from scipy.optimize import least_squares
from scipy.stats import beta, mannwhitneyu, t

from harness.data import STRICT, Samples
from harness.errors import DefrayError


@dataclass(frozen=True)
class BuildAndRate:
    """Seconds to build a grid or a hierarchy, and the rays traced a second once it is there."""

    build_seconds: float
    rays_per_second: float

    def __post_init__(self):
        if not (self.build_seconds >= 0 and self.rays_per_second > 0):
            raise DefrayError(
                f"a break-even needs a build of 0 s or more and a rate above 0, not {self.build_seconds} s and "
                f"{self.rays_per_second} rays a second"
            )

    def seconds(self, rays: float) -> float:
        """To build and to trace that many rays."""
        return self.build_seconds + rays / self.rays_per_second


def rays_to_break_even(ours: BuildAndRate, theirs: BuildAndRate) -> float:
    """Rays from which on ours is no slower, builds included: 0 where it always is, infinite where it never is.

    A structure that is built sooner but traces more slowly is ahead for few rays only: infinite as well.
    """
    saved = 1 / theirs.rays_per_second - 1 / ours.rays_per_second
    later = ours.build_seconds - theirs.build_seconds
    if saved < 0 or (saved == 0 and later > 0):
        return math.inf
    return max(later, 0.0) / saved if later > 0 else 0.0


RESAMPLES = 9999
RATED_STAGES = ("traverse", "intersect", "total")


@dataclass(frozen=True)
class Interval:
    """A median with its 95 % confidence interval, in the unit of the values it was computed from.

    Rows on file hold it as it is.
    """

    __pydantic_config__ = ConfigDict(**STRICT, strict=False)  # strict, it would not be read from JSON's objects

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


def quotient(rates: Sequence[float], base_rates: Sequence[float], confidence: float = 0.95) -> Interval:
    """Median of `rates` over median of `base_rates`, from runs that were not measured together.

    Each side is resampled by itself, so the interval is wider than that of `ratio`. Fewer than three values on either
    side cannot be resampled: the interval is then that of the extremes. Raises DefrayError for base rates not above
    zero.
    """
    sample, base = _finite(rates), _finite(base_rates)
    if (base <= 0).any():
        raise DefrayError("a ratio needs base rates above zero")
    middle = float(np.median(sample) / np.median(base))
    if min(len(sample), len(base)) < 3:
        return Interval(middle, float(sample.min() / base.max()), float(sample.max() / base.min()))
    generator = np.random.default_rng(0)
    over, under = (
        np.median(values[generator.integers(0, len(values), (RESAMPLES, len(values)))], axis=-1)
        for values in (sample, base)
    )
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(over / under, [tail, 1.0 - tail])
    return Interval(middle, float(low), float(high))


def geometric_mean(
    pairs: Sequence[tuple[Sequence[float], Sequence[float]]],
    together: Sequence[bool] | None = None,
    confidence: float = 0.95,
) -> Interval:
    """Geometric mean over scenes of median rate over median base rate, each pair being one scene's repetitions.

    Repetitions are resampled within each scene: as `ratio` does where both sides were measured `together`, in turns
    (by default where they have as many), else as `quotient` does. The scenes themselves are fixed, so the interval
    speaks of these scenes and of no others.
    """
    if not len(pairs):
        raise DefrayError("a mean over scenes needs a scene")
    logs, generator = [], np.random.default_rng(0)
    if together is None:
        together = [len(rates) == len(base_rates) for rates, base_rates in pairs]
    for (rates, base_rates), paired in zip(pairs, together, strict=True):
        sample, base = _finite(rates), _finite(base_rates)
        if min(sample.min(), base.min()) <= 0:
            raise DefrayError("a ratio needs rates above zero")
        rows = generator.integers(0, len(sample), (RESAMPLES, len(sample)))
        base_rows = rows if paired else generator.integers(0, len(base), (RESAMPLES, len(base)))
        logs.append(
            (
                np.log(np.median(sample) / np.median(base)),
                np.log(np.median(sample[rows], axis=-1) / np.median(base[base_rows], axis=-1)),
            )
        )
    tail = (1.0 - confidence) / 2.0
    low, high = np.quantile(np.mean([drawn for _, drawn in logs], axis=0), [tail, 1.0 - tail])
    return Interval(*(float(np.exp(value)) for value in (np.mean([whole for whole, _ in logs]), low, high)))


def exponent(sizes: Sequence[float], values: Sequence[float], groups: Sequence[str]) -> Interval:
    """The power p of `values` proportional to `sizes` ** p, with a factor of its own for each group.

    Least squares through the logarithms, taken from their mean in each group; the 95 % interval is Student's, which
    tells how well one power describes these points, not the noise of a timing. Raises DefrayError where a number is
    not positive, no group has two different sizes, or no more points are there than a power takes.
    """
    x, y = _finite(sizes), _finite(values)
    if len(x) != len(y) or len(x) != len(groups) or min(x.min(), y.min()) <= 0:
        raise DefrayError("a power needs as many sizes above zero as values above zero and groups")
    x, y = np.log(x), np.log(y)
    _, number = np.unique(np.asarray(groups), return_inverse=True)
    for column in (x, y):
        column -= (np.bincount(number, weights=column) / np.bincount(number))[number]
    spread = (x * x).sum()
    if not spread > 1e-12:
        raise DefrayError("a power needs a group with two different sizes")
    freedom = len(x) - (number.max() + 1) - 1
    if freedom < 1:
        raise DefrayError("a power's interval needs more points than groups and one")
    slope = float((x * y).sum() / spread)
    rest = y - slope * x
    half = float(t.ppf(0.975, freedom) * np.sqrt((rest * rest).sum() / freedom / spread))
    return Interval(slope, slope - half, slope + half)


@dataclass(frozen=True)
class Fit:
    """A curve through points, fitted by least squares of the logarithms: errors count by their share of a value.

    `model`: "constant" (a), "linear" (a + b x) or "power" (a x^b); `aicc` is infinite where the points are too few.
    """

    model: str
    parameters: tuple[float, ...]
    aicc: float
    freedom: int
    _covariance: np.ndarray
    _unit: float  # sizes are fitted in this unit

    def at(self, sizes: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """float64[n] three times: the curve, and the ends of its 95 % interval (Student, linearised)."""
        x = _finite(sizes) / self._unit
        logs = _log_model(self.model, self.parameters, x)
        slopes = _log_slopes(self.model, self.parameters, x)
        half = t.ppf(0.975, self.freedom) * np.sqrt(np.einsum("ni,ij,nj->n", slopes, self._covariance, slopes))
        return np.exp(logs), np.exp(logs - half), np.exp(logs + half)

    def parameter(self, index: int) -> Interval:
        """A parameter with its 95 % interval; b of a power is its exponent, other sizes are in the fit's unit."""
        value = self.parameters[index]
        half = float(t.ppf(0.975, self.freedom) * np.sqrt(self._covariance[index, index]))
        return Interval(value, value - half, value + half)


MODELS = ("constant", "linear", "power")


def fits(sizes: Sequence[float], values: Sequence[float]) -> list[Fit]:
    """Constant, line and power law through the points that have fewer parameters than points, least AICc first.

    AICc (Hurvich & Tsai 1989) counts the scatter among the parameters. With four points a curve of two parameters has
    an infinite one, and the constant is chosen: so few points show no trend. Raises DefrayError for fewer than three
    points or a number that is not positive.
    """
    x, y = _finite(sizes), _finite(values)
    if len(x) != len(y) or len(x) < 3 or min(x.min(), y.min()) <= 0:
        raise DefrayError("a fit needs three or more sizes above zero, and as many values above zero")
    unit = float(np.exp(np.log(x).mean()))
    found = [_fit(model, x / unit, y, unit) for model in MODELS]
    return sorted(found, key=lambda fit: (fit.aicc, MODELS.index(fit.model)))


def _fit(model: str, x: np.ndarray, y: np.ndarray, unit: float) -> Fit:
    """One model through points; x about 1."""
    middle = float(np.exp(np.log(y).mean()))
    start = {"constant": (middle,), "linear": (middle / 2, middle / 2), "power": (middle, 0.5)}[model]
    floor = {"constant": (0,), "linear": (0, 0), "power": (0, -np.inf)}[model]
    solved = least_squares(
        lambda p: _log_model(model, p, x) - np.log(y),
        start,
        bounds=(floor, np.inf),
        x_scale=np.abs(start),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    parameters = tuple(map(float, solved.x))
    count, freedom = len(start) + 1, len(x) - len(start)
    squares = max(float((solved.fun**2).sum()), len(x) * 1e-24)
    aicc = np.inf
    if len(x) > count + 1:
        aicc = len(x) * np.log(squares / len(x)) + 2 * count + 2 * count * (count + 1) / (len(x) - count - 1)
    slopes = _log_slopes(model, parameters, x)
    scatter = squares / freedom
    return Fit(model, parameters, float(aicc), freedom, scatter * np.linalg.pinv(slopes.T @ slopes), unit)


def _log_model(model: str, parameters: Sequence[float], x: np.ndarray) -> np.ndarray:
    """Logarithm of a model's values at x."""
    first = max(parameters[0], 1e-300)
    if model == "constant":
        return np.full(len(x), np.log(first))
    if model == "linear":
        return np.log(np.maximum(parameters[0] + parameters[1] * x, 1e-300))
    return np.log(first) + parameters[1] * np.log(x)


def _log_slopes(model: str, parameters: Sequence[float], x: np.ndarray) -> np.ndarray:
    """float64[n, parameters]: derivatives of `_log_model`."""
    if model == "constant":
        return np.full((len(x), 1), 1 / parameters[0])
    if model == "linear":
        value = parameters[0] + parameters[1] * x
        return np.stack([1 / value, x / value], axis=1)
    return np.stack([np.full(len(x), 1 / parameters[0]), np.log(x)], axis=1)


def different_p_value(first: Sequence[float], second: Sequence[float]) -> float:
    """Two-sided p value of the Mann-Whitney U test: small when the two samples differ.

    With three repetitions each it cannot be below 0.1, with four not below 0.028.
    """
    return float(mannwhitneyu(_finite(first), _finite(second), alternative="two-sided").pvalue)


def rate_bound(events: int, trials: int) -> float:
    """Upper end of the one-sided 95 % interval of a rate: 3/N for none of N, else Clopper and Pearson 1934.

    Raises DefrayError for no trials, or more events than trials.
    """
    if not 0 <= events <= trials or trials < 1:
        raise DefrayError(f"{events} of {trials} is not a rate")
    if events == 0:
        return min(3 / trials, 1.0)
    return float(beta.ppf(0.95, events + 1, trials - events)) if events < trials else 1.0


def rates_of(seconds: Sequence[float], rays: int) -> list[float]:
    """Rays per second of each repetition; `seconds` must be above zero."""
    times = _finite(seconds)
    if (times <= 0).any():
        raise DefrayError("a rate needs times above zero")
    return [float(rays / time) for time in times]


def rates(samples: Samples, rays: int, valid: bool = True) -> dict[str, Interval | None]:
    """The rate of each rated stage, in rays per second.

    A stage that the tracer lacks, or that is too short for the device's clock, has no rate (None). A run
    whose check failed has none at all.
    """
    return {stage: _rate(getattr(samples, stage), rays) if valid else None for stage in RATED_STAGES}


def megarays(rate: float | None) -> float:
    """Rays per second as millions a second; NaN for none."""
    return math.nan if rate is None else float(rate) / 1e6


def _rate(seconds: Sequence[float], rays: int) -> Interval | None:
    if len(seconds) == 0 or min(seconds) <= 0:
        return None
    return interval(rates_of(seconds, rays))


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


def interleaved(entries: Sequence, repetitions: int, seed: int) -> Iterator[tuple[int, float, Any]]:
    """`(turn, share, entry)` for every repetition of every entry, each turn in a random order of its own.

    `share`: the part of the turn that is done, in [0, 1). Drifts of the machine so fall on all entries alike.
    """
    generator = random.Random(seed)
    for turn in range(repetitions):
        order = generator.sample(list(entries), len(entries))
        for place, entry in enumerate(order):
            yield turn, place / len(order), entry
