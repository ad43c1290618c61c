"""What a study is: which tasks there are, how each is measured, where its rows lie. No locks and no terminal here."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from harness import tracers
from harness.inputs.scenes_by_name import expected_triangles
from harness.measure.scene import Scenes
from harness.records.origin import identity
from harness.records.schema import Machine
from harness.spec.run_spec import Variant

UNKNOWN_SCENE = 1_000_000  # triangles assumed of a mesh file, which is not counted before it is loaded
WALK_SECONDS = 4.0e-6  # a ray through a structure on two CPU cores, in a scene of 300,000 triangles
HOST_SECONDS = 0.5e-6  # a ray through a hierarchy on the host
TEST_SECONDS = 1.0e-9  # one ray against one triangle
TRIANGLE_SECONDS = 4.0e-6  # loading a scene, building its structure and the reference's tree, per triangle
CHECK_SECONDS = 1.5e-6  # making a ray and checking its hit


@dataclass(frozen=True)
class Part:
    """What yields one row: `id` is that row's, `name` is for people, `what` tells the study (it can be pickled)."""

    id: str
    name: str
    what: Any = None


@dataclass(frozen=True)
class Task:
    """Parts that are measured together, and fail together unless one of them is known to be at fault.

    `scene`: None where the study makes its own. `cost`: guessed seconds. `plan`: what the parts have in common.
    """

    study: Study
    name: str
    scene: str | None
    parts: tuple[Part, ...]
    cost: float
    plan: Any = None

    @property
    def id(self) -> str:
        """16 hex digits: equal parts, equal id."""
        return identity(study=self.study.name, parts=[part.id for part in self.parts])

    def only(self, parts: Iterable[Part]) -> Task:
        """The same task with some of its parts, its cost in proportion."""
        parts = tuple(parts)
        return dataclasses.replace(self, parts=parts, cost=self.cost * len(parts) / max(len(self.parts), 1))


@dataclass(frozen=True)
class Step:
    """What a task is doing: the part by its id (None while all share the work), the stage, the share done, 0 to 1."""

    part: str | None
    stage: str
    done: float

    def of(self, ids: Mapping[str, str]) -> Step:
        """The same step, its part by the id that `ids` has for it."""
        return dataclasses.replace(self, part=ids.get(self.part))


Tell = Callable[[Step], None]


class Rows(Protocol):
    """A file of rows, which stores each at once."""

    path: Path
    warn: Callable[[str], None]

    def append(self, row: Any) -> None:
        """Store one row; raises DefrayError where it is not whole or cannot be written."""

    def read(self) -> list:
        """All rows on file."""

    def repair(self) -> list:
        """`read`, after what a kill left of a torn last row is moved aside."""


class Study(ABC):
    """One question: its tasks are made by the method `tasks` of each study, as what is asked differs."""

    name: str
    unit: str = "rows"  # what its parts are called
    good: str = "measured"  # of a part that passed
    bad: str = "failed the check and have no rate"  # of parts that did not
    adds: bool = True  # rows on file may be added to without resuming; the latest of a part counts
    of_scene: bool = True  # a row stands for its part only as long as the scene has the same triangles

    @abstractmethod
    def file(self, folder: Path, machine: Machine) -> Rows:
        """The file of its rows in `folder`; raises DefrayError where rows of `machine` cannot join those it has."""

    @abstractmethod
    def measure(self, task: Task, scenes: Scenes, tell: Tell) -> Iterator[Any]:
        """Yield the rows of a task, whole, each as soon as it is known; whatever goes wrong is raised."""

    def id_of(self, row: Any) -> str:
        """The id of the part that a row comes from."""
        return row.id

    def device_of(self, row: Any) -> str | None:
        """The device that a row was measured on; None where its file is of one device anyway."""
        return row.machine.device

    def source_of(self, row: Any) -> tuple:
        """What tells the scene of a row from another of its name."""
        return row.scene.geometry if self.of_scene else ()

    def passed(self, row: Any) -> bool:
        """Whether a row is no failure."""
        return True

    def outcome(self, row: Any) -> str | None:
        """A row in a few words for people; None where it gets no line."""
        return None


def guessed_seconds(scene: str, traced: Iterable[tuple[Variant, int]], rays: int) -> float:
    """A first guess at a task's seconds: loading `scene`, making `rays`, each variant tracing so many rays in all.

    What tells one tracer's cost from another's is how it finds triangles, not its name.
    """
    triangles = expected_triangles(scene) or UNKNOWN_SCENE
    seconds = 1.0 + triangles * TRIANGLE_SECONDS
    for variant, count in traced:
        kind = tracers.find(variant.tracer)
        if kind.needs_structure:
            each = WALK_SECONDS * (triangles / 300_000) ** 0.5
        else:
            each = triangles * TEST_SECONDS if kind.needs_device else HOST_SECONDS
        seconds += 0.5 + count * each + rays * CHECK_SECONDS
    return seconds
