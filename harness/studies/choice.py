"""How good `--structure auto` is: its rate over the best of a sweep of resolutions, its memory, its time to choose.

    python -m harness.studies.choice crown dragon sibenik --rays 1M --rounds 3

Per scene it chooses, then times every resolution of a sweep, of one tracer, with the chosen wave and two others, each
beside the chosen setting; then the best of them and the chosen one again, repetitions in turn, which gives the ratios
of rates: by processor time over the cores, which other work on the machine changes little, and by wall clock. Hits
must be the same bit for bit, or it stops. In brackets beside the memory: one reference a triangle, which no grid is
smaller than.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from harness import stats, structures, tracers
from harness.data import differing
from harness.device.opened import open_device
from harness.device.stopwatch import Stopwatch
from harness.errors import DefrayError
from harness.inputs.scenes_by_name import load_scene
from harness.measure.scene import SharedScene
from harness.spec import intersectors
from harness.spec.run_spec import RunSpec, Variant, parse_count
from harness.spec.structure import Adaptive, Uniform
from harness.spec.tracer_facts import tracer_facts
from harness.tuning import choose as auto
from harness.tuning import fit as calibrate

UNIFORM = (32, 64, 128, 256, 512)
DENSITIES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
WAVES = ({"wave": "3", "growth": "2"}, {"wave": "4"})
HEADER = (
    "scene",
    "auto's choice",
    "auto / best",
    "by wall clock",
    "best of the sweep",
    "MiB",
    "of 8/128 (least)",
    "choosing",
    "of tracing 1 M",
    "built (trial) s",
)


def main() -> int:
    """Print one row of a Markdown table a scene."""
    parser = argparse.ArgumentParser(prog="python -m harness.studies.choice", description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--rays", default="1M")
    parser.add_argument("--tracer", choices=auto.DEFERRED, default="deferred")
    parser.add_argument("--uniform", type=int, nargs="*", default=UNIFORM, help="leaf resolutions of the sweep")
    parser.add_argument("--densities", type=float, nargs="*", default=DENSITIES, help="adaptive grids of the sweep")
    parser.add_argument("--rounds", type=int, default=2, help="timed rounds over the sweep")
    parser.add_argument("--repetitions", type=int, default=7, help="of the last comparison")
    arguments = parser.parse_args()
    try:
        if parse_count(arguments.rays) < auto.FEW_RAYS:
            raise DefrayError(f"--rays {arguments.rays}: of fewer than {auto.FEW_RAYS:,} nothing is chosen")
        print(f"| {' | '.join(HEADER)} |\n|{'---|' * len(HEADER)}", flush=True)
        for scene in arguments.scenes:
            print(f"| {' | '.join(row(scene, arguments))} |", flush=True)
    except DefrayError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def row(name: str, arguments) -> list[str]:
    """Cells of one scene."""
    device, test = open_device(None), intersectors.find("ray-space")
    shared = SharedScene(load_scene(name), device)
    spec = RunSpec(scene=name, variant=Variant(tracer="embree"), rays=parse_count(arguments.rays))
    rays = shared.rays(spec)
    tracer = arguments.tracer
    choice = auto.choose(shared.prepared, rays, tracer, test, tell=lambda what: print(what, file=sys.stderr))
    print(f"{name}, {tracer}: {choice.why}", file=sys.stderr)
    name_of_grid = f"density {choice.grid.density:g}"
    chosen = Contestant(shared, choice.grid, tracer, choice.options[tracer], rays, name_of_grid)
    best, usual_bytes = best_of_sweep(shared, rays, arguments, chosen)
    ratios = []
    for wall in (False, True):
        turns = [(chosen.time(wall), best.time(wall)) for _ in range(arguments.repetitions)]
        ours, theirs = zip(*turns, strict=True)
        found = stats.ratio([1 / t for t in ours], [1 / t for t in theirs])
        ratios.append(f"{found.median:.2f} ({found.low:.2f}-{found.high:.2f})")
    per_million = float(np.median(ours)) * 1e6 / len(rays)
    size, least = choice.grid.bytes, 4 * shared.prepared.device_scene.active_count
    memory = f"{size / usual_bytes:.2f} ({least / usual_bytes:.2f})"
    return [
        name,
        chosen.name,
        *ratios,
        best.name,
        f"{size / 2**20:.1f}",
        memory,
        f"{1e3 * choice.seconds:.0f} ms",
        f"{choice.seconds / per_million:.1%}",
        f"{choice.grid.build_seconds:.2f} ({choice.trial_seconds:.2f})",
    ]


class Contestant:
    """One setting on one grid."""

    def __init__(self, shared: SharedScene, grid, tracer: str, options: dict[str, str], rays, name: str):
        prepared = shared.prepared.with_structure(grid)
        self.tracer = tracers.find(tracer)(prepared, intersectors.find("ray-space"), options)
        growth = options.get("growth", "1")
        self.wave = {"wave": options["wave"], **({} if growth == "1" else {"growth": growth})}
        self.name = f"{name}, wave {options['wave']}" + (f" growth {growth}" if growth != "1" else "")
        self.rays, self.hits = rays, None
        self.time()  # compiles

    def time(self, wall: bool = False) -> float:
        """Seconds of one repetition."""
        device = self.tracer.device
        watch = Stopwatch(device.queue) if wall else calibrate.stopwatch(device)
        self.hits = self.tracer.trace(self.rays, watch)
        return watch.seconds["total"]


def best_of_sweep(shared: SharedScene, rays, arguments, chosen: Contestant) -> tuple[Contestant, int]:
    """The fastest setting of the sweep, and the bytes of the grid 8/128; each is timed beside the chosen setting.

    A setting's time counts relative to the chosen setting's beside it, as the machine's speed may change.
    """
    best, least, usual, tracer = None, np.inf, 0, arguments.tracer
    specs = [Uniform(8, leaf) for leaf in arguments.uniform]
    for spec in specs + [Adaptive(density) for density in arguments.densities]:
        try:
            grid = structures.build(shared.prepared.device_scene, spec)
        except DefrayError as error:
            print(f"{shared.scene.name} {spec} left out: {error}", file=sys.stderr)
            continue
        usual = grid.bytes if spec == Uniform(8, 128) else usual
        for wave in (chosen.wave, *(wave for wave in WAVES if wave != chosen.wave)):
            options = {**tracer_facts(tracer).fast_options, **wave}
            one = Contestant(shared, grid, tracer, options, rays, str(spec))
            if differing(one.hits, chosen.hits):
                raise DefrayError(f"{shared.scene.name}: hits of {one.name} differ from those of {chosen.name}")
            relative = min(one.time() / chosen.time() for _ in range(arguments.rounds))
            print(f"{shared.scene.name} {one.name}: {relative:.2f} of the chosen setting's time", file=sys.stderr)
            if relative < least:
                best, least = one, relative
            if relative > 1.5:
                break  # no wave makes up for that
    return best, usual


if __name__ == "__main__":
    sys.exit(main())
