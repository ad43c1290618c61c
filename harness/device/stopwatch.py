"""Stage times from device event markers, total time from the wall clock."""

from __future__ import annotations

import time
from collections import defaultdict
from contextlib import contextmanager
from dataclasses import dataclass, field

from harness.device.opened import Device
from harness.device.program import launch_listeners
from harness.device.runtime import cl

OUTSIDE = "other"  # stage of kernels that no stage holds


@dataclass
class KernelTime:
    """Launches of one kernel in one stage and their device time, seconds."""

    launches: int = 0
    seconds: float = 0.0


class Stopwatch:
    """Times one repetition. `seconds` holds each stage's sum after the last `total` block has ended."""

    def __init__(self, queue: cl.CommandQueue | None):
        self.queue = queue
        self.seconds: dict[str, float] = defaultdict(float)
        self._marks: list[tuple[str, cl.Event, cl.Event]] = []

    @contextmanager
    def stage(self, name: str):
        """Device time between a marker before the block's commands and one after them."""
        before = cl.enqueue_marker(self.queue)
        yield
        self._marks.append((name, before, cl.enqueue_marker(self.queue)))

    @contextmanager
    def total(self):
        """Wall clock of the block, up to the end of everything it enqueued; a block that fails has no time."""
        if self.queue:
            self.queue.finish()
        started = time.perf_counter()
        try:
            yield
        except BaseException:
            self._marks.clear()
            raise
        if self.queue:
            self.queue.finish()
        self.seconds["total"] += time.perf_counter() - started
        for name, before, after in self._marks:
            self.seconds[name] += 1e-9 * (after.profile.end - before.profile.end)
        self._marks.clear()


class CpuStopwatch(Stopwatch):
    """Processor time of this process over the device's cores: what a CPU device worked, whoever else was working.

    Every stage waits for its commands, so a whole run is a little slower than without.
    """

    def __init__(self, device: Device):
        super().__init__(device.queue)
        self.cores = device.compute_units

    @contextmanager
    def _timed(self, name: str):
        self.queue.finish()
        started = time.process_time()
        yield
        self.queue.finish()
        self.seconds[name] += (time.process_time() - started) / self.cores

    def stage(self, name: str):
        """Processor time of the block's commands."""
        return self._timed(name)

    def total(self):
        """Processor time of the block."""
        return self._timed("total")


@dataclass(eq=False)
class KernelWatch(Stopwatch):
    """A stopwatch that also times each kernel: `kernels` by (stage, name), once a `total` block has ended.

    What a stage takes beyond its kernels (prefix sums, fills, the host's waits for a count) is `rest(stage)`.
    """

    queue: object
    kernels: dict[tuple[str, str], KernelTime] = field(default_factory=dict)

    def __post_init__(self):
        super().__init__(self.queue)
        self._stage = OUTSIDE
        self._events: list[tuple[str, str, object]] = []

    @contextmanager
    def stage(self, name: str):
        """As of a stopwatch; kernels launched inside are this stage's."""
        with super().stage(name):
            self._stage = name
            try:
                yield
            finally:
                self._stage = OUTSIDE

    @contextmanager
    def total(self):
        """As of a stopwatch; a block that fails leaves no kernel behind."""
        launch_listeners.append(self._launched)
        try:
            with super().total():
                yield
            for stage, name, event in self._events:
                time = self.kernels.setdefault((stage, name), KernelTime())
                time.launches += 1
                time.seconds += 1e-9 * (event.profile.end - event.profile.start)
        finally:
            launch_listeners.remove(self._launched)
            self._events.clear()

    def _launched(self, name: str, event) -> None:
        self._events.append((self._stage, name, event))

    def rest(self, stage: str) -> float:
        """Seconds of a stage outside its kernels; of `other`, of the whole trace outside stages and kernels."""
        kernels = sum(time.seconds for (where, _), time in self.kernels.items() if where == stage)
        if stage == OUTSIDE:
            kernels += sum(seconds for name, seconds in self.seconds.items() if name != "total")
            return max(0.0, self.seconds["total"] - kernels)
        return max(0.0, self.seconds.get(stage, 0.0) - kernels)
