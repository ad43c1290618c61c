"""Stage times from device event markers, total time from the wall clock."""

from __future__ import annotations

import time
from collections import defaultdict
from contextlib import contextmanager

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
