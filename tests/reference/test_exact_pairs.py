"""Exact hits of many pairs at once, against rationals: random, on ties, degenerate."""

from __future__ import annotations

import numpy as np
import pytest

from harness.reference import exact_pairs as exact_signs
from harness.reference.exact import exact_hit
from harness.reference.exact_pairs import exact_pairs


def by_rationals(triangles, origins, directions):
    return np.array(
        [exact_hit(*row, np.float32(np.inf)) is not None for row in zip(triangles, origins, directions, strict=True)]
    )


def pairs(count, seed, scale=1.0, step=None):
    generator = np.random.default_rng(seed)
    triangles = generator.normal(size=(count, 3, 3)) * scale
    origins = generator.normal(size=(count, 3)) * scale
    if step:
        triangles, origins = np.round(triangles / step) * step, np.round(origins / step) * step
    triangles, origins = triangles.astype(np.float32), origins.astype(np.float32)
    weights = generator.integers(0, 3, (count, 3, 1))
    weights[weights.sum(axis=(1, 2)) == 0] = 1
    aim = (triangles * weights).sum(axis=1) / weights.sum(axis=1)
    return triangles, origins, (aim - origins).astype(np.float32)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e9])
def test_agrees_with_rationals_on_rays_aimed_at_corners_edges_and_centres(scale):
    inputs = pairs(3000, 1, scale)
    expected = by_rationals(*inputs)
    assert (exact_pairs(*inputs) == expected).all() and 0.2 < expected.mean() < 0.95


def test_agrees_with_rationals_on_exact_ties():
    inputs = pairs(3000, 2, step=2.0**-6)
    assert (exact_pairs(*inputs) == by_rationals(*inputs)).all()


def test_ties_of_lattice_points_are_settled_in_64_bit_integers(monkeypatch):
    monkeypatch.setattr(exact_signs, "exact_hit", None)
    triangles = np.array([[[0, 0, 0], [4, 0, 0], [0, 4, 0]]] * 3, np.float32)
    origins = np.array([[2, 0, 1], [4, 4, 1], [2, 2, -1]], np.float32)
    directions = np.array([[0, 0, -1], [0, 0, -1], [0, 0, -1]], np.float32)
    assert exact_pairs(triangles, origins, directions).tolist() == [True, False, False]


def test_coplanar_rays_points_lines_and_nan_never_hit():
    triangle = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0]], np.float32)
    point, line = np.zeros_like(triangle), np.array([[0, 0, 0], [1, 1, 0], [2, 2, 0]], np.float32)
    broken = triangle * np.float32(np.nan)
    triangles = np.stack([triangle, point, line, broken])
    origins = np.array([[-1, 1, 0], [0, 0, 1], [1, 1, 1], [1, 1, 1]], np.float32)
    directions = np.array([[1, 0, 0], [0, 0, -1], [0, 0, -1], [0, 0, -1]], np.float32)
    assert not exact_pairs(triangles, origins, directions).any()


def test_a_ray_through_an_edge_whose_float64_sign_is_rounding_is_decided():
    """An edge crossed within 2^-60 of the ray: far below what float64 resolves."""
    e = np.float32(2.0**-60)
    triangles = np.array([[[0, -e, 0], [1, -e, 0], [0, 1, 0]], [[0, e, 0], [1, e, 0], [0, 1, 0]]], np.float32)
    origins = np.array([[0.25, 0, 1]] * 2, np.float32)
    directions = np.array([[0, 0, -1]] * 2, np.float32)
    assert exact_pairs(triangles, origins, directions).tolist() == [True, False]
