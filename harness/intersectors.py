"""Registry of ray/triangle intersectors: one `.cl` file and one line each."""

from __future__ import annotations

from dataclasses import dataclass

from harness.errors import known

LANES = (1, 4, 8, 16)


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


INTERSECTORS = {
    entry.name: entry
    for entry in (
        Intersector("ray-space", "ray_space.cl", True, "Ellis, Shaffer & Hart", 66),
        Intersector("moller-trumbore", "moller_trumbore.cl", False, "Möller & Trumbore 1997", 50),
        Intersector("moller-trumbore-epsilon", "moller_trumbore_epsilon.cl", False, "Möller & Trumbore 1997", 50),
    )
}


def find(name: str) -> Intersector:
    """The intersector called `name`; raises DefrayError listing the known ones."""
    if name not in INTERSECTORS:
        raise known("intersector", name, INTERSECTORS)
    return INTERSECTORS[name]
