"""A tier of the paper's measurements carried out: all its studies into one folder, each failing for itself.

What is on file stands: a reproduction that was stopped goes on where it was.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, Field
from rich.console import Console
from rich.markup import escape

from harness.campaign.executors import Executor, one_line
from harness.campaign.runner import CampaignResult, run
from harness.campaign.sweeps import SweepRequest, run_sweep
from harness.campaign.tasks import (
    accuracy_scenes,
    accuracy_tasks,
    coherence_tasks,
    precision_tasks,
    roofline_tasks,
    stability_tasks,
)
from harness.device.opened import Device
from harness.errors import DefrayError, known
from harness.files import ROOT
from harness.studies.study import Task

TIERS = ROOT / "harness" / "paper" / "reproduce.toml"
SWEEPS = ROOT / "harness" / "paper" / "sweeps.toml"


class TierOf(BaseModel, extra="forbid"):
    """A tier of the part's own file."""

    tier: str


class Suite(BaseModel, extra="forbid"):
    """Intersectors and size of the stress suite."""

    intersector: str = "all"
    size: str


class Counted(BaseModel, extra="forbid"):
    """Scenes, rays and structure of a study; the rest is as its command has it."""

    scenes: list[str] = Field(min_length=1)
    rays: str
    structure: str = "8/128"


class Parts(BaseModel, extra="forbid"):
    """The parts of a tier, in the order they are measured; None is not measured."""

    sweep: TierOf | None = None
    accuracy: TierOf | None = None
    stability: Suite | None = None
    coherence: Counted | None = None
    roofline: Counted | None = None


def read_tier(name: str) -> Parts:
    """The parts of a tier of `reproduce.toml`; raises DefrayError for a tier that it does not have."""
    tiers = tomllib.loads(TIERS.read_text(encoding="utf-8"))["tiers"]
    if name not in tiers:
        raise known("tier", name, tiers)
    return Parts.model_validate(tiers[name])


@dataclass
class Reproduction:
    """`device` is what tasks are planned for, `asked` the part of its name that was asked for, or None.

    `command` goes on with what a signal has stopped.
    """

    tier: str
    out: Path
    device: Device
    executor: Executor
    command: str
    console: Console
    asked: str | None = None

    def measure(self) -> dict[str, int]:
        """Exit codes of the parts by name, in order; 130 or above, the last, says that a signal has stopped it."""
        parts, codes = read_tier(self.tier), {}
        for name, measure in PARTS.items():
            settings = getattr(parts, "accuracy" if name == "precision" else name)
            if settings is None:
                continue
            codes[name] = self._guarded(name, measure, settings)
            if codes[name] >= 128:
                break
        return codes

    def _guarded(self, name: str, measure: Callable, settings) -> int:
        """The exit code of one part, whatever goes wrong in it told in one line."""
        try:
            return measure(self, settings)
        except Exception as error:  # a fault in one part must not cost the others theirs
            self.console.print(
                f"[red]error:[/red] {name}: {escape(one_line(error))}", highlight=False, soft_wrap=True
            )
            return error.exit_code if isinstance(error, DefrayError) else 2

    def run(self, tasks: list[Task]) -> int:
        """The exit code of tasks of one study."""
        if not tasks:
            return 0
        found: CampaignResult = run(tasks, self.executor, self.out, True, self.command, self.console)
        return found.code


def _sweep(here: Reproduction, settings: TierOf) -> int:
    request = SweepRequest(SWEEPS, settings.tier, here.out, True, here.asked, command=here.command)
    return run_sweep(request, here.console, here.executor).code


def _accuracy(here: Reproduction, settings: TierOf) -> int:
    scenes = accuracy_scenes([], settings.tier, None, None, None)
    return here.run(accuracy_tasks(scenes, here.device))


def _precision(here: Reproduction, settings: TierOf) -> int:
    return here.run(precision_tasks(accuracy_scenes([], settings.tier, None, None, None)))


def _stability(here: Reproduction, settings: Suite) -> int:
    return here.run(stability_tasks(here.device, settings.intersector, None, settings.size))


def _coherence(here: Reproduction, settings: Counted) -> int:
    return here.run(coherence_tasks(settings.scenes, rays=settings.rays, structure=settings.structure))


def _roofline(here: Reproduction, settings: Counted) -> int:
    return here.run(roofline_tasks(settings.scenes, rays=settings.rays, structure=settings.structure))


PARTS: dict[str, Callable[[Reproduction, object], int]] = {
    "sweep": _sweep,
    "accuracy": _accuracy,
    "precision": _precision,
    "stability": _stability,
    "coherence": _coherence,
    "roofline": _roofline,
}
