"""A tier of a sweep file carried out.

Beside `records.jsonl` the folder holds `sweep.json` (how it was started) and `env.json` (the machine).
"""

from __future__ import annotations

import hashlib
import json
import secrets
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.markup import escape

from harness.campaign.executors import Executor, Local
from harness.campaign.folder import locked, write_json
from harness.campaign.plan import expand
from harness.campaign.runner import CampaignResult, carry_out, refuse_rows
from harness.device.opened import open_device
from harness.errors import DefrayError
from harness.files import command_line, commit_and_dirty, now_utc
from harness.spec.run_spec import RunSpec
from harness.studies.runs import RunStudy


@dataclass
class SweepRequest:
    """What `defray sweep` was asked: the sweep file, its tier, the folder for results and the device.

    `seed` shuffles the order of the runs; None draws one, and a resumed sweep keeps its first. `command` goes on
    with it where that is not `defray sweep`.
    """

    file: Path
    tier: str
    out: Path
    resume: bool = False
    device: str | None = None
    seed: int | None = None
    command: str | None = None

    def resume_command(self) -> str:
        """The command that goes on with this sweep."""
        command = ["defray", "sweep", str(self.file), "--tier", self.tier, "--out", str(self.out), "--resume"]
        return self.command or shlex.join(command + (["--device", self.device] if self.device else []))


def run_sweep(
    request: SweepRequest, console: Console | None = None, executor: Executor | None = None
) -> CampaignResult:
    """Run a sweep.

    Raises DefrayError when it cannot start: a bad file, a folder in use or with other results, no device.
    """
    console = console or Console(stderr=True)
    specs, study = expand(request.file, request.tier), RunStudy()

    def warn(message: str) -> None:
        console.print(f"[yellow]warning:[/yellow] {escape(message)}", highlight=False, soft_wrap=True)

    with locked(request.out):
        file = study.file(request.out, {})
        file.warn = warn
        if not request.resume:
            refuse_rows(file.path)
        on_file = {study.id_of(row) for row in file.repair()}
        header = _header(request, specs, warn)
        executor = executor or Local(open_device(request.device))
        if any(spec.id not in on_file for spec in specs):
            _describe_machine(request.out, executor.environment(), bool(on_file))
        tasks = study.tasks(specs, header.seed)
        return carry_out(tasks, executor, request.out, request.resume, request.resume_command(), console)


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


def _describe_machine(out: Path, machine: dict, has_runs: bool) -> None:
    """Write `env.json`, or refuse to add another machine's runs to those in the folder."""
    path = out / "env.json"
    if has_runs and path.exists():
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
