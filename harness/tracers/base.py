"""The contract of tracers, and options given as text."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from pydantic import BaseModel, ConfigDict, ValidationError

from harness.data import Counters, Hits, Rays
from harness.device.stopwatch import Stopwatch
from harness.errors import DefrayError, known
from harness.spec.intersectors import Intersector
from harness.tracers.prepared import Prepared


class Options(BaseModel):
    """Options of a tracer; a tracer's own class adds to it."""

    model_config = ConfigDict(extra="forbid")


class Tracer(ABC):
    """One way of finding first hits."""

    name: ClassVar[str]
    needs_device: ClassVar[bool] = True
    needs_structure: ClassVar[bool] = False
    needs_intersector: ClassVar[bool] = True
    warm_up_rays: ClassVar[int] = 1 << 16  # enough to run every kernel, its later waves included
    Options: ClassVar[type[Options]] = Options

    def __init__(self, prepared: Prepared, intersector: Intersector | None, options: dict[str, str]):
        self.prepared, self.intersector = prepared, intersector
        self.options = parse_options(type(self), options)

    @abstractmethod
    def trace(self, rays: Rays, watch: Stopwatch) -> Hits:
        """First hits of all rays; adds the times to `watch`."""

    @abstractmethod
    def count(self, rays: Rays) -> Counters:
        """Exact work counts, from an instrumented run."""

    def stopwatch(self) -> Stopwatch:
        """A new stopwatch on the tracer's device, or of wall clock alone where it has none."""
        return Stopwatch(self.prepared.device.queue if self.needs_device else None)

    def timed(self, rays: Rays) -> tuple[Hits, dict[str, float]]:
        """First hits, and the seconds of each stage and in `total`."""
        watch = self.stopwatch()
        hits = self.trace(rays, watch)
        return hits, watch.seconds


def parse_options(tracer: type[Tracer], options: dict[str, str]) -> Options:
    """Validate options given as text; raises DefrayError naming the option."""
    try:
        return tracer.Options(**options)
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0]) if first["loc"] else "?"
        if first["type"] == "extra_forbidden":
            raise known(f"option of tracer {tracer.name}", name, tracer.Options.model_fields) from None
        reason = first["msg"].removeprefix("Value error, ").lower()
        raise DefrayError(f"option {name}={options.get(name)} of {tracer.name}: {reason}") from None
