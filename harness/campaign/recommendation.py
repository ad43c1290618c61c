"""Which variant to use on a scene: the fastest whose leaks and error of t are shown to stay below given limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from harness import tracers
from harness.data import Scene
from harness.device.machine import machine_description
from harness.device.opened import Device, open_device
from harness.errors import DefrayError
from harness.inputs.aimed_rays import AimedRays, aimed_rays, leaked
from harness.measure.scene import Scenes, SharedScene
from harness.records.accuracy_row import AccuracyBody, AccuracyRow, AimedCounts, accuracy_file
from harness.records.origin import latest_rows
from harness.records.schema import Machine
from harness.spec.structure import structure_from_json
from harness.stats import megarays, rate_bound
from harness.studies.errors_and_leaks import AIMED_BLOCK, SEED, Contender, Plan, default_contenders, measure_accuracy

FOLDERS = ("results/out", "results/reference/*")  # where rows are looked for
PLAN = Plan(rays=32_000, aimed=50_000, repetitions=3)  # of a scene that no folder has
MOST_RAYS = 100_000_000  # aimed rays traced to show one variant's limit: hours
PIECE = 1_000_000  # aimed rays made at once
Say = Callable[[str], None]


@dataclass(frozen=True)
class Limits:
    """Largest leak rate of aimed rays, at 95 % confidence, and largest relative error of t, 99th percentile."""

    leaks: float = 1e-6
    t_error: float | None = None

    def __post_init__(self):
        if not 0 < self.leaks <= 1:
            raise DefrayError(f"the largest leak rate must be above 0 and at most 1, not {self.leaks:g}")
        if self.t_error is not None and not self.t_error > 0:
            raise DefrayError(f"the largest error of t must be above 0, not {self.t_error:g}")

    def t_error_met(self, row: AccuracyBody) -> bool:
        """Whether the error of t is small enough."""
        found = row.t_error.p99
        return self.t_error is None or (found is not None and found <= self.t_error)

    def leaks_met(self, row: AccuracyBody) -> bool:
        """Whether the leak rate is shown to be small enough."""
        return leak_bound(row) <= self.leaks

    def undecided(self, row: AccuracyBody) -> bool:
        """Whether more aimed rays could show what these few do not: none has leaked."""
        return row.aimed.leaks == 0 and not self.leaks_met(row)

    @property
    def rays_needed(self) -> int:
        """Aimed rays without a leak that show the limit."""
        return math.ceil(3 / self.leaks)


@dataclass
class Advice:
    """`choice` and `following`: rows of the fastest variant that meets the limits and of the next; None without one.

    `refused`: faster variants and why not; `meeting`: how many were found to meet the limits; `notes`: what was
    measured for this advice.
    """

    scene: str
    limits: Limits
    choice: AccuracyBody | None = None
    following: AccuracyBody | None = None
    refused: list[tuple[AccuracyBody, str]] = field(default_factory=list)
    meeting: int = 0
    notes: list[str] = field(default_factory=list)


def leak_bound(row: AccuracyBody) -> float:
    """Upper 95 % bound of a row's leak rate."""
    return rate_bound(row.aimed.leaks, row.aimed.rays)


def find_rows(scene: Scene, device, folder: Path | None) -> list[AccuracyRow]:
    """One row a variant of this very scene on this device: from `folder`, else from the first of FOLDERS with any.

    They are those of the most diffuse rays, and of a variant that has several the one with the most aimed rays, of
    these the latest.
    """
    folders = [folder] if folder else [path for pattern in FOLDERS for path in sorted(Path().glob(pattern))]
    machine = machine_description(device)
    for one in folders:
        rows = latest_rows(
            [
                row
                for row in accuracy_file(one).read()
                if row.scene.geometry == (scene.source, scene.sha256) and measured_here(row, machine, device.is_cpu)
            ]
        )
        if rows:
            most = max(row.rays.count for row in rows)
            rows = sorted((row for row in rows if row.rays.count == most), key=lambda row: row.aimed.rays)
            return list({row.variant: row for row in rows}.values())
    return []


