"""Sweeps: run a tier's plan group by group, store every record at once, resume where a kill stopped it.

The folder of a sweep holds `sweep.json` (how it was started), `env.json` (the machine), `records.jsonl`,
and `errors.jsonl` with the runs that could not be carried out.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import secrets
import shlex
import signal
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from filelock import FileLock, Timeout
from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.markup import escape

from harness.errors import DefrayError
from harness.ladder import announcements
from harness.plan import expand
from harness.progress import Display, TimeLeft, run_name
from harness.record import RecordFile, append_line, command_line, commit_and_dirty, finish, now_utc
from harness.spec import RunSpec

INTERRUPTED, TERMINATED = 130, 143


@dataclass
class SweepRequest:
    """What `defray sweep` was asked: the sweep file, its tier, the folder for results and the device.

    `seed` shuffles the order of the runs; None draws one, and a resumed sweep keeps its first.
    """

    file: Path
    tier: str
    out: Path
    resume: bool = False
    device: str | None = None
    seed: int | None = None

    def resume_command(self) -> str:
        """The command that goes on with this sweep."""
        command = ["defray", "sweep", str(self.file), "--tier", self.tier, "--out", str(self.out), "--resume"]
        return shlex.join(command + (["--device", self.device] if self.device else []))


@dataclass
class _Sweep:
    """A sweep in progress."""

    request: SweepRequest
    specs: list[RunSpec]
    console: Console
    records: RecordFile
    stored: dict[str, bool]  # validity of every run on file, by id
    errors: int = 0
    waiting: list[list[RunSpec]] = field(default_factory=list)


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

    return [shuffled(group) for scene in shuffled(scenes.values()) for workload in shuffled(scene.values())
            for group in shuffled(workload.values())]


# ---------------------------------------------------------------- the folder


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make `folder` and hold it; raises DefrayError when it cannot be written or another measurement holds it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / ".lock", timeout=0)
        lock.acquire()
    except Timeout:
        raise DefrayError(
            f"another measurement is writing to {folder}; wait for it or choose another --out"
        ) from None
    except OSError as error:
        raise DefrayError(f"cannot write to {folder}: {error.strerror}") from None
    try:
        yield
    finally:
        lock.release()


def _open_sweep(request: SweepRequest, specs: list[RunSpec], console: Console) -> _Sweep:
    """Start anew or resume; checks that the folder's results belong to the same plan."""

    def warn(message: str) -> None:
        console.print(f"[yellow]warning:[/yellow] {escape(message)}", highlight=False, soft_wrap=True)

    records = RecordFile(request.out / "records.jsonl", warn=warn)
    if not request.resume and records.path.exists() and records.path.stat().st_size:
        raise DefrayError(
            f"{request.out} already has records; pass --resume to go on, or choose another --out"
        )
    stored = {record["id"]: passed(record) for record in records.repair()}
    header = _header(request, specs, warn)
    planned = {spec.id for spec in specs}
    sweep = _Sweep(request, specs, console, records, {k: v for k, v in stored.items() if k in planned})
    for group in shuffled_groups(specs, header.seed):
        remaining = [spec for spec in group if spec.id not in stored]
        if remaining:
            sweep.waiting.append(remaining)
    return sweep


class Header(BaseModel):
    """`sweep.json`: how a sweep was started. `plan` is a digest of the ids of all its runs."""

    model_config = ConfigDict(extra="forbid")

    tier: str
    runs: int
    plan: str
    seed: int
    device: str | None
    commit: str
    command: str
    started_utc: str


def _header(request: SweepRequest, specs: list[RunSpec], warn: Callable[[str], None]) -> Header:
    """The folder's `sweep.json`: read and compared when resuming, written otherwise."""
    path = request.out / "sweep.json"
    fresh = Header(
        tier=request.tier,
        runs=len(specs),
        plan=hashlib.sha256("".join(sorted(spec.id for spec in specs)).encode()).hexdigest()[:16],
        seed=secrets.randbelow(2**32) if request.seed is None else request.seed,
        device=request.device,
        commit=commit_and_dirty()[0],
        command=command_line(),
        started_utc=now_utc(),
    )
    if not (request.resume and path.exists()):
        write_json(path, fresh.model_dump())
        return fresh
    try:
        old = Header.model_validate_json(path.read_text())
    except (OSError, ValueError):
        raise DefrayError(f"{path} is damaged; choose another --out") from None
    for what, was, now in (
        ("tier", old.tier, fresh.tier),
        ("device", old.device, fresh.device),
        ("seed", old.seed, old.seed if request.seed is None else request.seed),
        ("a list of runs", f"{old.runs} ({old.plan})", f"{fresh.runs} ({fresh.plan})"),
    ):
        if was != now:
            raise DefrayError(f"{request.out} was started with {what} {was}, not {now}; choose another --out")
    if old.commit != fresh.commit:
        warn(f"{request.out} was started at commit {old.commit[:8]}, this is {fresh.commit[:8]}")
    return old


def _describe_machine(sweep: _Sweep, machine: dict) -> None:
    """Write `env.json`, or refuse to add another machine's runs to those in the folder."""
    path = sweep.request.out / "env.json"
    if sweep.stored and path.exists():
        try:
            old = json.loads(path.read_text())
        except (OSError, ValueError):
            raise DefrayError(f"{path} is damaged; choose another --out") from None
        for key in ("cpu", "platform", "device"):
            if old.get(key) != machine[key]:
                raise DefrayError(
                    f"{path.parent} was measured on {key} '{old.get(key)}', this is '{machine[key]}'; "
                    "choose another --out"
                )
    write_json(path, machine)


def write_json(path: Path, value: dict) -> None:
    """Replace `path` by `value` as JSON, whole or not at all."""
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n")
        os.replace(partial, path)
    except OSError as error:
        raise DefrayError(f"cannot write {path}: {error.strerror}") from None


# ---------------------------------------------------------------- running


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
    from harness.device import open_device
    from harness.environment import environment_description

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
    from harness.scene import expected_triangles

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
    from harness.pipeline import run_group

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
            record = finish(body, spec, device)
        except DefrayError as error:
            raise _RunFailed(error, spec) from error
        sweep.records.append(record)
        sweep.stored[spec.id] = passed(record)
        remaining.remove(spec)
        display.finished(spec, record)


def passed(record: dict) -> bool:
    """Whether a run did not fail its check; one that asked for none has not failed it."""
    return record["valid"] or record["agreement"]["reference"] == "none"


def _message(error: Exception) -> str:
    """One line for people."""
    if isinstance(error, DefrayError):
        return str(error)
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]


def _store_error(sweep: _Sweep, spec: RunSpec, error: Exception) -> None:
    sweep.errors += 1
    known = isinstance(error, DefrayError)
    append_line(
        sweep.request.out / "errors.jsonl",
        {
            "id": spec.id,
            "time_utc": now_utc(),
            "run": run_name(spec),
            "spec": spec.model_dump(mode="json"),
            "error": _message(error),
            "traceback": None if known else "".join(traceback.format_exception(error)),
        },
    )


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
