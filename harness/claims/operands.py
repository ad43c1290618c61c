"""What a rule looks at: the evidence, the runs of an operand, and pairs of runs that trace the same rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd
from pydantic import field_validator, model_validator

from harness.analysis.names import WORKLOAD, plain, scene_and_size
from harness.analysis.ratios import beside
from harness.analysis.results import Results
from harness.data import STAGES, Strict
from harness.records.run_row import Record
from harness.spec.run_spec import Variant
from harness.stats import Interval, quotient, ratio

PAPER_GRID, UNIFORM, ADAPTIVE = "8/128 total", "uniform", "adaptive"
LEAST_REPETITIONS = 3  # fewer do not tell the noise of a timing
COUNTS = ("steps", "pairs", "tests", "lane_tests", "waves", "padding")
WORK = WORKLOAD[1:]  # of one scene: view, rays, seed


@dataclass(frozen=True)
class Evidence:
    """What rules judge by: the runs of a folder, and the scenes that the paper measured."""

    runs: Results
    scenes: tuple[str, ...]


class Operand(Strict, frozen=True):
    """A time or a count of one variant on one grid.

    `seconds`: a stage, or several joined by +; `count`: a counter; `per`: a counter, or `rays`, to divide by. `grid`:
    `top/leaf reading`, `uniform` for the fastest of the total ones measured, `adaptive` for the fastest adaptive one.
    """

    variant: str
    grid: str = PAPER_GRID
    seconds: str | None = None
    count: str | None = None
    per: str | None = None

    @field_validator("variant")
    @classmethod
    def _canonical(cls, text: str) -> str:
        return str(Variant.parse(text))

    @model_validator(mode="after")
    def _one_kind(self) -> Operand:
        if (self.seconds is None) == (self.count is None):
            raise ValueError("an operand has either seconds or count")
        if not set(self.stages) <= set(STAGES):
            raise ValueError(f"seconds are of {', '.join(STAGES)}, joined by +")
        if not {self.count, self.per} <= {None, "rays", *COUNTS}:
            raise ValueError(f"counters are {', '.join(COUNTS)}, and rays")
        return self

    @property
    def stages(self) -> list[str]:
        """Stages whose seconds are added."""
        return self.seconds.split("+") if self.seconds else []

    def values(self, record: Record) -> list[float]:
        """The value of each repetition, a single one of a count; none where a stage was not timed."""
        per = 1 if self.per is None else _counter(record, self.per)
        if per <= 0:
            return []
        if self.count is not None:
            return [_counter(record, self.count) / per]
        parts = [getattr(record.samples, stage) for stage in self.stages]
        if not all(parts) or len({len(part) for part in parts}) > 1:
            return []
        return [sum(times) / per for times in zip(*parts, strict=True)]

    def matches(self, rows: pd.DataFrame) -> pd.DataFrame:
        """The rows of this variant on this grid that have its values."""
        here = rows["label"] == self.variant
        if self.grid in (UNIFORM, ADAPTIVE):
            here &= rows["reading"] == ("total" if self.grid == UNIFORM else "adaptive")
        elif not (rows.loc[here, "grid"] == "").all():
            here &= rows["grid"] == self.grid
        found = rows[here]
        return found[found["record"].map(lambda record: bool(self.values(record))).astype(bool)]

    def words(self) -> str:
        """The variant, and its grid if that is not the paper's."""
        grid = "" if self.grid == PAPER_GRID else f" on grid {self.grid}"
        return f"{self.variant}{grid}"


def _counter(record: Record, name: str) -> float:
    return record.rays.count if name == "rays" else getattr(record.counters, name)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two runs on the same rays of one scene, and the ratio of their values with its 95 % interval.

    `samples`: the values of both sides, repetition by repetition; `together`: in turns, so that they are paired. The
    interval is None for timings with too few repetitions.
    """

    scene: str
    title: str
    triangles: int
    stand_in: bool
    value: float
    interval: Interval | None
    samples: tuple[list[float], list[float]]
    runs: tuple[str, ...]
    grids: tuple[str, ...]
    together: bool


def scene_rows(runs: Results, scene: str) -> pd.DataFrame:
    """Valid diffuse runs on one whole scene."""
    rows = runs.every_diffuse
    return rows[rows["scene"].map(plain) == plain(scene)]


def pair_on(rows: pd.DataFrame, of: Operand, to: Operand) -> Pair | None:
    """The pair on the workload with most rays, then most repetitions; None where no workload has both sides."""
    best = None
    for _, work in rows.groupby(WORK, sort=True):
        sides = _sides(work, of, to)
        if any(side is None for side in sides):
            continue
        if min(to.values(sides[1]["record"])) <= 0:
            continue  # too short for the device's clock, or never counted: nothing to divide by
        pair = make_pair(*sides, of, to)
        rank = (int(work["rays"].iloc[0]), min(map(len, pair.samples)))
        if best is None or rank > best[0]:
            best = (rank, pair)
    return best[1] if best else None


def _sides(work: pd.DataFrame, of: Operand, to: Operand) -> list[pd.Series | None]:
    """The fastest run of each; of a tracer without a grid the one measured beside the other's."""
    found = [operand.matches(work) for operand in (of, to)]
    sides = [_fastest(operand, rows) for operand, rows in zip((of, to), found, strict=True)]
    if all(side is not None for side in sides):
        for place, other in ((0, 1), (1, 0)):
            if sides[place]["grid"] == "" and sides[other]["grid"] != "":
                sides[place] = _fastest((of, to)[place], beside(found[place], sides[other]))
    return sides