def measured_here(row: AccuracyRow, machine: Machine, on_cpu: bool) -> bool:
    """Whether a row's rate is one of this machine: of its device, and of its processor where that does the work."""
    there, here, is_embree = row.machine.key, machine.key, row.tracer == "embree"
    same_device = is_embree or (there.platform, there.device) == (here.platform, here.device)
    same_processor = not (on_cpu or is_embree) or (there.cpu, there.cores) == (here.cpu, here.cores)
    return same_device and same_processor


def advise(
    scene: str, rows: Sequence[AccuracyBody], limits: Limits, deepen: Callable[[AccuracyBody], AccuracyBody]
) -> Advice:
    """The fastest of `rows` that meets the limits, and the next.

    `deepen(row)` gives the row with enough aimed rays to show the limit; it is asked, fastest first, only of rows
    that have leaked none and are too few.
    """
    advice = Advice(scene, limits)
    for row in sorted(rows, key=lambda row: -row.rate.median):
        if not limits.t_error_met(row):
            why = f"t error p99 {row.t_error.p99 or math.nan:.1e} exceeds {limits.t_error:g}"
        else:
            if advice.choice is None and limits.undecided(row):
                row = deepen(row)
            why = f"{row.aimed.leaks:,} of {row.aimed.rays:,} aimed rays leak"
            if limits.leaks_met(row):
                advice.meeting += 1
                if advice.choice is None:
                    advice.choice = row
                elif advice.following is None:
                    advice.following = row
                continue
            if limits.undecided(row) and advice.choice and advice.following is None:
                advice.following = row
        if advice.choice is None:
            advice.refused.append((row, why))
    return advice


def recommend(scene: str, limits: Limits, folder: Path | None, device_part: str | None, say: Say) -> Advice:
    """Advice from rows on file of this very scene and device; measures what they do not show, saying so.

    Raises DefrayError for a limit that would take too many rays to show, for a folder, a device or a scene that is
    not there, and for whatever cannot be measured.
    """
    if limits.rays_needed > MOST_RAYS:
        raise DefrayError(
            f"a leak rate of {limits.leaks:g} takes {limits.rays_needed:,} aimed rays to show; "
            f"at most {MOST_RAYS:,} are traced, which show {3 / MOST_RAYS:g}"
        )
    if folder and not folder.is_dir():
        raise DefrayError(f"there is no folder {folder}; --from names one with accuracy.jsonl")
    notes: list[str] = []

    def note(text: str) -> None:
        notes.append(text)
        say(text)

    device = open_device(device_part)
    deeper = Deeper(scene, limits, device, note)
    rows = find_rows(deeper.shared.scene, device, folder)
    if not rows:
        note(
            f"no rows of {deeper.shared.scene.title} on {device.name} on file: measuring every variant with "
            f"{PLAN.rays:,} diffuse rays"
        )
        contenders = default_contenders(device)
        rows = list(
            measure_accuracy(
                deeper.shared,
                contenders,
                PLAN,
                device,
                lambda step: say(", ".join(filter(None, (step.part, step.stage)))),
            )
        )
    advice = advise(scene, rows, limits, deeper)
    advice.notes = notes
    return advice


