"""Wall clock of building, choosing rays and tracing; `make bench` runs these, the quick tests skip them."""

from __future__ import annotations

import pytest
from shapes import icosphere, random_rays

from harness import structures
from harness.data import Scene
from harness.device.stopwatch import Stopwatch
from harness.spec.intersectors import INTERSECTORS
from harness.spec.structure import Uniform
from harness.tracers import find
from harness.tracers.prepared import Prepared

SPEC = Uniform(8, 64)
RAYS = 100_000


@pytest.fixture(scope="module")
def ball(device) -> Prepared:
    """81,920 triangles and their grid."""
    prepared = Prepared.on_device(Scene("ball", icosphere(6)), device)
    return prepared.with_structure(SPEC)


def test_build_the_grid(benchmark, ball):
    grid = benchmark.pedantic(lambda: structures.build(ball.device_scene, SPEC), warmup_rounds=1, rounds=5)
    assert grid.describe()["references"] >= len(ball.scene)
    benchmark.extra_info.update(grid.describe())


@pytest.mark.parametrize("intersector", INTERSECTORS)
@pytest.mark.parametrize("tracer", ["deferred", "forward", "work-optimal"])
def test_trace(benchmark, ball, tracer, intersector):
    """The device's own stage times stand in extra_info, in nanoseconds a ray."""
    made = find(tracer)(ball, INTERSECTORS[intersector], {})
    rays = random_rays(RAYS, low=-0.9, high=0.9)
    watches = []

    def run():
        watches.append(Stopwatch(ball.device.queue))
        return made.trace(rays, watches[-1])

    hits = benchmark.pedantic(run, warmup_rounds=1, rounds=5)
    assert (hits.primitive >= 0).mean() > 0.5
    best = min(watches, key=lambda watch: watch.seconds["total"])
    stages = {f"{stage}_ns": 1e9 * seconds / RAYS for stage, seconds in best.seconds.items()}
    benchmark.extra_info.update(stages, device=ball.device.title, counters=made.count(rays).model_dump())
