"""How well rays share a vector: lanes at work, cache lines and disagreement, counted exactly and for any device.

The real cell sequences of rays are taken through a machine of `lanes` lanes that all do the same thing at a time, one
trip of a loop after the other:

- `forward`: consecutive rays side by side. In each round every ray steps until it meets a non-empty cell, then tests
  that cell's triangles; lanes that are through wait for the last one.
- `deferred`: the walk as above, a wave at a time, over the rays that are still active; then a chunk of up to `lanes`
  pairs of one bin shares each triangle of its cell, idle lanes filling the last chunk of a bin.
- `deferred-packed`: the same walk; pairs side by side in the order of the bins without filling, each lane testing its
  own cell's triangles: what the kernels do on a device whose vectors the compiler makes from work-items.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.data import Rays
from harness.device.machine import machine_description
from harness.device.runtime import cl
from harness.errors import DefrayError
from harness.measure.group import Group, Progress, describe_structure, ray_facts, scene_facts
from harness.measure.scene import Scenes
from harness.records.coherence_row import Coherence, CoherenceBody, CoherenceRow, coherence_file
from harness.records.origin import finish, identity
from harness.records.record_file import RecordFile
from harness.records.schema import Machine
from harness.spec.run_spec import RunSpec
from harness.studies.study import Part, Step, Study, Task, Tell, guessed_seconds
from harness.tracers.batch import Batch
from harness.tracers.forward import Forward
from harness.tracers.prepared import Prepared

MODELS = ("forward", "deferred", "deferred-packed")
LINES = (64, 128)  # bytes of a cache line
MOST_LOADS = 16_000_000  # triangle loads whose lines are told apart; beyond, those of every n-th group
_BLOCK = 4_000_000  # loads told apart at once


@dataclass(frozen=True)
class Sequences:
    """Steps of rays: those of ray i are `first[i]` to `first[i + 1]`.

    `cell` int32[steps], -1 where empty; `wave` int32[steps], of each step; `first` int64[rays + 1].
    """

    first: np.ndarray
    cell: np.ndarray
    wave: np.ndarray

    @property
    def ray(self) -> np.ndarray:
        """Ray of each step, int64[steps]."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))


def record_sequences(prepared: Prepared, intersector, rays: Rays, wave: int) -> Sequences:
    """The steps of all rays, best hits deciding after every `wave` non-empty cells; the same bits on any device."""
    # Figures read counts without OpenCL.
    tracer = Forward(prepared, intersector, {"lanes": "1"})
    queue, grid, batch = prepared.device.queue, prepared.structure, Batch(prepared.device, rays)
    tracer.start(batch)
    program = tracer.program("studies/steps.cl", walks=True)
    steps = cl.array.zeros(queue, batch.count, np.int32)
    none = cl.array.zeros(queue, 1, np.int32), cl.array.zeros(queue, 1, np.uint64)
    inputs = (
        batch.count,
        batch.rays,
        batch.keys,
        *grid.arguments,
        grid.cell_start,
        grid.references,
        tracer.triangles,
        batch.positions,
        wave,
    )
    program.launch("write_steps", batch.count, *inputs, 0, none[1], none[0], none[0], steps)
    first = np.concatenate([[0], np.cumsum(steps.get(), dtype=np.int64)])
    cell, number = (cl.array.empty(queue, max(int(first[-1]), 1), np.int32) for _ in range(2))
    starts = cl.array.to_device(queue, first[:-1].astype(np.uint64))
    program.launch("write_steps", batch.count, *inputs, 1, starts, cell, number, steps)
    return Sequences(first, cell.get()[: first[-1]], number.get()[: first[-1]])


@dataclass(frozen=True)
class Lists:
    """Triangles of the cells: `start` int64[cells + 1] into `references` int32[r]; bytes of a triangle as stored."""

    start: np.ndarray
    references: np.ndarray
    triangle_bytes: int

    @property
    def sizes(self) -> np.ndarray:
        """Triangles of each cell."""
        return np.diff(self.start)


