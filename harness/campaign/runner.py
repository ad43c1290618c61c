"""Sweeps: run a tier's plan group by group, store every record at once, resume where a kill stopped it.

The folder of a sweep holds `sweep.json` (how it was started), `env.json` (the machine), `records.jsonl`,
and `errors.jsonl` with the runs that could not be carried out.
"""

from __future__ import annotations

import random
import signal
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from rich.console import Console
from rich.markup import escape

from harness.campaign.folder import (
    SweepRequest,
    _describe_machine,
    _header,
    _message,
    _store_error,
    _Sweep,
    locked,
)
from harness.campaign.plan import AccuracyRequest, SceneTask, expand
from harness.campaign.progress import Display, SceneProgress, TimeLeft, scene_progress
from harness.device.machine import environment_description, machine_description
from harness.device.opened import open_device
from harness.errors import DefrayError
from harness.inputs.memory import announcements
from harness.inputs.scenes import expected_triangles, load_scene
from harness.measure.pipeline import run_group
from harness.measure.scene import shared_scene
from harness.records.accuracy_row import AccuracyRow, accuracy_file
from harness.records.origin import finish, identity
from harness.records.precision_row import PrecisionRow, precision_file
from harness.records.record_file import RecordFile
from harness.records.run_row import Record
from harness.records.schema import Row
from harness.spec.run_spec import RunSpec
from harness.studies.errors_and_leaks import default_contenders, describe, measure_accuracy
from harness.studies.needed_precision import SAMPLES, measure_precision


def run_accuracy(request: AccuracyRequest) -> list[AccuracyRow]:
    """Measure, store every row as soon as it is whole, and return the rows of the request, those on file included.

    Raises DefrayError where a scene, a variant or the folder cannot be used.
    """
    console = Console(stderr=True)
    device = open_device(request.device)
    parts = [replace(part, contenders=part.contenders or default_contenders(device)) for part in request.parts]
    with locked(request.out):
        file = accuracy_file(request.out)
        rows = file.repair()
        stored = stored_rows(rows, device)
        if rows and not request.resume:
            raise DefrayError(f"{file.path} already has rows; pass --resume to go on, or choose another --out")
        facts = {part.scene: _facts_on_file(part, stored) for part in parts}
        missing = [_missing(part, stored, facts[part.scene]) for part in parts]
        with scene_progress(console, sum(bool(part.contenders) for part in missing)) as progress:
            for part in missing:
                for row in _measured(part, device, progress):
                    file.append(row)
                    stored |= stored_rows([row], device)
                    facts[part.scene] = row.scene.geometry
                    progress.line(describe(row))
        with scene_progress(console, sum(part.precision for part in parts)) as progress:
            _run_precision(request, parts, device, progress)
    console.print(f"{len(stored)} rows in {file.path}", highlight=False, soft_wrap=True, markup=False)
    return [stored[part.plan.id_of(part.scene, one), *facts[part.scene]] for part in parts for one in part.contenders]


def stored_rows(rows: Sequence[Row], device) -> dict[tuple, Row]:
    """Rows of a device by id and by what they were measured on: a mesh that has changed since is another one."""
    return {(row.id, *row.scene.geometry): row for row in rows if row.machine.device == device.name}


def _facts_on_file(part: SceneTask, stored: dict[tuple, Row]) -> tuple[str, str] | None:
    """The scene's geometry as it is now; None where no row on file might be of it, and it is not loaded."""
    ids = {part.plan.id_of(part.scene, one) for one in part.contenders}
    if not any(key[0] in ids for key in stored):
        return None
    scene = load_scene(part.scene)
    return scene.source, scene.sha256


def _missing(part: SceneTask, stored: dict[tuple, Row], facts: tuple[str, str] | None) -> SceneTask:
    """The part without the contenders that are on file, measured on the scene as it is now."""
    return replace(
        part,
        contenders=[
            one
            for one in part.contenders
            if facts is None or (part.plan.id_of(part.scene, one), *facts) not in stored
        ],
    )


