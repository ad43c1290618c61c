"""Time and peak memory of generating the stand-ins and of building their grids, each in a process of its own."""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from harness import structures
from harness.device.opened import open_device
from harness.errors import DefrayError
from harness.inputs.scenes_by_name import SEED, list_scenes, real_scene, stand_in_scene
from harness.spec.structure import Uniform
from harness.structures.device_scene import upload_scene
from scenes import recipes

GRID = Uniform(8, 128)
LIMIT_BYTES = 12 * 2**30  # of peak memory
STEPS = ("generate", "build", "build real")


@dataclass(frozen=True)
class Footprint:
    """What one step took.

    `seconds`: wall clock; `cpu_seconds`: of all threads together, which other work on the machine does not stretch.
    `peak_bytes`: the largest resident size of the step's process, the libraries included.
    """

    scene: str
    step: str
    triangles: int
    seconds: float
    cpu_seconds: float
    peak_bytes: int

    @property
    def inside(self) -> bool:
        """Whether the peak stays within the limit."""
        return self.peak_bytes <= LIMIT_BYTES

    def to_json(self) -> dict:
        """For standard output."""
        return asdict(self)


def measure_here(name: str, step: str, device_part: str | None = None) -> Footprint:
    """Do one step in this process, which should be a fresh one; raises DefrayError for an unknown step."""
    recipe = recipes()[name]
    if step == "generate":
        started, cpu_started = time.perf_counter(), time.process_time()
        count = len(recipe.stand_in(SEED))
        seconds = time.perf_counter() - started
    elif step in STEPS:
        scene = stand_in_scene(recipe) if step == "build" else real_scene(recipe)
        uploaded = upload_scene(open_device(device_part), scene.triangles)
        structures.build(uploaded, GRID)  # compiles what the builder needs
        cpu_started = time.process_time()
        seconds, count = structures.build(uploaded, GRID).build_seconds, len(scene)
    else:
        raise DefrayError(f"unknown step '{step}'; known: {', '.join(STEPS)}")
    cpu_seconds = time.process_time() - cpu_started
    return Footprint(name, step, count, seconds, cpu_seconds, peak_bytes())


def peak_bytes() -> int:
    """The largest resident size of this process so far."""
    try:
        # Linux's rusage begins with the size of the process that started this one.
        status = Path("/proc/self/status").read_text()
        return 1024 * int(re.search(r"^VmHWM:\s*(\d+) kB$", status, re.MULTILINE)[1])
    except (OSError, TypeError):
        unit = 1 if sys.platform == "darwin" else 1024  # kilobytes elsewhere than on macOS
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def measure_footprint(name: str, step: str, device_part: str | None = None) -> Footprint:
    """One step in a fresh process; raises DefrayError with its last line where it fails."""
    command = [
        sys.executable,
        "-m",
        "harness.studies.stand_ins.footprint",
        name,
        step,
        *([device_part] if device_part else []),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["it printed nothing"])[-1]
        raise DefrayError(f"step '{step}' of {name} failed: {last}")
    return Footprint(**json.loads(done.stdout))


def footprints(
    names: Sequence[str], device_part: str | None = None, progress: Callable[[str], None] | None = None
) -> list[Footprint]:
    """Every step of every scene; the real one's too where DEFRAY_SCENES holds it."""
    results = []
    real = {status.name for status in list_scenes() if status.source == "real"}
    for name in names:
        steps = STEPS if name in real else STEPS[:-1]
        for step in steps:
            if progress:
                progress(f"{name}: {step}")
            results.append(measure_footprint(name, step, device_part))
    return results


if __name__ == "__main__":
    print(json.dumps(measure_here(*sys.argv[1:]).to_json()))
