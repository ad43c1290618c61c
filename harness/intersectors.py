"""Registry of ray/triangle intersectors: one `.cl` file and one line each."""

from __future__ import annotations

from dataclasses import dataclass

from harness.errors import known

LANES = (1, 4, 8, 16)


@dataclass(frozen=True)
class Intersector:
    """A ray/triangle test. `file` lies in kernels/intersect/; `cite` names the paper in its header."""

    name: str
    file: str
    watertight: bool
    cite: str


INTERSECTORS = {
    entry.name: entry
    for entry in (
        Intersector("ray-space", "ray_space.cl", watertight=True, cite="Ellis, Shaffer & Hart"),
        Intersector("moller-trumbore", "moller_trumbore.cl", watertight=False, cite="Möller & Trumbore 1997"),
    )
}


def find(name: str) -> Intersector:
    """The intersector called `name`; raises DefrayError listing the known ones."""
    if name not in INTERSECTORS:
        raise known("intersector", name, INTERSECTORS)
    return INTERSECTORS[name]
