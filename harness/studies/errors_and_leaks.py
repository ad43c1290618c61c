"""The accuracy of whole tracers on a scene, against their rate: rows of `accuracy.jsonl`.

Every variant traces the same diffuse rays, which are timed and compared with the reference, and the same rays aimed
at edges and vertices, of which it must let none through.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from harness import stats, tracers
from harness.data import Hits, Rays
from harness.device.machine import machine_description
from harness.errors import DefrayError, known
from harness.inputs.aimed_rays import AimedRays, aimed_rays, leaked
from harness.measure.group import ray_facts, scene_facts
from harness.measure.scene import Scenes, SharedScene
from harness.records.accuracy_row import AccuracyBody, AccuracyRow, AimedCounts, GridPlace, accuracy_file
from harness.records.agreement import Agreement
from harness.records.origin import finish, identity
from harness.records.record_file import RecordFile
from harness.records.schema import Machine
from harness.reference.errors_of_t import diagonal_of, distance_rmse, residual_p99
from harness.spec import intersectors
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import OVERLAPS, StructureSpec, Uniform
from harness.studies.study import Part, Step, Study, Task, Tell, guessed_seconds
from harness.tracers import check_variant, needs_structure
from harness.tracers.base import Tracer
from harness.tracers.forward import EXITS

PAPER_GRID = Uniform(8, 128)
SEED = 1  # of both sets of rays
STORED_OVERLAP = "binning"  # what the overlap test is called in variants' texts of schema 2
AIMED_BLOCK = 1 << 16  # aimed rays traced before the leaks are counted
ENOUGH_LEAKS = 1000  # a variant that has let so many through is given no more: its rate is known to 6 %


@dataclass(frozen=True)
class Contender:
    """A variant of a tracer and how the grid it walks was filled (None without a grid)."""

    variant: Variant
    overlap: str | None

    @classmethod
    def parse(cls, text: str) -> Contender:
        """Read `deferred:ray-space:contraction=on:overlap=open`; raises DefrayError for what is not known.

        `binning=open`, as rows of schema 2 write the overlap test, says the same.
        """
        variant = Variant.parse(text)
        options = dict(variant.options)
        named = [options.pop(key) for key in ("overlap", STORED_OVERLAP) if key in options]
        if len(named) > 1:
            raise DefrayError(f"'{text}' names its overlap test twice; leave {STORED_OVERLAP}={named[1]} out")
        overlap = named[0] if named else None
        if options.get("contraction") == "off":
            del options["contraction"]
        variant = check_variant(variant.model_copy(update={"options": options}))
        if overlap and not needs_structure(variant):
            raise DefrayError(f"tracer '{variant.tracer}' walks no structure; leave overlap={overlap} out")
        if overlap and overlap not in OVERLAPS:
            raise known("overlap test", overlap, OVERLAPS)
        return cls(variant, (overlap or OVERLAPS[0]) if needs_structure(variant) else None)

    def __str__(self) -> str:
        named = {STORED_OVERLAP: self.overlap} if self.overlap not in (None, OVERLAPS[0]) else {}
        return str(self.variant.model_copy(update={"options": self.variant.options | named}))

    @property
    def contraction(self) -> str | None:
        """`off` or `on`; None for a tracer that the compiler's choice does not reach."""
        device = tracers.find(self.variant.tracer).needs_device
        return self.variant.options.get("contraction", "off") if device else None


@dataclass(frozen=True)
class Plan:
    """What is measured on each scene: how many diffuse and aimed rays, how often, on which grid."""

    rays: int = 100_000
    aimed: int = 1_000_000
    repetitions: int = 5
    structure: StructureSpec = PAPER_GRID

    def to_json(self) -> dict:
        """As ids hold it."""
        counts = {"rays": self.rays, "aimed": self.aimed, "repetitions": self.repetitions}
        return {**counts, "grid": stored_structure(self.structure)}

    def id_of(self, scene: str, contender: Contender | str) -> str:
        """The id of the row that measures `contender` on the scene or mesh file `scene` by this plan."""
        return identity(scene=scene, variant=str(contender), plan=self.to_json(), seed=SEED)


def stored_structure(spec: StructureSpec) -> dict:
    """A structure as rows of accuracy hold it: with a density, None where it has none."""
    return {"density": None} | spec.to_json()


