"""How a ratio goes with the number of triangles: as which power, over the scenes or over sizes of one scene."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from harness.analysis.names import plain
from harness.claims.operands import Evidence, Operand, Pair, lacking, pair_on, resized_scenes, scene_rows
from harness.claims.outcome import Answer, Finding, Outcome, missing
from harness.data import Strict
from harness.errors import DefrayError
from harness.stats import Interval, exponent, fits


class Range(Strict):
    """Where the power must lie, with the whole of its interval."""

    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _some(self) -> Range:
        if self.low is None and self.high is None:
            raise ValueError("a range needs low, high or both")
        return self

    def holds(self, found: Interval) -> Answer:
        """True inside, False wholly outside, else open."""
        low = float("-inf") if self.low is None else self.low
        high = float("inf") if self.high is None else self.high
        if found.low > low and found.high < high:
            return True
        return False if found.high < low or found.low > high else None

    def words(self) -> str:
        """`power from 0.75 to 1.25`."""
        if self.high is None:
            return f"power above {self.low:g}"
        return f"power below {self.high:g}" if self.low is None else f"power from {self.low:g} to {self.high:g}"


class Rule(Strict):
    """`least`: points needed."""

    type: Literal["trend"]
    over: Literal["scenes", "sizes"]
    of: Operand
    to: Operand
    full: Range
    shape: Range
    least: int = 4

    def judge(self, evidence: Evidence) -> Outcome:
        """The power with its 95 % interval against the conditions, and which of three curves AICc prefers."""
        runs, scenes = evidence.runs, evidence.scenes
        if self.over == "scenes":
            pairs = [pair_on(scene_rows(runs, scene), self.of, self.to) for scene in scenes]
            pairs = [pair for pair in pairs if pair is not None]
            groups = ["scenes"] * len(pairs)
        else:
            ladders = {scene: resized_scenes(runs, scene, self.of, self.to) for scene in scenes}
            pairs = [pair for ladder in ladders.values() for pair in ladder]
            groups = [f"{scene} {pair.stand_in}" for scene, ladder in ladders.items() for pair in ladder]
        if len(pairs) < self.least:
            return missing(self._reason(evidence, pairs), self.full.words())
        return self._fitted(pairs, groups)

    def _reason(self, evidence, pairs: list[Pair]) -> str:
        if self.over == "sizes":
            return f"{len(pairs)} points, {self.least} needed: sizes of one scene with both sides of the ratio"
        known = [scene for scene in evidence.scenes if plain(scene) in {plain(pair.scene) for pair in pairs}]
        return lacking(evidence.runs, evidence.scenes, known, (self.of, self.to), self.least)

    def _fitted(self, pairs: list[Pair], groups: list[str]) -> Outcome:
        sizes, values = [pair.triangles for pair in pairs], [pair.value for pair in pairs]
        try:
            power = exponent(sizes, values, groups)
        except DefrayError as error:
            return missing(str(error), self.full.words())
        facts = {"power": power.as_dict(), "points": len(pairs)}
        preferred = ""
        if len(set(groups)) == 1:
            ranked = fits(sizes, values)
            facts["aicc"] = {fit.model: fit.aicc for fit in ranked if fit.aicc < float("inf")}
            preferred = f"; of constant, line and power law AICc prefers the {ranked[0].model}"
        findings = [
            Finding(
                "power of the triangles",
                power.median,
                power.low,
                power.high,
                tuple(run for pair in pairs for run in pair.runs),
                any(pair.stand_in for pair in pairs),
                self.full.holds(power),
            )
        ]
        findings += [
            Finding(
                f"{pair.title}, {pair.triangles:,} triangles",
                pair.value,
                *((pair.interval.low, pair.interval.high) if pair.interval else (None, None)),
                pair.runs,
                pair.stand_in,
            )
            for pair in pairs
        ]
        return Outcome(
            self.full.holds(power),
            self.shape.holds(power),
            self.full.words(),
            findings,
            f"power {power} over {len(pairs)} points{preferred}",
            shape_threshold=self.shape.words(),
            facts=facts,
        )
