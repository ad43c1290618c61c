"""From how many rays on a structure that takes longer to build is ahead, because each ray takes less time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from harness.errors import DefrayError


@dataclass(frozen=True)
class Cost:
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


def rays_to_break_even(ours: Cost, theirs: Cost) -> float:
    """Rays from which on ours is no slower, builds included: 0 where it always is, infinite where it never is.

    A structure that is built sooner but traces more slowly is ahead for few rays only: infinite as well.
    """
    saved = 1 / theirs.rays_per_second - 1 / ours.rays_per_second
    later = ours.build_seconds - theirs.build_seconds
    if saved < 0 or (saved == 0 and later > 0):
        return math.inf
    return max(later, 0.0) / saved if later > 0 else 0.0