def lists_of(grid, triangle_bytes: int) -> Lists:
    """The lists of a grid on the device."""
    start = grid.cell_start.get()[: grid.nonempty + 1].astype(np.int64)
    return Lists(start, grid.references.get()[: start[-1]], triangle_bytes)


def forward_coherence(sequences: Sequences, lists: Lists, lanes: int) -> Coherence:
    """`forward` of sequences recorded with a wave of one cell."""
    ray, cell = sequences.ray, sequences.cell
    group = ray // lanes * _rounds(sequences) + sequences.wave
    steps = _Lockstep.of_lengths(*_counted(group, ray), lanes)
    met = cell >= 0
    tests = _Lockstep.of_lengths(group[met], lists.sizes[cell[met]], lanes)
    found = _coherence("forward", lanes, steps, tests)
    return _with_lines(found, group[met], cell[met], lists, lanes, _rounds(sequences))


def deferred_coherence(sequences: Sequences, lists: Lists, lanes: int) -> list[Coherence]:
    """`deferred` and `deferred-packed` of sequences recorded with a wave of several cells."""
    ray, wave, cell = sequences.ray, sequences.wave.astype(np.int64), sequences.cell
    # Rays that are still active in a wave close up, in order.
    order = np.lexsort((ray, wave))
    active = np.concatenate([[True], (np.diff(ray[order]) != 0) | (np.diff(wave[order]) != 0)])[: len(order)]
    rank = np.cumsum(active) - 1
    first = np.flatnonzero(np.concatenate([[True], np.diff(wave[order]) != 0])[: len(order)])
    rank -= np.repeat(rank[first], np.diff([*first, len(order)]))
    group = wave[order] * (len(sequences.first) // lanes + 1) + rank // lanes
    steps = _Lockstep.of_lengths(*_counted(group, ray[order]), lanes)
    met = cell >= 0
    bins, pairs = np.unique(wave[met] * len(lists.sizes) + cell[met], return_counts=True)
    chunked = _chunks(bins % len(lists.sizes), pairs, lists, lanes, steps)
    return [chunked, _packed(bins, pairs, lists, lanes, steps)]


def _rounds(sequences: Sequences) -> int:
    return int(sequences.wave.max(initial=0)) + 1


def _counted(group: np.ndarray, ray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Group and number of steps of each run of steps with equal ray and group."""
    if not len(group):
        return group, group
    starts = np.flatnonzero(np.concatenate([[True], (np.diff(group) != 0) | (np.diff(ray) != 0)]))
    return group[starts], np.diff([*starts, len(group)])


@dataclass(frozen=True)
class _Lockstep:
    """Loop trips of groups of lanes, each as long as its longest lane, and what lanes do in them."""

    work: int
    trips: int
    uneven: int

    @classmethod
    def of_lengths(cls, group: np.ndarray, length: np.ndarray, lanes: int) -> _Lockstep:
        """Lanes of equal `group` run together for `length` trips each; a group may lack lanes."""
        if not len(group):
            return cls(0, 0, 0)
        order = np.argsort(group, kind="stable")
        group, length = group[order], length[order].astype(np.int64)
        starts = np.flatnonzero(np.concatenate([[True], np.diff(group) != 0]))
        longest, shortest = np.maximum.reduceat(length, starts), np.minimum.reduceat(length, starts)
        whole = np.diff([*starts, len(group)]) == lanes
        return cls(int(length.sum()), int(longest.sum()), int((longest - np.where(whole, shortest, 0)).sum()))


def _coherence(model: str, lanes: int, steps: _Lockstep, tests: _Lockstep) -> Coherence:
    return Coherence(
        model=model,
        lanes=lanes,
        steps=steps.work,
        step_trips=steps.trips,
        uneven_step_trips=steps.uneven,
        tests=tests.work,
        test_trips=tests.trips,
        uneven_test_trips=tests.uneven,
        **dict.fromkeys(("line_trips", "line_tests", "lines_64", "lines_128"), 0),
    )


def _chunks(cell: np.ndarray, pairs: np.ndarray, lists: Lists, lanes: int, steps: _Lockstep) -> Coherence:
    """Bins filled up to whole chunks; each trip loads one triangle."""
    size, chunks = lists.sizes[cell], -(-pairs // lanes)
    tests = _Lockstep(
        int((pairs * size).sum()), int((chunks * size).sum()), int((np.where(pairs % lanes, 1, 0) * size).sum())
    )
    found = _coherence("deferred", lanes, steps, tests)
    found.line_trips, found.line_tests = tests.trips, tests.work
    for line in LINES:
        before = np.concatenate([[0], np.cumsum(lines_of(lists, line))])
        per_cell = before[lists.start[1:]] - before[lists.start[:-1]]
        setattr(found, f"lines_{line}", int((chunks * per_cell[cell]).sum()))
    return found


def _packed(bins: np.ndarray, pairs: np.ndarray, lists: Lists, lanes: int, steps: _Lockstep) -> Coherence:
    """Pairs of a wave in the order of their bins, side by side."""
    wave, cell = np.repeat(bins // len(lists.sizes), pairs), np.repeat(bins % len(lists.sizes), pairs)
    starts = np.flatnonzero(np.concatenate([[True], np.diff(wave) != 0])[: len(wave)])
    place = np.arange(len(wave)) - np.repeat(starts, np.diff([*starts, len(wave)]))
    group = wave * (len(wave) // lanes + 1) + place // lanes
    found = _coherence("deferred-packed", lanes, steps, _Lockstep.of_lengths(group, lists.sizes[cell], lanes))
    return _with_lines(found, group, cell, lists, lanes, 1)


def lines_of(lists: Lists, line: int) -> np.ndarray:
    """Lines of `line` bytes that each reference's triangle lies in, the first triangle at the start of one."""
    begin = lists.references.astype(np.int64) * lists.triangle_bytes
    return (begin + lists.triangle_bytes - 1) // line - begin // line + 1


def _with_lines(found: Coherence, group: np.ndarray, cell: np.ndarray, lists: Lists, lanes: int, rounds: int):
    """Adds the distinct lines of each trip: lane by lane, trip k loads triangle k of the lane's cell.

    Where there are too many loads, those of every n-th group of rays count, all `rounds` of it.
    """
    loads = lists.sizes[cell].astype(np.int64)
    stride = max(1, -(-int(loads.sum()) // MOST_LOADS))
    kept = group // rounds % stride == 0
    group, cell = group[kept], cell[kept]
    tests = _Lockstep.of_lengths(group, lists.sizes[cell], lanes)
    found.line_trips, found.line_tests = tests.trips, tests.work
    # Lanes in the same cell load the same lines.
    both = np.stack(np.divmod(distinct(group * len(lists.sizes) + cell), len(lists.sizes)), axis=1)
    ends = np.cumsum(lists.sizes[both[:, 1]])
    first = 0
    while first < len(both):
        done = ends[first - 1] if first else 0
        last = max(int(np.searchsorted(ends, done + _BLOCK)), first + 1)
        # A block ends where a group does.
        last = int(np.searchsorted(both[:, 0], both[last - 1, 0], side="right"))
        for line in LINES:
            name = f"lines_{line}"
            setattr(found, name, getattr(found, name) + _distinct(both[first:last], lists, line))
        first = last
    return found


def _distinct(both: np.ndarray, lists: Lists, line: int) -> int:
    """Distinct (group, trip, line) of lanes given as group and cell, int64[n,2]."""
    sizes = lists.sizes[both[:, 1]]
    total = int(sizes.sum())
    trip = np.arange(total) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    begin = lists.references[np.repeat(lists.start[both[:, 1]], sizes) + trip].astype(np.int64) * lists.triangle_bytes
    low, high = begin // line, (begin + lists.triangle_bytes - 1) // line
    number = np.concatenate([[0], np.cumsum(np.diff(both[:, 0]) != 0)])[: len(both)]
    key = np.repeat(number, sizes) * (int(sizes.max(initial=0)) + 1) + trip
    width = int(high.max(initial=0)) + 1
    crossing = [
        key[high > low + extra] * width + (low + extra + 1)[high > low + extra]
        for extra in range(lists.triangle_bytes // line + 1)
    ]
    return len(distinct(np.concatenate([key * width + low, *crossing])))


def distinct(values: np.ndarray) -> np.ndarray:
    """`values` int64[n] in ascending order, each once: by sorting, which is ten times as fast as numpy's hashing."""
    values = np.sort(values)
    return values[np.concatenate([[True], values[1:] != values[:-1]])[: len(values)]]


WIDTHS = (8, 32)


def measure_coherence(
    specs: Sequence[RunSpec], wave: int, scenes: Scenes, tell: Callable[[Progress], None] = lambda _: None
) -> CoherenceBody:
    """What a row says of one scene; `specs`: the forward run and the deferred one.

    Raises DefrayError where the sequences do not make the tracers' own counts.
    """
    group = Group(specs, scenes, tell)
    forward, deferred = map(group.open_run, specs)
    intersector, prepared = forward.tracer.intersector, group.prepared
    lists = lists_of(prepared.structure, intersector.bytes)
    counts = []
    for run, length in ((forward, 1), (deferred, wave)):
        sequences = record_sequences(prepared, intersector, group.rays, length)
        compare_counts(sequences, lists, run.tracer.count(group.rays), str(run.spec.variant))
        for lanes in WIDTHS:
            if run is forward:
                counts.append(forward_coherence(sequences, lists, lanes))
            else:
                counts += deferred_coherence(sequences, lists, lanes)
    return CoherenceBody(
        id=id_of(specs[0], wave),
        scene=scene_facts(group.shared.scene),
        intersector=intersector.name,
        wave=wave,
        grid=describe_structure(prepared.structure),
        rays=ray_facts(group.rays),
        counts=counts,
    )


def id_of(forward: RunSpec, wave: int) -> str:
    """The id of the row of a forward run and the deferred one beside it."""
    facts = {"scene": forward.scene, "rays": forward.rays, "kind": forward.kind, "seed": forward.seed}
    grid = {"density": None} | forward.structure.to_json()
    return identity(**facts, grid=grid, wave=wave, intersector=forward.variant.intersector, what="coherence")


def compare_counts(sequences, lists, counters, variant: str) -> None:
    """Raise DefrayError unless the sequences make exactly the steps, pairs and tests that the tracer counted."""
    met = sequences.cell[sequences.cell >= 0]
    ours = {"steps": len(sequences.cell), "pairs": len(met), "tests": int(lists.sizes[met].sum())}
    for name, value in ours.items():
        counted = getattr(counters, name)
        if value != counted:
            raise DefrayError(f"the sequences of {variant} make {value:,} {name}, but the tracer counts {counted:,}")


class CoherenceStudy(Study):
    """Exact counts of lanes at work and cache lines, forward and deferred."""

    name = "coherence"
    unit, good = "scenes", "counted"

    def tasks(self, specs: Sequence[RunSpec], wave: int) -> list[Task]:
        """One task of one part: a forward run of a scene and a deferred one of `wave` cells a ray."""
        forward = specs[0]
        part = Part(id_of(forward, wave), f"{forward.scene} coherence", tuple(specs))
        cost = guessed_seconds(forward.scene, [(spec.variant, 10 * spec.rays) for spec in specs], forward.rays)
        return [Task(self, forward.scene, forward.scene, (part,), cost, wave)]

    def file(self, folder: Path, machine: Machine) -> RecordFile[CoherenceRow]:
        """`coherence.jsonl`."""
        return coherence_file(folder)

    def measure(self, task: Task, scenes: Scenes, tell: Tell) -> Iterator[CoherenceRow]:
        """The row of one scene."""
        (part,) = task.parts
        body = measure_coherence(part.what, task.plan, scenes, lambda step: tell(Step(None, step.stage, step.done)))
        yield finish(CoherenceRow, body, machine_description(scenes.device))

    def outcome(self, row: CoherenceRow) -> str:
        """How many rays were counted."""
        return f"{row.rays.count:,} rays counted"
