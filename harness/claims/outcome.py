"""What a rule finds: yes, no or open for the claim as worded and for its shape, and the numbers behind it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from pydantic import model_validator

from harness.data import Strict

Answer = bool | None  # None: open, as the numbers allow either


@dataclass(frozen=True)
class Finding:
    """One number a rule looked at, with the ids of its records.

    `low` and `high` are its 95 % interval, both equal to `value` for an exact count and both None where nothing tells
    the noise of a timing. `answer`: what it says of the full condition. `value` None stands for missing records.
    """

    what: str
    value: float | None
    low: float | None = None
    high: float | None = None
    runs: tuple[str, ...] = ()
    stand_in: bool = False
    answer: Answer = None
    note: str = ""
    unit: str = ""

    def as_dict(self) -> dict:
        """For claims.json; keys without a value are left out."""
        full = {
            "what": self.what,
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "unit": self.unit,
            "meets_full": self.answer,
            "stand_in": self.stand_in,
            "note": self.note,
            "runs": list(self.runs),
        }
        return {key: value for key, value in full.items() if value not in ("", [])}


@dataclass(frozen=True)
class Outcome:
    """A rule's answer. `missing` says why it could not be judged at all; `threshold` is its condition in words."""

    full: Answer
    shape: Answer
    threshold: str
    findings: Sequence[Finding] = ()
    summary: str = ""
    missing: str = ""
    shape_threshold: str = ""
    needed: str = ""  # the threshold in short
    facts: dict = field(default_factory=dict)


class Bound(Strict):
    """A condition on a number with an interval; `on`: on how many scenes it must hold."""

    at_least: float | None = None
    above: float | None = None
    at_most: float | None = None
    below: float | None = None
    on: Literal["all", "most", "any"] = "all"

    @model_validator(mode="after")
    def _one(self) -> Bound:
        if sum(value is not None for value in (self.at_least, self.above, self.at_most, self.below)) != 1:
            raise ValueError("a condition needs one of at_least, above, at_most and below")
        return self

    def holds(self, low: float | None, high: float | None) -> Answer:
        """Whether the whole of [low, high] meets the condition, none of it does, or some does (None)."""
        if low is None or high is None:
            return None
        sure, possible = {
            "at_least": lambda x: (low >= x, high >= x),
            "above": lambda x: (low > x, high > x),
            "at_most": lambda x: (high <= x, low <= x),
            "below": lambda x: (high < x, low < x),
        }[self._name](self.limit)
        return True if sure else None if possible else False

    @property
    def _name(self) -> str:
        return next(name for name in ("at_least", "above", "at_most", "below") if getattr(self, name) is not None)

    @property
    def limit(self) -> float:
        """The threshold."""
        return getattr(self, self._name)

    def words(self, scenes: bool = True) -> str:
        """`at least 2 on all scenes`."""
        sign = {"at_least": "≥", "above": ">", "at_most": "≤", "below": "<"}[self._name]
        where = {"all": "every scene", "most": "most scenes", "any": "a scene"}[self.on]
        return f"{sign} {self.limit:g}" + (f" on {where}" if scenes else "")

    def over(self, answers: Iterable[Answer]) -> Answer:
        """The answers of all scenes as one."""
        return {"all": every, "any": some, "most": most}[self.on](list(answers))


def every(answers: Iterable[Answer]) -> Answer:
    """True where all are, False where one is, else open."""
    answers = list(answers)
    return False if False in answers else None if None in answers else True


def some(answers: Iterable[Answer]) -> Answer:
    """True where one is, False where all are, else open."""
    answers = list(answers)
    return True if True in answers else None if None in answers else False


def most(answers: Iterable[Answer]) -> Answer:
    """True where more than half are, False where no longer so many can be, else open."""
    answers = list(answers)
    need = math.floor(len(answers) / 2) + 1
    if answers.count(True) >= need:
        return True
    return None if answers.count(True) + answers.count(None) >= need else False


def missing(reason: str, threshold: str, needed: str = "") -> Outcome:
    """The outcome of a rule whose records are not there."""
    return Outcome(None, None, threshold, missing=reason, needed=needed)