def _measured(part: SceneTask, device, progress: SceneProgress) -> Iterator[AccuracyRow]:
    """Whole rows of one scene."""
    if not part.contenders:
        return
    progress.start(part.scene)
    shared = shared_scene(part.scene, device)
    for body in measure_accuracy(shared, part.contenders, part.plan, device, progress.tell):
        named = part.plan.id_of(part.scene, body.variant)
        yield finish(AccuracyRow, body, machine_description(device), id=named)
    progress.end()


def _run_precision(request: AccuracyRequest, parts: list[SceneTask], device, progress: SceneProgress) -> None:
    """Measure what precision.jsonl lacks, scene by scene."""
    file = precision_file(request.out)
    stored = stored_rows(file.repair(), device)
    for part in parts:
        rays, repetitions = part.plan.rays, part.plan.repetitions
        facts = {"scene": part.scene, "rays": rays, "repetitions": repetitions}
        if not part.precision:
            continue
        progress.start(part.scene)
        shared = shared_scene(part.scene, device)
        last = identity(**facts, knob="samples", value=str(SAMPLES[-1]))  # the others are stored before it
        if (last, shared.scene.source, shared.scene.sha256) in stored:
            progress.end()
            continue
        for body in measure_precision(shared, rays, repetitions, device, progress.tell):
            named = identity(**facts, knob=body.knob, value=body.value)
            file.append(finish(PrecisionRow, body, machine_description(device), id=named))
        progress.end()
        progress.line(f"{part.scene} … precision and resolution: rows in {file.path}")


INTERRUPTED, TERMINATED = 130, 143


class _Terminated(BaseException):
    """SIGTERM arrived; not an Exception, so that nothing on the way mistakes it for a failed run."""


def run_sweep(request: SweepRequest, console: Console | None = None) -> int:
    """Run a sweep and return its exit code: 0, 1 (a check or a run failed), 130 or 143 (stopped).

    Raises DefrayError when it cannot start: a bad file, a folder in use or with other results, no device.
    """
    console = console or Console(stderr=True)
    specs = expand(request.file, request.tier)
    with locked(request.out):
        sweep = _open_sweep(request, specs, console)
        try:
            with _terminable():
                _run_all(sweep)
        except (KeyboardInterrupt, _Terminated) as stop:
            # Counted on file: the signal may have come between storing a record and noting it.
            done = len(sweep.records.done_ids() & {spec.id for spec in specs})
            line = f"stopped after {done} of {len(specs)} runs; go on with: {request.resume_command()}"
            console.print(escape(line), highlight=False, soft_wrap=True)
            return TERMINATED if isinstance(stop, _Terminated) else INTERRUPTED
    return _summary(sweep)


def shuffled_groups(specs: Sequence[RunSpec], seed: int) -> list[list[RunSpec]]:
    """Runs by group, in the random order that `seed` gives.

    Scenes, the sets of rays of a scene, their groups and the runs of a group are shuffled; groups of one scene stay
    together, and those with the same rays, so that each scene is loaded and each set of rays made once.
    """
    scenes: dict[str, dict[tuple, dict[tuple, list[RunSpec]]]] = {}
    for spec in specs:
        scenes.setdefault(spec.scene, {}).setdefault(spec.workload, {}).setdefault(spec.group, []).append(spec)
    generator = random.Random(seed)

    def shuffled(items: Iterable) -> list:
        items = list(items)
        generator.shuffle(items)
        return items

    return [
        shuffled(group)
        for scene in shuffled(scenes.values())
        for workload in shuffled(scene.values())
        for group in shuffled(workload.values())
    ]


def _open_sweep(request: SweepRequest, specs: list[RunSpec], console: Console) -> _Sweep:
    """Start anew or resume; checks that the folder's results belong to the same plan."""

    def warn(message: str) -> None:
        console.print(f"[yellow]warning:[/yellow] {escape(message)}", highlight=False, soft_wrap=True)

    records = RecordFile(request.out / "records.jsonl", warn=warn)
    if not request.resume and records.path.exists() and records.path.stat().st_size:
        raise DefrayError(f"{request.out} already has records; pass --resume to go on, or choose another --out")
    stored = {record.id: not record.failed for record in records.repair()}
    header = _header(request, specs, warn)
    planned = {spec.id for spec in specs}
    sweep = _Sweep(request, specs, console, records, {k: v for k, v in stored.items() if k in planned})
    for group in shuffled_groups(specs, header.seed):
        remaining = [spec for spec in group if spec.id not in stored]
        if remaining:
            sweep.waiting.append(remaining)
    return sweep


@contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM stop the sweep in order, as Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_) -> None:
        raise _Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _run_all(sweep: _Sweep) -> None:
    if not sweep.waiting:
        return
    device = open_device(sweep.request.device)
    _describe_machine(sweep, environment_description(device))
    triangles = _known_triangles(sweep.specs)
    for line in announcements(triangles.items()):
        sweep.console.print(line, highlight=False, soft_wrap=True, markup=False)
    time_left = TimeLeft(triangles)
    with Display(sweep.console, len(sweep.specs), len(sweep.stored), time_left) as display:
        while sweep.waiting:
            _run_group(sweep, sweep.waiting.pop(0), device, display)


def _known_triangles(specs: list[RunSpec]) -> dict[str, int]:
    """About how many triangles each scene has, for the time left; that of a mesh file is guessed there."""
    counts = {name: expected_triangles(name) for name in dict.fromkeys(spec.scene for spec in specs)}
    return {name: count for name, count in counts.items() if count}


def _run_group(sweep: _Sweep, specs: list[RunSpec], device, display: Display) -> None:
    """Run one group; after a failed run, those of the group that are not done run again without it."""
    display.start_group(specs, sweep.waiting)
    errors_before = sweep.errors
    remaining = list(specs)
    while remaining:
        try:
            _attempt(sweep, remaining, device, display)
        except _RunFailed as failure:
            # Without a culprit it was the scene, the rays or the grid, which all runs of the group share.
            for spec in [failure.culprit] if failure.culprit else list(remaining):
                remaining.remove(spec)
                _store_error(sweep, spec, failure.error)
                display.failed(spec, _message(failure.error))
    display.end_group(whole=sweep.errors == errors_before)


class _RunFailed(Exception):
    """An error that struck the run `culprit`, or the whole group where that is None."""

    def __init__(self, error: Exception, culprit: RunSpec | None):
        super().__init__(str(error))
        self.error, self.culprit = error, culprit


def _attempt(sweep: _Sweep, remaining: list[RunSpec], device, display: Display) -> None:
    """Run what remains of a group; every finished run is stored and taken out of `remaining`."""
    running: RunSpec | None = None

    def progress(step) -> None:
        nonlocal running
        running = step.spec
        display.progress(step)

    results = run_group(list(remaining), device, progress)
    while remaining:
        try:
            spec, body = next(results)
        except StopIteration:
            raise _RunFailed(DefrayError("the pipeline returned no result"), None) from None
        except Exception as error:  # a fault in one run must not cost the others theirs
            raise _RunFailed(error, running if running in remaining else None) from error
        try:
            record = finish(Record, body, machine_description(device), id=spec.id)
        except DefrayError as error:
            raise _RunFailed(error, spec) from error
        sweep.records.append(record)
        sweep.stored[spec.id] = not record.failed
        remaining.remove(spec)
        display.finished(spec, record)


def _summary(sweep: _Sweep) -> int:
    """Print the last line; the exit code is 1 if any run on file is invalid or any could not run."""
    valid = sum(sweep.stored.values())
    invalid = len(sweep.stored) - valid
    parts = [f"{len(sweep.specs)} runs: {valid} valid"]
    if invalid:
        parts.append(f"[red]{invalid} failed the check and have no rate[/red]")
    if sweep.errors:
        where = escape(str(sweep.request.out / "errors.jsonl"))
        parts.append(f"[red]{sweep.errors} could not run (see {where})[/red]")
    line = ", ".join(parts) + f"; records in {escape(str(sweep.records.path))}"
    sweep.console.print(line, highlight=False, soft_wrap=True)
    return 1 if invalid or sweep.errors else 0
