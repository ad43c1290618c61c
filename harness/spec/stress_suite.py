"""The suite's families, read from stress_suite.toml and validated."""

from __future__ import annotations

import functools
import tomllib
from pathlib import Path
from typing import Literal

from pydantic import Field

from harness.data import Strict
from harness.errors import DefrayError, known

SUITE = Path(__file__).with_name("stress_suite.toml")
METRICS = (
    "leaks",
    "double_hits",
    "band_ulp",
    "residual_p99_ulp",
    "gross",
    "nonfinite",
    "self_hits",
    "tunnels",
)
PER_MILLION = ("leaks", "double_hits", "self_hits", "tunnels")  # limits of these are rates, of the others counts


class Family(Strict, frozen=True):
    """One family of inputs; see stress_suite.toml for what the fields mean."""

    id: str
    title: str
    kind: Literal["aimed", "verify", "single", "scene", "walk", "grid", "offset"]
    cases: tuple[dict, ...] = Field(min_length=1)
    rays: dict[Literal["full", "smoke"], int]
    limits: dict[Literal[METRICS], float]
    sha256: dict[Literal["full", "smoke"], str] = Field(default_factory=dict)
    seed: int = 0

    def passes(self, metrics: dict) -> bool:
        """Whether measured `metrics` (counts and ulp; None where one does not apply) meet every limit.

        Raises KeyError for a limit that was not measured, so that none passes unseen.
        """
        rays = metrics["rays"]
        for name, limit in self.limits.items():
            value = metrics[name]
            if value is None:
                raise KeyError(f"family {self.id} limits {name}, which it does not measure")
            allowed = limit * rays / 1e6 if name in PER_MILLION else limit
            if not value <= allowed:
                return False
        return True


@functools.cache
def families() -> dict[str, Family]:
    """All families by id, in the order of the file."""
    data = tomllib.loads(SUITE.read_text())
    found = [Family(**entry, seed=data["seed"]) for entry in data["family"]]
    return {family.id: family for family in found}


def select(pattern: str | None) -> list[Family]:
    """Families whose id is `pattern` or begins with it; all without one. Raises DefrayError where none does."""
    if pattern is None:
        return list(families().values())
    wanted = pattern.upper()
    exact = [family for family in families().values() if family.id == wanted]
    chosen = exact or [family for family in families().values() if family.id.startswith(wanted)]
    if not chosen or not wanted:
        raise known("family", pattern, families())
    return chosen


def size_of(name: str) -> str:
    """`full` or `smoke`; raises DefrayError for another."""
    if name not in ("full", "smoke"):
        raise DefrayError(f"--size is full or smoke, not '{name}'")
    return name
