"""What space is cut into; each structure builds itself and hands kernels its arguments."""

from __future__ import annotations

from harness.errors import known
from harness.spec.structure import OVERLAPS, GridSpec, check_grid
from harness.structures.adaptive import build_adaptive
from harness.structures.base import DeviceScene, Grid
from harness.structures.uniform import build_uniform


def build_grid(scene: DeviceScene, spec: GridSpec, binning: str = "padded") -> Grid:
    """Build the grid; raises DefrayError for a bad resolution or one that needs too much memory.

    `binning`: "padded", the default, is a closed separating-axis test with cells grown by PAD_ULP; "closed" the
    same without, "open" with strict inequalities, "box" the bounding box rounded down. Only the first loses no ray.
    """
    if binning not in OVERLAPS:
        raise known("binning", binning, OVERLAPS)
    check_grid(spec)
    if spec.reading == "adaptive":
        return build_adaptive(scene, spec, binning)
    return build_uniform(scene, spec, binning)