class Deeper:
    """Traces as many aimed rays through a variant as its limit takes, on this machine."""

    def __init__(self, scene: str, limits: Limits, device: Device, note: Say):
        self.scene, self.limits, self.device, self._note = scene, limits, device, note
        self._scenes = Scenes(device)
        self._pieces: list[AimedRays] = []
        self._prepared: dict = {}

    @property
    def shared(self) -> SharedScene:
        """The scene, loaded at first use."""
        return self._scenes.load(self.scene)

    def __call__(self, row: AccuracyBody) -> AccuracyBody:
        """The row with the counts of so many aimed rays, fewer where one leaks."""
        self._note(f"{row.variant}: tracing {self.limits.rays_needed:,} aimed rays to show its leak rate")
        tracer, counts = self._open(row), np.zeros(4, np.int64)
        while counts[0] < self.limits.rays_needed and not counts[1]:
            counts += self._count(tracer, self._piece(int(counts[0]) // PIECE), self.limits.rays_needed - counts[0])
        named = dict(zip(("rays", "leaks", "at_vertices", "vertex_leaks"), map(int, counts), strict=True))
        return row.model_copy(update={"aimed": AimedCounts(**named, seed=SEED)})

    def _piece(self, place: int) -> AimedRays:
        """One million aimed rays, the same for every variant."""
        while len(self._pieces) <= place:
            seed = SEED + 1 + len(self._pieces)
            self._pieces.append(
                aimed_rays(self.shared.scene, min(PIECE, self.limits.rays_needed), seed, self.shared.embree)
            )
        return self._pieces[place]

    def _count(self, tracer, piece: AimedRays, wanted: int) -> np.ndarray:
        """int64[4]: rays, leaks, rays at vertices and leaks of those, up to the first block that leaks."""
        counts = np.zeros(4, np.int64)
        for first in range(0, min(len(piece), wanted), AIMED_BLOCK):
            block = piece[first : min(first + AIMED_BLOCK, wanted)]
            through = leaked(tracer.timed(block.rays)[0])
            counts += [len(block), through.sum(), block.at_vertex.sum(), (through & block.at_vertex).sum()]
            if through.any():
                break
        return counts

    def _open(self, row: AccuracyBody):
        contender = Contender.parse(row.variant)
        return tracers.open_tracer(self._in_structure(row, contender.overlap), contender.variant)

    def _in_structure(self, row: AccuracyBody, overlap: str | None):
        if overlap is None:
            return self.shared.prepared
        spec = structure_from_json(row.grid.as_json())
        if (spec, overlap) not in self._prepared:
            self._prepared[spec, overlap] = self.shared.prepared.with_structure(spec, overlap)
        return self._prepared[spec, overlap]


def advice_lines(advice: Advice) -> list[str]:
    """The advice in a few lines; one line where nothing meets the limits."""
    limits, row = advice.limits, advice.choice
    asked = f"leaks below {limits.leaks:g}"
    asked += "" if limits.t_error is None else f" and t error p99 at most {limits.t_error:g}"
    if row is None:
        return [f"no variant measured on {advice.scene} is shown to have {asked}"]
    rate, aimed = row.rate, row.aimed
    machine = row.machine.device if isinstance(row, AccuracyRow) else None
    lines = [
        f"{advice.scene}: {row.variant}",
        f"  {_rate_text(row)} [{megarays(rate.low):.3g}, {megarays(rate.high):.3g}] with "
        f"{row.rays.count:,} diffuse rays" + (f" on {machine}" if machine else ""),
        f"  {aimed.leaks:,} of {aimed.rays:,} aimed rays leak: below {leak_bound(row):.1e} at 95 % confidence; "
        f"t error p99 {row.t_error.p99 or math.nan:.1e}",
        f"  the fastest of {advice.meeting} that are shown to have {asked}",
    ]
    if advice.following:
        other = advice.following
        shown = "" if limits.leaks_met(other) else f", shown with {other.aimed.rays:,} aimed rays only"
        lines.append(f"  next: {other.variant}, {_rate_text(other)}{shown}")
    lines += [f"  faster, but: {other.variant}, {_rate_text(other)}: {why}" for other, why in advice.refused[:5]]
    return lines + ([f"  and {len(advice.refused) - 5} more"] if len(advice.refused) > 5 else [])


def _rate_text(row: AccuracyBody) -> str:
    return f"{megarays(row.rate.median):.3g} Mrays/s"


def as_json(advice: Advice) -> dict:
    """The advice as plain JSON types."""
    refused = [(row.as_json(), why) for row, why in advice.refused]
    return {
        "scene": advice.scene,
        "limits": {"leaks": advice.limits.leaks, "t_error": advice.limits.t_error},
        "choice": advice.choice and advice.choice.as_json(),
        "next": advice.following and advice.following.as_json(),
        "refused": [{"variant": row["variant"], "rate": row["rate"], "why": why} for row, why in refused],
        "notes": advice.notes,
    }
