"""Claims as harness/paper/claims.toml has them."""

from __future__ import annotations

import tomllib
from collections import Counter
from functools import lru_cache
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError, create_model, model_validator

from harness.claims.rules import any_rule
from harness.data import Strict
from harness.errors import DefrayError, first_problem
from harness.files import ROOT

FILE = ROOT / "harness" / "paper" / "claims.toml"


class _Claim(Strict):
    """One claim: the paper's `words` at `place`, `reading` (how they became the rules), and what measures them."""

    id: str = Field(pattern=r"^[a-z0-9-]+$")
    title: str
    words: str = Field(min_length=1)
    place: str = Field(min_length=1)
    kind: Literal["ordering", "ratio", "trend", "count", "absolute"]
    reading: str = Field(min_length=1)
    tier: Literal["smoke", "paper", "full"]
    minutes: float = Field(ge=0)
    command: str = ""

    @model_validator(mode="after")
    def _measured_by_the_tier(self) -> _Claim:
        """Without a command of its own, the tier measures what the rules need."""
        self.command = self.command or f"make reproduce TIER={self.tier}"
        return self


# The types of rules are found by listing their folder, so the field is added here.
Claim = create_model("Claim", __base__=_Claim, rule=(list[any_rule()], Field(min_length=1)))


class _File(Strict):
    scenes: list[str] = Field(min_length=1)
    claim: list[Claim]


@lru_cache(maxsize=4)
def read_claims(path: Path = FILE) -> tuple[tuple[str, ...], tuple[Claim, ...]]:
    """The paper's scenes and its claims; raises DefrayError naming the first thing wrong."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        found = _File.model_validate(data)
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise DefrayError(f"cannot read claims {path.name}: {error}") from None
    except ValidationError as error:
        raise DefrayError(f"{path.name}: {first_problem(error)}") from None
    twice = [name for name, count in Counter(claim.id for claim in found.claim).items() if count > 1]
    if twice:
        raise DefrayError(f"{path.name}: claim '{twice[0]}' stands there twice")
    return tuple(found.scenes), tuple(found.claim)
