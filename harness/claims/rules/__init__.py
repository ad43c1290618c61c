"""Types of rules, one file each: a new type is a new file `NAME_rule.py` with a class `Rule`, as all of them call it.

A `Rule` is the data of one entry in claims.toml, which names it by the literal that its field `type` states. Its
`judge(evidence)` is an Outcome.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Annotated, Union

from pydantic import Field


def rule_types() -> list[type]:
    """The class of every rule type."""
    names = sorted(entry.name for entry in pkgutil.iter_modules(__path__))
    return [importlib.import_module(f"{__name__}.{name}").Rule for name in names]


def any_rule():
    """The type of a rule of any kind, told apart by `type`."""
    return Annotated[Union[tuple(rule_types())], Field(discriminator="type")]  # noqa: UP007