def default_contenders(device) -> list[Contender]:
    """Every intersector in the deferred tracer, contraction off and on; the default one with every other overlap
    test, and forward with every overlap test and exit rule; Embree robust and fast."""
    usable = [i.name for i in intersectors.INTERSECTORS.values() if device.has_double or not i.needs_double]
    texts = [f"deferred:{name}{contraction}" for name in usable for contraction in ("", ":contraction=on")]
    texts += [f"deferred:overlap={overlap}" for overlap in OVERLAPS[1:]]
    texts += [f"forward:overlap={overlap}:exit={rule}" for overlap in OVERLAPS for rule in EXITS]
    texts += ["embree", "embree:robust=false"]
    return [Contender.parse(text) for text in texts]


@dataclass(eq=False)
class _TimedContender:
    """One contender and what it has yielded so far."""

    contender: Contender
    tracer: Tracer
    seconds: list[float] = field(default_factory=list)
    hits: Hits | None = None
    aimed: AimedCounts | None = None
    agreement: Agreement | None = None


class AccuracyGroup:
    """A scene with its rays, its grids and the contenders that trace it."""

    def __init__(self, shared: SharedScene, contenders: Sequence[Contender], plan: Plan, device, tell: Tell):
        self.shared, self.plan, self.device, self._tell = shared, plan, device, tell
        self.tell("diffuse rays", 0.0)
        spec = RunSpec(scene=shared.scene.name, variant=contenders[0].variant, rays=plan.rays, seed=SEED)
        self.rays = shared.rays(spec)
        self.checker = shared.checker(spec, self.rays)
        self.checker.reference  # noqa: B018  traced now, so that its hierarchy is freed before others are built
        self.tell("aimed rays", 0.02)
        self.aimed = aimed_rays(shared.scene, plan.aimed, SEED, shared.embree)
        self.tell("structures", 0.1)
        self._prepared = {None: shared.prepared}
        for overlap in {contender.overlap: None for contender in contenders if contender.overlap}:
            self._prepared[overlap] = shared.prepared.with_structure(plan.structure, overlap)
        self.entries = [_TimedContender(contender, self._open(contender)) for contender in contenders]

    def tell(self, stage: str, done: float, contender: Contender | None = None) -> None:
        """Report progress; whatever is raised next is this contender's fault, or of all."""
        self._tell(Step(contender and str(contender), stage, done))

    def _open(self, contender: Contender) -> Tracer:
        self.tell("preparing", 0.12, contender)
        return tracers.open_tracer(self._prepared[contender.overlap], contender.variant)

    def trace(self, entry: _TimedContender, rays: Rays) -> tuple[Hits, float]:
        """Hits and seconds of one repetition."""
        hits, seconds = entry.tracer.timed(rays)
        return hits, seconds["total"]

    def warm_up(self) -> None:
        """Compile and run every kernel."""
        for place, entry in enumerate(self.entries):
            self.tell("warm-up", 0.15 + 0.2 * place / len(self.entries), entry.contender)
            self.trace(entry, self.rays)

    def time(self) -> None:
        """Trace the diffuse rays, repetition after repetition, the contenders of each in random order."""
        turns = self.plan.repetitions
        for turn, share, entry in stats.interleaved(self.entries, turns, SEED):
            self.tell(f"repetition {turn + 1} of {turns}", 0.35 + 0.35 * (turn + share) / turns, entry.contender)
            entry.hits, seconds = self.trace(entry, self.rays)
            entry.seconds.append(seconds)

    def judge(self, entry: _TimedContender, done: float) -> None:
        """Count the aimed rays that a contender lets through, and compare its diffuse hits with the reference."""
        self.tell("aimed rays", done, entry.contender)
        entry.aimed = self.leaks_of(entry, self.aimed)
        self.tell("check", done, entry.contender)
        entry.agreement = self.checker.check(entry.hits)

    def leaks_of(self, entry: _TimedContender, aimed: AimedRays) -> AimedCounts:
        """The `aimed` part of a row."""
        let_through = np.zeros(0, bool)
        while len(let_through) < len(aimed) and let_through.sum() < ENOUGH_LEAKS:
            block = aimed[len(let_through) : len(let_through) + AIMED_BLOCK]
            hits, _ = self.trace(entry, block.rays)
            let_through = np.append(let_through, leaked(hits))
        at_vertex = aimed.at_vertex[: len(let_through)]
        return AimedCounts(
            rays=len(let_through),
            leaks=int(let_through.sum()),
            at_vertices=int(at_vertex.sum()),
            vertex_leaks=int((let_through & at_vertex).sum()),
            seed=SEED,
        )

    def bodies(self) -> Iterator[AccuracyBody]:
        """What a row says of each contender, as soon as it is judged."""
        scene = self.shared.scene
        reference, diagonal = self.checker.reference_t(), diagonal_of(scene.triangles)
        for place, entry in enumerate(self.entries):
            self.judge(entry, 0.7 + 0.3 * place / len(self.entries))
            contender, variant, count = entry.contender, entry.contender.variant, len(self.rays)
            yield AccuracyBody(
                scene=scene_facts(scene),
                variant=str(contender),
                tracer=variant.tracer,
                intersector=variant.intersector,
                contraction=contender.contraction,
                options=variant.options,
                grid=GridPlace(**self.plan.structure.to_json()) if contender.overlap else None,
                overlap=contender.overlap,
                rays=ray_facts(self.rays),
                repetitions=self.plan.repetitions,
                seconds=entry.seconds,
                rate=stats.interval(stats.rates_of(entry.seconds, count)),
                aimed=entry.aimed,
                t_error=entry.agreement.t_relative_error,
                residual_p99_ulp=residual_p99(scene.triangles, self.rays, entry.hits),
                distance_rmse=distance_rmse(self.rays, entry.hits.t, reference, diagonal),
                agreement=entry.agreement,
                valid=entry.agreement.valid,
            )


