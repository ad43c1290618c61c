"""Stage times from device event markers, total time from the wall clock."""

from __future__ import annotations

import time
from collections import defaultdict
from contextlib import contextmanager

from harness.device import Device
from harness.runtime import cl


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