def _fastest(operand: Operand, rows: pd.DataFrame) -> pd.Series | None:
    if rows.empty:
        return None
    medians = [pd.Series(operand.values(record)).median() for record in rows["record"]]
    return rows.iloc[medians.index(min(medians))]


def make_pair(one: pd.Series, two: pd.Series, of: Operand, to: Operand) -> Pair:
    """The ratio of two runs. Repetitions are paired where both ran in one group, beside the same grid."""
    over, under = of.values(one["record"]), to.values(two["record"])
    exact = of.count is not None and to.count is not None
    together = len(over) == len(under) and one["beside"] == two["beside"]
    value = float(pd.Series(over).median() / pd.Series(under).median())
    if exact:
        found = Interval(value, value, value)
    elif min(len(over), len(under)) < LEAST_REPETITIONS:
        found = None
    else:
        found = (ratio if together else quotient)(over, under)
        value = found.median
    runs = tuple(dict.fromkeys((one["run"], two["run"])))
    return Pair(
        one["scene"],
        one["title"],
        int(one["triangles"]),
        one["source"] == "stand-in",
        value,
        found,
        (over, under),
        runs,
        (one["grid"], two["grid"]),
        together,
    )


def resized_scenes(runs: Results, scene: str, of: Operand, to: Operand) -> list[Pair]:
    """Pairs on every size of one scene, on the workload that most sizes have (then most rays)."""
    rows = runs.valid
    bases = rows["scene"].map(lambda name: plain(scene_and_size(name)[0]))
    rows = rows[(rows["kind"] == "diffuse") & (bases == plain(scene))]
    best, most = [], (2, 0)
    for _, work in rows.groupby(WORK, sort=True):
        pairs = [pair_on(resized, of, to) for _, resized in work.groupby("scene", sort=True)]
        pairs = [pair for pair in pairs if pair is not None]
        rank = (len(pairs), int(work["rays"].iloc[0]))
        if rank >= most:
            best, most = pairs, rank
    return sorted(best, key=lambda pair: pair.triangles)


def lacking(
    runs: Results, scenes: Sequence[str], found: Sequence[str], operands: Sequence[Operand], least: int
) -> str:
    """Why a rule has too few scenes: `found` of `scenes`, `least` needed; which variants have no run where."""
    absent = [name for name in scenes if name not in found]
    without: dict[tuple[str, str], list[str]] = {}  # variants by what is wrong and where
    for operand in dict.fromkeys(operands):
        lost = [name for name in absent if operand.matches(scene_rows(runs, name)).empty]
        failed = [name for name in lost if _failed(runs, name, operand)]
        for what, names in (("failed its check", failed), ("no run", [name for name in lost if name not in failed])):
            if names:
                without.setdefault((what, _where(names, scenes)), []).append(operand.words())
    parts = [
        f"no run of {' and '.join(dict.fromkeys(names))}{where}"
        if what == "no run"
        else f"{' and '.join(dict.fromkeys(names))} {what}{where}"
        for (what, where), names in without.items()
    ]
    reason = "; ".join(parts) or "its runs trace no rays in common"
    return reason if not found else f"{len(found)} of {len(scenes)} scenes, {least} needed: {reason}"


def _failed(runs: Results, scene: str, operand: Operand) -> bool:
    """Whether the variant ran on the scene and its hits were wrong."""
    rows = runs.all
    return bool(
        (
            (rows["scene"].map(plain) == plain(scene))
            & ~rows["valid"]
            & (rows["kind"] == "diffuse")
            & (rows["label"] == operand.variant)
        ).any()
    )


def _where(without: Sequence[str], scenes: Sequence[str]) -> str:
    return "" if len(without) == len(scenes) else f" on {', '.join(without)}"
