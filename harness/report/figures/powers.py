"""Powers fitted to a figure's numbers, as columns beside them and as text: what charts over sizes share."""

from __future__ import annotations

import pandas as pd

from harness.errors import DefrayError
from harness.stats import exponent


def with_power(numbers: pd.DataFrame, by: str, x: str, y: str, column: str, least: float = 0.0) -> pd.DataFrame:
    """`numbers` with the power of `x` that `y` goes as, a factor a scene, fitted apart for each value of `by`.

    The power and the ends of its 95 % interval stand in `column`, `column`_low and `column`_high of every row of the
    group; rows whose `x` is under `least` or whose `y` is missing do not count, and a single `x` has no power.
    """
    numbers = numbers.copy()
    for group, rows in numbers[numbers[x] >= least].dropna(subset=[y]).groupby(by, sort=False):
        try:
            fit = exponent(rows[x], rows[y], list(rows["scene"]))
        except DefrayError:  # a single value of x is left
            continue
        for end, value in (("", fit.median), ("_low", fit.low), ("_high", fit.high)):
            numbers.loc[numbers[by] == group, f"{column}{end}"] = value
    return numbers


def power_text(row: pd.Series, column: str) -> str:
    """A power with its interval, `−0.41 (−0.52 to −0.31)`."""
    return f"{row[column]:.2f} ({row[f'{column}_low']:.2f} to {row[f'{column}_high']:.2f})".replace("-", "−")
