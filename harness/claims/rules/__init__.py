"""Types of rules, one file each: a new type is a new file with a class `Rule`.

A `Rule` is the data of one entry in claims.toml. Its `type` is the file's name, its `judge(evidence)` an Outcome.
"""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import dataclass
from typing import Annotated, Union

from pydantic import Field

from harness.analysis.results import Results


@dataclass(frozen=True)
class Evidence:
    """What rules judge by: the runs of a folder, and the scenes that the paper measured."""

    runs: Results
    scenes: tuple[str, ...]


def rule_types() -> list[type]:
    """The class of every rule type."""
    names = sorted(entry.name for entry in pkgutil.iter_modules(__path__))
    return [importlib.import_module(f"{__name__}.{name}").Rule for name in names]


def any_rule():
    """The type of a rule of any kind, told apart by `type`."""
    return Annotated[Union[tuple(rule_types())], Field(discriminator="type")]  # noqa: UP007
