"""Measuring a group of runs: what they share, warm-up, interleaved repetitions, checks, record bodies."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from harness import stats, tracers
from harness.data import Counters, Hits, Rays, Samples, Scene, differing
from harness.measure.scene import Scenes
from harness.records.agreement import Agreement
from harness.records.run_row import Rates, RunBody
from harness.records.schema import GridFacts, RayFacts, SceneFacts
from harness.spec.run_spec import RunSpec
from harness.structures.contract import Structure
from harness.tracers.base import Tracer
from harness.tuning.choose import DEFERRED, Choice, in_structure


@dataclass(frozen=True)
class Progress:
    """What a group is doing: the run (None while the shared parts are prepared), the stage, and how far it is."""

    spec: RunSpec | None
    stage: str
    done: float


@dataclass(eq=False)
class Run:
    """One variant of a group and what it has yielded so far."""

    spec: RunSpec
    tracer: Tracer
    options: dict[str, str]
    samples: Samples = field(default_factory=Samples)
    hits: Hits | None = None
    unstable: int = 0  # rays whose hits changed from one repetition to the next
    counters: Counters = field(default_factory=Counters)


class Group:
    """Scene, rays and structure of a group of runs; raises DefrayError for whatever cannot be loaded or built."""

    def __init__(self, specs: Sequence[RunSpec], scenes: Scenes, progress: Callable[[Progress], None]):
        self.specs, self.device, self._progress = specs, scenes.device, progress
        first = specs[0]
        self.tell(None, "loading scene", 0.0)
        self.shared = scenes.load(first.scene)
        self.tell(None, "rays", 0.05)
        self.rays = self.shared.rays(first)
        self.tell(None, "building the structure", 0.1)
        self.prepared, self.choice = self.shared.prepared, None
        walking = [spec for spec in specs if tracers.find(spec.variant.tracer).needs_structure]
        if walking:
            # One and the same of them, whatever order a sweep has drawn.
            self._build_structure(min(walking, key=lambda spec: (_turn(spec.variant.tracer), str(spec.variant))))
        self.seed = int(first.id, 16)

    def tell(self, spec: RunSpec | None, stage: str, done: float) -> None:
        """Report progress."""
        self._progress(Progress(spec, stage, done))

    def _build_structure(self, spec: RunSpec) -> None:
        """Build the structure that all runs of the group share; of `auto`, for the run `spec`."""
        self.prepared, self.choice = in_structure(
            self.prepared, self.rays, spec.structure, spec.variant, lambda what: self.tell(None, what, 0.1)
        )

    def open_run(self, spec: RunSpec) -> Run:
        """The tracer of one run, its options validated; raises DefrayError where the device cannot run it."""
        self.tell(spec, "preparing", 0.12)  # whatever is raised below is this run's, not the group's
        variant = self.choice.chosen_variant(spec.variant) if self.choice else spec.variant
        return Run(spec, tracers.open_tracer(self.prepared, variant), variant.options)

    def check(self, run: Run, runs: Sequence[Run]) -> Agreement:
        """Agreement of a run's hits with the reference, with its own repetitions and with other tracers."""
        self.tell(run.spec, "check", 0.95)
        agreement = self.shared.checker(run.spec, self.rays).check(run.hits)
        if run.unstable:
            reason = f"{run.unstable} rays changed their hit from one repetition to the next"
            return agreement.model_copy(update={"valid": False, "reason": reason})
        most = most_common(runs, run)
        differ = differing(run.hits, most.hits)
        if differ:
            reason = f"{differ} rays differ from {most.spec.variant}, which they must equal bit for bit"
            return agreement.model_copy(update={"valid": False, "reason": reason})
        return agreement


def most_common(runs: Sequence[Run], run: Run) -> Run:
    """A run with the hits that most tracers agree on that promise the same: the odd one out is at fault."""
    promise = _promise(run)
    alike = [other for other in runs if promise and _promise(other) == promise]
    if len(alike) < 2:
        return run
    hashes = {id(other): hits_hash(other.hits) for other in alike}
    shares = Counter(hashes.values())
    return max(alike, key=lambda other: (shares[hashes[id(other)]], other is run))


def _promise(run: Run) -> tuple | None:
    """What tracers must have in common for equal hits, bit for bit; None of one with a test of its own."""
    test, options = run.tracer.intersector, run.tracer.options
    return (test, options.contraction, getattr(options, "exit", "keep")) if test else None


def hits_hash(hits: Hits) -> str:
    """SHA-256 of t and primitive: equal for tracers that agree bit for bit."""
    return hashlib.sha256(hits.t.tobytes() + hits.primitive.tobytes()).hexdigest()


def scene_facts(scene: Scene) -> SceneFacts:
    """The `scene` part of a row."""
    return SceneFacts(
        name=scene.name, source=scene.source, triangles=len(scene), sha256=scene.sha256, views=scene.views_from
    )


def ray_facts(rays: Rays) -> RayFacts:
    """The `rays` part of a row."""
    return RayFacts(kind=rays.kind, count=len(rays), seed=rays.seed)


def _turn(tracer: str) -> int:
    """Of the tracers of a group, the one of the lowest is who the grid is chosen for."""
    return DEFERRED.index(tracer) if tracer in DEFERRED else len(DEFERRED)


def describe_structure(structure: Structure, choice: Choice | None = None) -> GridFacts:
    """The `grid` part of a row, and why it was chosen, where it was."""
    return GridFacts(**structure.describe(), **(choice.describe() if choice else {}))


def describe_run(group: Group, run: Run, agreement: Agreement) -> RunBody:
    """The body of a record: everything but identity, time and machine."""
    scene, rays, spec, tracer = group.shared.scene, group.rays, run.spec, run.tracer
    return RunBody(
        scene=scene_facts(scene),
        view=None if rays.kind in ("random", "file") else spec.view or scene.views[0].name,
        rays=ray_facts(rays),
        grid=describe_structure(group.prepared.structure, group.choice) if tracer.needs_structure else None,
        tracer=tracer.name,
        intersector=tracer.intersector.name if tracer.intersector else None,
        options=run.options,
        repetitions=spec.repetitions,
        spec=spec.model_dump(mode="json"),
        samples=run.samples,
        rate=Rates(**stats.rates(run.samples, len(rays), agreement.valid)),
        counters=run.counters,
        agreement=agreement,
        hits=int((run.hits.primitive >= 0).sum()),
        hits_sha256=hits_hash(run.hits),
        hierarchy_build_seconds=getattr(tracer, "build_seconds", None),
        valid=agreement.valid,
    )
