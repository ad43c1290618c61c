"""The folder of a campaign: locked, its header compared, its machine described, its errors stored."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shlex
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from filelock import FileLock, Timeout
from pydantic import BaseModel, ConfigDict
from rich.console import Console

from harness.campaign.progress import run_name
from harness.errors import DefrayError
from harness.files import append_line, command_line, commit_and_dirty, now_utc
from harness.records.record_file import RecordFile
from harness.spec.run_spec import RunSpec


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
