"""What an intersector's answers to pairs are worth, against exact arithmetic."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import trimesh

from harness.reference.exact import Measure, measure
from harness.reference.exact_pairs import exact_pairs
from harness.spec.stress_suite import METRICS
from harness.studies.stability.pairs import Answers, Pairs

GROSS_ULP = 1024.0  # misjudged by more than this is no rounding
BESIDE_ULP = 16.0  # a hit of a coplanar ray this far from its triangle is a hit on nothing
_CHUNK = 1 << 17


@dataclass(eq=False)
class Judge:
    """The truth about pairs, found once and used for every intersector."""

    pairs: Pairs
    kind: str  # aimed, single, coplanar or broken

    @functools.cached_property
    def truth(self) -> np.ndarray:
        """bool[m]: whether each pair truly hits."""
        p, found = self.pairs, np.empty(len(self.pairs), bool)
        for first in range(0, len(p), _CHUNK):
            rows = slice(first, first + _CHUNK)
            ray, triangle = p.ray[rows], p.triangle[rows]
            found[rows] = exact_pairs(p.triangles[triangle], p.rays.origins[ray], p.rays.directions[ray])
        return found

    @functools.cached_property
    def measure(self) -> Measure:
        """How each pair's ray lies to its triangle."""
        p = self.pairs
        rays = p.rays[p.ray]
        return measure(p.triangles[p.triangle], rays.origins, rays.directions, rays.t_max)

    def judge(self, answers: Answers) -> dict:
        """Counts and ulp by metric, None where one does not apply: `rays` and METRICS."""
        result = {"rays": len(self.pairs.rays), **dict.fromkeys(METRICS)}
        result["nonfinite"] = int((answers.accepted & ~np.isfinite(answers.t)).sum())
        return result | getattr(self, f"_{self.kind}")(answers)

    def _aimed(self, answers: Answers) -> dict:
        rays = len(self.pairs.rays)
        claimed = np.bincount(self.pairs.ray, answers.accepted, rays).astype(np.int32)
        true = np.bincount(self.pairs.ray, self.truth, rays).astype(np.int32)
        return {
            "leaks": int(((true > 0) & (claimed == 0)).sum()),
            "double_hits": int(((claimed > 1) & (claimed > true)).sum()),
        }

    def _single(self, answers: Answers) -> dict:
        wrong = answers.accepted != self.truth
        with np.errstate(invalid="ignore"):
            off = np.abs(self.measure.margin)
            residual = self.measure.residual(answers.t.astype(np.float64))
        right = answers.accepted & self.truth
        gross = (wrong & ~(off <= GROSS_ULP)) | (right & ~(residual <= GROSS_ULP))
        return {
            "band_ulp": _finite(off[wrong].max()) if wrong.any() else 0.0,
            "residual_p99_ulp": _finite(np.percentile(residual[right], 99)) if right.any() else None,
            "gross": int(gross.sum()),
        }

    def _coplanar(self, answers: Answers) -> dict:
        """A coplanar ray exactly hits nothing; a hit reported all the same must at least lie on its triangle."""
        hit = np.flatnonzero(answers.accepted)
        if not len(hit):
            return {"band_ulp": 0.0, "gross": 0}
        p = self.pairs
        ray = p.rays[p.ray[hit]]
        points = ray.origins.astype(np.float64) + answers.t[hit, None].astype(np.float64) * ray.directions
        triangles = p.triangles[p.triangle[hit]].astype(np.float64)
        beside = np.linalg.norm(trimesh.triangles.closest_point(triangles, points) - points, axis=1)
        beside /= 2.0**-24 * np.linalg.norm(triangles - ray.origins[:, None], axis=2).max(axis=1)
        return {"band_ulp": _finite(beside.max()), "gross": int((~(beside <= BESIDE_ULP)).sum())}

    def _broken(self, answers: Answers) -> dict:
        return {"gross": int(answers.accepted.sum())}


def _finite(value) -> float:
    """A number that JSON can hold: 2^40 stands for anything beyond."""
    return float(min(value, 2.0**40)) if value == value else 2.0**40


def merge(parts: list[dict]) -> dict:
    """The metrics of a family from those of its cases: counts added, the worst ulp."""
    result = {"rays": sum(part["rays"] for part in parts)}
    for name in METRICS:
        values = [part[name] for part in parts if part[name] is not None]
        add = max if name.endswith("_ulp") else sum
        result[name] = add(values) if values else None
    return result
