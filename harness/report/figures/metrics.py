"""Registry of what the accuracy charts measure: unit, direction, worst value and scale of every axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Metric:
    """One axis. `label`: with its unit; `worst`: stands for a value that is absent; an axis is drawn with its better
    end up or to the right."""

    description: str
    unit: str
    better: Literal["higher", "lower"]
    worst: float
    scale: Literal["log", "linear"] = "log"

    @property
    def label(self) -> str:
        """Axis label."""
        return f"{self.description} ({self.unit})" if self.unit else self.description


METRICS = {
    "rate": Metric("whole trace", "million rays per second", "higher", 0.0),
    "leak_rate": Metric("leaks", "share of aimed rays", "lower", 1.0),
    "t_error_p99": Metric("error of t, 99th percentile", "relative", "lower", float("inf")),
    "tests_per_second": Metric("ray/triangle tests", "million per second", "higher", 0.0),
    "band_ulp": Metric("worst band", "local ulp", "lower", float("inf")),
    "residual_p99_ulp": Metric("worst distance from the plane, 99th percentile", "local ulp", "lower", float("inf")),
    "distance_rmse": Metric("error of the hit distance", "RMS, share of the diagonal", "lower", float("inf")),
    "image_rmse": Metric("error of the image", "RMS, 1 = white", "lower", float("inf")),
}


def frontier(x: Sequence[float], y: Sequence[float], x_metric: str, y_metric: str) -> np.ndarray:
    """bool[n]: points that no other point beats: as good in both metrics and better in one.

    A value that is NaN counts as the metric's worst. Equal points are all on the frontier.
    """
    first, second = (_goodness(values, METRICS[name]) for values, name in ((x, x_metric), (y, y_metric)))
    as_good = (first[:, None] >= first) & (second[:, None] >= second)
    better = (first[:, None] > first) | (second[:, None] > second)
    return ~(as_good & better).any(axis=0)


def _goodness(values: Sequence[float], metric: Metric) -> np.ndarray:
    """float64[n], larger is better."""
    found = np.asarray(values, np.float64)
    found = np.where(np.isnan(found), metric.worst, found)
    return found if metric.better == "higher" else -found
