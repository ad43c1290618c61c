"""When less is enough: what resolution, precision and rays a pixel cost in speed and bring in accuracy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from harness import stats
from harness.data import Hits, Rays, Scene
from harness.device.machine import machine_description
from harness.device.stopwatch import Stopwatch
from harness.inputs.rays import bounce, find_view, image_rays, primary_rays
from harness.measure.group import scene_facts
from harness.measure.scene import Scenes, SharedScene
from harness.records.agreement import Agreement
from harness.records.origin import finish, identity
from harness.records.precision_row import PrecisionBody, PrecisionRow, precision_file
from harness.records.record_file import RecordFile
from harness.records.schema import Machine
from harness.reference.check import Checker
from harness.reference.errors_of_t import diagonal_of, distance_rmse
from harness.reference.exact import zero_area
from harness.spec import intersectors
from harness.spec.run_spec import Variant
from harness.spec.structure import Uniform
from harness.studies.study import Part, Step, Study, Task, Tell, guessed_seconds
from harness.tracers import check_variant, open_tracer
from harness.tracers.base import Tracer
from harness.tracers.prepared import Prepared

RESOLUTIONS = (32, 64, 128, 256)  # leaf cells an axis; the first level has 8
USUAL = 128
DOUBLE = "woop-benthin-wald-double"
SAMPLES = (1, 4, 16, 64)  # occlusion rays a pixel
MANY = 256  # of the image that the others are compared with
IMAGE = (120, 90)  # pixels
TOGETHER = 32  # turns of occlusion rays traced at once
SEED = 1


def half_precision(triangles: np.ndarray) -> np.ndarray:
    """float32[n,3,3] rounded to half precision in the scene's box, whose lower corner is 0 and longest side 1."""
    corners = triangles.reshape(-1, 3)
    lower = corners.min(axis=0).astype(np.float64)
    extent = max(float((corners.max(axis=0) - lower).max()), np.finfo(np.float32).tiny)
    rounded = ((triangles - lower) / extent).astype(np.float16)
    return (rounded.astype(np.float64) * extent + lower).astype(np.float32)


@dataclass(eq=False)
class _KnobValue:
    """One value of a knob, and what it has yielded."""

    knob: str
    value: str
    variant: str
    tracer: Tracer
    seconds: list[float] = field(default_factory=list)
    hits: Hits | None = None


def measure_precision(
    shared: SharedScene, rays: int, repetitions: int, device, tell: Tell = lambda *_: None
) -> Iterator[PrecisionBody]:
    """The bodies of the rows of `precision.jsonl` for one scene.

    Resolution and precision are measured with `rays` primary rays, all of them timed and compared with the exact t;
    rays a pixel with small images. Raises DefrayError for a grid that does not fit.
    """
    study = _Study(shared, device)
    entries = study.entries()
    primary = primary_rays(find_view(shared.scene, None), rays, SEED)
    for place, entry in enumerate(entries):
        tell(Step(None, f"{entry.knob} {entry.value}, warm-up", 0.2 * place / len(entries)))
        entry.tracer.timed(primary)
    for turn, share, entry in stats.interleaved(entries, repetitions, SEED):
        what = f"{entry.knob} {entry.value}, repetition {turn + 1}"
        tell(Step(None, what, 0.2 + 0.3 * (turn + share) / repetitions))
        entry.hits, seconds = entry.tracer.timed(primary)
        entry.seconds.append(seconds["total"])
    tell(Step(None, "ambient occlusion", 0.5))
    image_error, samples = study.images(tell)
    checker = Checker(shared.scene.triangles, primary, active=shared.active)
    agreements = {id(entry): checker.check(entry.hits) for entry in entries}
    reference, diagonal = checker.reference_t(), diagonal_of(shared.scene.triangles)
    for entry in sorted(entries, key=lambda entry: (entry.knob, entry.value)):
        yield study.body(
            *(entry.knob, entry.value, entry.variant, rays, entry.seconds),
            error=distance_rmse(primary, entry.hits.t, reference, diagonal),
            image_error=image_error if entry.value == "half" else None,
            differing=differing(agreements[id(entry)]),
        )
    yield from samples