def measure_accuracy(
    shared: SharedScene, contenders: Sequence[Contender], plan: Plan, device, tell: Tell = lambda *_: None
) -> Iterator[AccuracyBody]:
    """Rate and errors of every contender on one scene, the body of a row each.

    All are timed before the first comes; one comes as soon as its own errors are known. Raises DefrayError for
    a contender that the device cannot run, a grid that does not fit, or a scene without anything to aim at.
    """
    group = AccuracyGroup(shared, contenders, plan, device, tell)
    group.warm_up()
    group.time()
    yield from group.bodies()


def parse_contenders(text: str) -> list[Contender]:
    """The variants of `A,B,...`, each once; raises DefrayError where there is none, or one that is not known."""
    found = {str(one): one for one in (Contender.parse(part.strip()) for part in text.split(",") if part.strip())}
    if not found:
        raise DefrayError(f"'{text}' names no variant; write one, as in deferred:ray-space, or leave --variants out")
    return list(found.values())


class AccuracyStudy(Study):
    """Rate and errors of variants of tracers, scene by scene."""

    name = "accuracy"
    unit = "variants"
    adds = False

    def tasks(self, scene: str, contenders: Sequence[Contender], plan: Plan) -> list[Task]:
        """One task: all contenders on one scene."""
        parts = [Part(plan.id_of(scene, one), f"{scene} {one}", one) for one in contenders]
        traced = [(one.variant, plan.rays * (plan.repetitions + 1) + plan.aimed) for one in contenders]
        return [Task(self, scene, scene, tuple(parts), guessed_seconds(scene, traced, plan.rays), plan)]

    def file(self, folder: Path, machine: Machine) -> RecordFile[AccuracyRow]:
        """`accuracy.jsonl`."""
        return accuracy_file(folder)

    def measure(self, task: Task, scenes: Scenes, tell: Tell) -> Iterator[AccuracyRow]:
        """The row of each contender."""
        plan, device, ids = task.plan, scenes.device, {str(part.what): part.id for part in task.parts}
        shared = scenes.load(task.scene)
        contenders = [part.what for part in task.parts]
        for body in measure_accuracy(shared, contenders, plan, device, lambda step: tell(step.of(ids))):
            yield finish(AccuracyRow, body, machine_description(device), id=ids[body.variant])

    def outcome(self, row: AccuracyRow) -> str:
        """Rate, leaks and error of t."""
        aimed, error = row.aimed, row.t_error.p99
        leaks = f"{aimed.leaks:,} of {aimed.rays:,} aimed rays leak"
        return f"{stats.megarays(row.rate.median):.3g} Mrays/s, {leaks}" + (
            "" if error is None else f", t error p99 {error:.1e}"
        )
