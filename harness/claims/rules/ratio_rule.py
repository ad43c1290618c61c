"""Ratio of two times or counts, scene by scene, against a threshold."""

from __future__ import annotations

from typing import Literal

from harness.claims.operands import LEAST_REPETITIONS, Evidence, Operand, Pair, lacking, pair_on, scene_rows
from harness.claims.outcome import Bound, Finding, Outcome, missing
from harness.data import Strict
from harness.stats import geometric_mean


class Rule(Strict):
    """`full` and `shape` are conditions on of / to; a claim without a shape has none weaker than its words."""

    type: Literal["ratio"]
    of: Operand
    to: Operand
    full: Bound
    shape: Bound | None = None
    least: int = 3

    def judge(self, evidence: Evidence) -> Outcome:
        """Each scene's ratio against the conditions; scenes without records stay open."""
        pairs = {scene: pair_on(scene_rows(evidence.runs, scene), self.of, self.to) for scene in evidence.scenes}
        found = [pair for pair in pairs.values() if pair is not None]
        words = f"{self.name()} {self.full.words()}"
        if len(found) < self.least:
            known = [scene for scene, pair in pairs.items() if pair is not None]
            reason = lacking(evidence.runs, evidence.scenes, known, (self.of, self.to), self.least)
            return missing(reason, words, self.full.words())
        shape = self.shape or self.full
        answers = [[bound.holds(*_ends(pair)) for pair in pairs.values()] for bound in (self.full, shape)]
        findings = [
            self._finding(scene, pair, answer)
            for (scene, pair), answer in zip(pairs.items(), answers[0], strict=True)
        ]
        return Outcome(
            self.full.over(answers[0]),
            shape.over(answers[1]),
            words,
            findings,
            _summary(found),
            shape_threshold=self.shape.words() if self.shape else "",
            needed=self.full.words(),
            facts=_mean(found),
        )

    def name(self) -> str:
        """What is divided by what, in words."""
        if self.of.variant == self.to.variant and self.of.grid == self.to.grid:
            return f"{self.of.variant}: {_what(self.of)} / {_what(self.to)}"
        if _what(self.of) == _what(self.to):
            return f"{_what(self.of)}, {self.of.words()} / {self.to.words()}"
        return f"{_what(self.of)} of {self.of.words()} / {_what(self.to)} of {self.to.words()}"

    def _finding(self, scene: str, pair: Pair | None, answer) -> Finding:
        if pair is None:
            return Finding(scene, None, note="no records")
        note = "" if pair.interval else f"fewer than {LEAST_REPETITIONS} repetitions: no interval"
        if pair.grids[0] != pair.grids[1] and all(pair.grids):
            note = "; ".join(filter(None, (note, " against ".join(pair.grids))))
        return Finding(pair.title, pair.value, *_ends(pair), pair.runs, pair.stand_in, answer, note)


def _mean(pairs: list[Pair]) -> dict:
    """The geometric mean over the scenes that have an interval."""
    pairs = [pair for pair in pairs if pair.interval]
    samples = [pair.samples for pair in pairs]
    if not samples or min(min(side) for both in samples for side in both) <= 0:
        return {}
    mean = geometric_mean(samples, [pair.together for pair in pairs])
    return {"geometric_mean": mean.as_dict(), "scenes": len(samples)}


def _ends(pair: Pair | None) -> tuple[float | None, float | None]:
    return (None, None) if pair is None or pair.interval is None else (pair.interval.low, pair.interval.high)


def _what(operand: Operand) -> str:
    return operand.count or f"time of {operand.seconds.replace('+', ' + ')}"


def _summary(pairs: list[Pair]) -> str:
    """The least and the greatest, `1.59 [1.55, 1.62] Conference to 7.31 [7.29, 7.33] Crown`."""
    ordered = sorted(pairs, key=lambda pair: pair.value)
    return " to ".join(_short(pair) for pair in dict.fromkeys((ordered[0], ordered[-1])))


def _short(pair: Pair) -> str:
    exact = pair.interval is None or pair.interval.low == pair.interval.high
    return f"{f'{pair.value:.3g}' if exact else pair.interval} {pair.title.removesuffix(' (stand-in)')}"
