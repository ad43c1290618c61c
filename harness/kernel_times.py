"""Device time of every kernel of a repetition, by its name, from the events of its launches."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, field

from harness.program import launch_listeners
from harness.stopwatch import Stopwatch

OUTSIDE = "other"  # stage of kernels that no stage holds


@dataclass
class KernelTime:
    """Launches of one kernel in one stage and their device time, seconds."""

    launches: int = 0
    seconds: float = 0.0


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
