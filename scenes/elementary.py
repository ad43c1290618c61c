"""Sine, cosine, power and random numbers with the same bits on every machine.

Built from + - * / and the square root alone, which IEEE arithmetic rounds alike everywhere; a machine's own sine
or matrix product may differ in the last bit. Every function takes and returns float64 arrays of any shape; errors
are a few units in the last place for arguments below about 1e5.
"""

from __future__ import annotations

import numpy as np

PI = 3.141592653589793
TURN = 2 * PI
# pi/2 in three parts, of which the first two have zeros at the end, so that small multiples are exact.
_HALF_PI = (1.5707963109016418, 1.5893254712295857e-08, 6.123233995736766e-17)
_LN2 = (0.6931471803691238, 1.9082149292705877e-10)


def _series(z: np.ndarray, denominators: list[float]) -> np.ndarray:
    """1 + z/d0 (1 + z/d1 (1 + ...)), innermost first."""
    total = np.ones_like(z)
    for denominator in reversed(denominators):
        total = 1 + z * total / denominator
    return total


def _sin_cos(angle) -> tuple[np.ndarray, np.ndarray]:
    angle = np.asarray(angle, np.float64)
    quarter = np.rint(angle * (2 / PI))
    r = ((angle - quarter * _HALF_PI[0]) - quarter * _HALF_PI[1]) - quarter * _HALF_PI[2]
    square = -r * r
    s = r * _series(square, [(2 * k) * (2 * k + 1) for k in range(1, 9)])
    c = _series(square, [(2 * k - 1) * (2 * k) for k in range(1, 9)])
    turn = quarter.astype(np.int64) & 3
    sine = np.choose(turn, [s, c, -s, -c])
    cosine = np.choose(turn, [c, -s, -c, s])
    return sine, cosine


def sin(angle) -> np.ndarray:
    """Sine of radians."""
    return _sin_cos(angle)[0]


def cos(angle) -> np.ndarray:
    """Cosine of radians."""
    return _sin_cos(angle)[1]


def arctan2(y, x) -> np.ndarray:
    """The angle of (x, y) in [-pi, pi]; 0 for (0, 0)."""
    y, x = np.broadcast_arrays(np.asarray(y, np.float64), np.asarray(x, np.float64))
    length = np.sqrt(x * x + y * y)
    safe = np.where(length == 0, 1.0, length)
    c, s = np.where(length == 0, 1.0, x / safe), y / safe
    part = np.abs(s) / (np.abs(c) + np.abs(s))
    guess = np.where(c < 0, 2 - part, part) * (PI / 2)
    guess = np.where(s < 0, -guess, guess)
    for _ in range(3):  # each step cubes the error, at first at most 0.08
        sine, cosine = _sin_cos(guess)
        guess = guess + (s * cosine - c * sine)
    return guess


def exp(x) -> np.ndarray:
    """e to the power of x, which lies in -700..700."""
    x = np.asarray(x, np.float64)
    n = np.rint(x / (_LN2[0] + _LN2[1]))
    r = (x - n * _LN2[0]) - n * _LN2[1]
    return np.ldexp(_series(r, list(range(1, 15))), n.astype(np.int64))


def log(x) -> np.ndarray:
    """Natural logarithm of positive numbers."""
    mantissa, exponent = np.frexp(np.asarray(x, np.float64))
    small = mantissa < 0.7071067811865476
    mantissa, exponent = np.where(small, 2 * mantissa, mantissa), exponent - small
    s = (mantissa - 1) / (mantissa + 1)
    total = np.zeros_like(s)
    for k in range(23, 0, -2):
        total = 1 / k + s * s * total
    return exponent * (_LN2[0] + _LN2[1]) + 2 * s * total


def power(base, exponent) -> np.ndarray:
    """A number that is not negative to a positive power."""
    base = np.asarray(base, np.float64)
    positive = np.where(base > 0, base, 1.0)
    return np.where(base > 0, exp(exponent * log(positive)), 0.0)


def between(random: np.random.Generator, low, high, size=None) -> np.ndarray:
    """Uniform random numbers in [low, high)."""
    return low + (np.asarray(high) - low) * random.random(size)


def steps(start: float, stop: float, step: float) -> np.ndarray:
    """float64[n]: start, start + step, ... below stop."""
    return start + step * np.arange(int(np.ceil((stop - start) / step)))


def directions(random: np.random.Generator, count: int) -> np.ndarray:
    """Uniform random directions float64[count,3]."""
    height, angle = 2 * random.random(count) - 1, TURN * random.random(count)
    sine, cosine = _sin_cos(angle)
    radius = np.sqrt(1 - height * height)
    return np.stack([radius * cosine, height, radius * sine], axis=1)