class _Study:
    """A scene in single and in half precision, with the tracers that walk it."""

    def __init__(self, shared: SharedScene, device):
        self.scene, self.device, self.active = shared.scene, device, shared.active
        self.full = shared.prepared
        rough = half_precision(shared.scene.triangles)
        active = ~zero_area(rough)
        self.half = Prepared.on_device(replace(shared.scene, triangles=rough), device, active)
        self.variant = check_variant(Variant(tracer="deferred"))

    def tracer(self, prepared: Prepared, leaf: int = USUAL, intersector: str | None = None) -> Tracer:
        """The default tracer on a grid of `leaf` cells an axis."""
        variant = self.variant.model_copy(update={"intersector": intersector or self.variant.intersector})
        return open_tracer(prepared.with_structure(Uniform(8, leaf)), variant)

    def entries(self) -> list[_KnobValue]:
        """Every value of the knobs `grid` and `precision`."""
        name = str(self.variant)
        found = [_KnobValue("grid", f"8/{leaf}", name, self.tracer(self.full, leaf)) for leaf in RESOLUTIONS]
        found += [
            _KnobValue("precision", "half", name, self.tracer(self.half)),
            _KnobValue("precision", "float", name, self.tracer(self.full)),
        ]
        if DOUBLE in intersectors.INTERSECTORS and self.device.has_double:
            found.append(
                _KnobValue("precision", "double", f"deferred:{DOUBLE}", self.tracer(self.full, USUAL, DOUBLE))
            )
        self.of_full, self.of_half = found[len(RESOLUTIONS) + 1].tracer, found[len(RESOLUTIONS)].tracer
        return found

    def body(
        self, knob: str, value: str, variant: str, rays: int, seconds: list[float], **found: float | None
    ) -> PrecisionBody:
        """What a row says of one value of a knob; `found`: its errors."""
        return PrecisionBody(
            scene=scene_facts(self.scene),
            knob=knob,
            value=value,
            variant=variant,
            rays=rays,
            seconds=seconds,
            rate=stats.interval(stats.rates_of(seconds, rays)),
            **found,
        )

    def images(self, tell: Tell) -> tuple[float, list[PrecisionBody]]:
        """Error of the image that half precision makes, and the bodies of `samples`.

        Half precision is compared with single at the same directions, so that noise does not count; few rays a
        pixel are compared with many others.
        """
        rays = image_rays(find_view(self.scene, None), *IMAGE)
        full, half = (
            tracer.trace(rays, Stopwatch(self.device.queue)).primitive for tracer in (self.of_full, self.of_half)
        )
        seen = (full >= 0) & (half >= 0)
        rays, full, half = rays[seen], full[seen], half[seen]
        many, *_ = self._open_share(self.of_full, rays, full, range(MANY))
        tell(Step(None, "ambient occlusion in half precision", 0.65))
        rough, *_ = self._open_share(self.of_half, rays, half, range(MANY))
        bodies = []
        for count in SAMPLES:
            tell(Step(None, f"ambient occlusion, {count} rays a pixel", 0.8))
            few, seconds, differ = self._open_share(self.of_full, rays, full, range(MANY, MANY + count), check=True)
            made = ("samples", str(count), str(self.variant), count * len(rays), [seconds])
            bodies.append(self.body(*made, error=rmse(few, many), differing=differ))
        return rmse(rough, many), bodies

    def _open_share(
        self, tracer: Tracer, primary: Rays, primitive, turns: range, check: bool = False
    ) -> tuple[np.ndarray, float, int]:
        """float64[n]: share of occlusion rays that reach nothing; the seconds they took; checked hits that differ."""
        free, cast, seconds, differ = np.zeros(len(primary)), np.zeros(len(primary)), 0.0, 0
        for first in range(0, len(turns), TOGETHER):
            scene: Scene = tracer.prepared.scene
            parts = [
                bounce(scene, primary, primitive, "ambient-occlusion", SEED, turn)
                for turn in turns[first : first + TOGETHER]
            ]
            columns = (
                np.concatenate([getattr(rays, name) for rays, _ in parts])
                for name in ("origins", "directions", "t_max")
            )
            pixels = np.concatenate([whose for _, whose in parts])
            rays = Rays(*columns, "ambient-occlusion", SEED)
            hits, taken = tracer.timed(rays)
            if check:
                differ += differing(Checker(scene.triangles, rays, active=self.active).check(hits))
            free += np.bincount(pixels[hits.primitive < 0], minlength=len(primary))
            cast += np.bincount(pixels, minlength=len(primary))
            seconds += taken["total"]
        return np.divide(free, cast, out=np.ones_like(free), where=cast > 0), seconds, differ


class PrecisionStudy(Study):
    """What resolution, precision and rays a pixel cost and bring; one scene is one part, of many rows."""

    name = "precision"
    unit = "scenes"

    def tasks(self, scene: str, rays: int, repetitions: int) -> list[Task]:
        """One task: all knobs on one scene. Its part is that of the last row, which is stored after all others."""
        facts = {"scene": scene, "rays": rays, "repetitions": repetitions}
        part = Part(identity(**facts, knob="samples", value=str(SAMPLES[-1])), f"{scene} precision and resolution")
        variants = len(RESOLUTIONS) + 2
        traced = [(check_variant(Variant(tracer="deferred")), rays * (repetitions + 1))] * variants
        return [Task(self, part.name, scene, (part,), guessed_seconds(scene, traced, rays), facts)]

    def file(self, folder: Path, machine: Machine) -> RecordFile[PrecisionRow]:
        """`precision.jsonl`."""
        return precision_file(folder)

    def measure(self, task: Task, scenes: Scenes, tell: Tell) -> Iterator[PrecisionRow]:
        """Every value of every knob."""
        rays, repetitions, device = task.plan["rays"], task.plan["repetitions"], scenes.device
        for body in measure_precision(scenes.load(task.scene), rays, repetitions, device, tell):
            named = identity(**task.plan, knob=body.knob, value=body.value)
            yield finish(PrecisionRow, body, machine_description(device), id=named)

    def outcome(self, row: PrecisionRow) -> str:
        """The last row stands for all."""
        return "measured"


def differing(found: Agreement) -> int:
    """Rays whose hit is neither the exact one nor as near, but for rounding of t."""
    return found.rays - found.same - found.tie - found.t_off


def rmse(image: np.ndarray, other: np.ndarray) -> float:
    """Root mean square difference of two images float64[n]."""
    return float(np.sqrt(np.mean((image - other) ** 2)))
