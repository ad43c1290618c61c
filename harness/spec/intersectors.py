"""Registry of ray/triangle intersectors: one `.cl` file and one line each."""

from __future__ import annotations

from dataclasses import dataclass

from harness.errors import known
from harness.files import ROOT

LANES = (1, 4, 8, 16)
DEFAULT = "ray-space"  # what a tracer uses where none is named


@dataclass(frozen=True)
class Intersector:
    """A ray/triangle test. `file` lies in kernels/intersect/; `cite` names the paper in its header.

    `flops`: to accept or reject, without setup and without what only a hit computes. `precomputes`: it stores 12
    floats a triangle instead of its vertices. `needs_double`: it cannot run without double precision.
    """

    name: str
    file: str
    watertight: bool
    cite: str
    flops: int = 0
    precomputes: bool = False
    needs_double: bool = False

    @property
    def bytes(self) -> int:
        """Bytes read of one triangle."""
        return 48 if self.precomputes else 36


_WBW = "Woop, Benthin & Wald 2013"
INTERSECTORS = {
    entry.name: entry
    for entry in (
        Intersector("ray-space", "ray_space.cl", True, "Ellis, Shaffer & Hart", 39),
        Intersector("ray-space-orthonormal", "ray_space_orthonormal.cl", True, "Ellis, Shaffer & Hart", 57),
        Intersector("ray-space-plain", "ray_space_plain.cl", False, "Ellis, Shaffer & Hart", 48),
        Intersector("ray-space-folded", "ray_space_folded.cl", False, "Ellis, Shaffer & Hart", 45),
        Intersector("moller-trumbore", "moller_trumbore.cl", False, "Möller & Trumbore 1997", 45),
        Intersector("moller-trumbore-epsilon", "moller_trumbore_epsilon.cl", False, "Möller & Trumbore 1997", 45),
        Intersector(
            "moller-trumbore-double",
            "moller_trumbore_double.cl",
            False,
            "Möller & Trumbore 1997",
            45,
            needs_double=True,
        ),
        Intersector("woop-benthin-wald", "woop_benthin_wald.cl", False, _WBW, 32, needs_double=True),
        Intersector("woop-benthin-wald-kahan", "woop_benthin_wald_kahan.cl", True, _WBW, 41),
        Intersector("woop-benthin-wald-double", "woop_benthin_wald_double.cl", False, _WBW, 32, needs_double=True),
        Intersector("pbrt", "pbrt.cl", False, "Pharr, Jakob & Humphreys 2023", 70, needs_double=True),
        Intersector("plucker", "plucker.cl", False, "Davis & Wald", 72),
        Intersector("plucker-zero", "plucker_zero.cl", False, "Davis & Wald", 71),
        Intersector("kensler-shirley", "kensler_shirley.cl", False, "Kensler & Shirley 2006", 51),
        Intersector("baldwin-weber", "baldwin_weber.cl", False, "Baldwin & Weber 2016", 30, precomputes=True),
        Intersector("woop-unit-triangle", "woop_unit_triangle.cl", False, "Woop 2004", 38, precomputes=True),
        Intersector("havel-herout", "havel_herout.cl", False, "Havel & Herout 2010", 37, precomputes=True),
    )
}


def find(name: str) -> Intersector:
    """The intersector called `name`; raises DefrayError listing the known ones."""
    if name not in INTERSECTORS:
        raise known("intersector", name, INTERSECTORS)
    return INTERSECTORS[name]


KERNELS = ROOT / "kernels"
