"""Instructions of the loop over triangles as PoCL compiled it on this machine: what a flop count leaves out.

Needs PoCL on a CPU and objdump; where either is missing there are simply no counts.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from harness.errors import DefrayError
from harness.files import ROOT

LINE = re.compile(r"^\s*([0-9a-f]+):\s+(\S+)\s*(.*)$")
ARITHMETIC = re.compile(r"^v?(?:fn?m(?:add|sub)\w*|(?:add|sub|mul|div|min|max)[ps][sd])$")
# A small scene traced once, so that the runtime compiles the kernel that measurements run.
RUN = """
import sys
import numpy as np
from harness.data import Rays, Scene
from harness.device.opened import open_device
from harness.spec.structure import Uniform
from harness.tracers import open_tracer
from harness.tracers.prepared import Prepared
device, random = open_device("Portable Computing Language"), np.random.default_rng(1)
triangles = (random.random((500, 1, 3)) + 0.2 * random.random((500, 3, 3))).astype(np.float32)
prepared = Prepared.on_device(Scene("made up", triangles), device).with_structure(Uniform(2, 8))
count = 1 << 18
rays = Rays(random.random((count, 3), np.float32), random.normal(size=(count, 3)).astype(np.float32),
            np.full(count, np.inf, np.float32))
open_tracer(prepared, ":".join(["deferred", *sys.argv[1:]])).timed(rays)
"""


@dataclass(frozen=True)
class Loop:
    """Instructions of one trip: all, floating-point ones (an fma is one), and those that read or write the stack."""

    instructions: int
    arithmetic: int
    stack: int
    text: str


def inner_loop(intersector: str, **options: str) -> Loop:
    """The loop over triangles of `intersect_bins`; raises DefrayError where it cannot be looked at."""
    objdump = shutil.which("objdump") or shutil.which("llvm-objdump")
    if not objdump:
        raise DefrayError("no objdump on this machine; install binutils")
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", RUN, intersector, *(f"{key}={value}" for key, value in options.items())]
        environment = {**os.environ, "POCL_CACHE_DIR": folder}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, cwd=ROOT)
        if done.returncode:
            raise DefrayError(f"the kernels of {intersector} cannot be compiled: {done.stderr.strip()[-200:]}")
        built = sorted(Path(folder).glob("**/intersect_bins/**/*.so"))
        if not built:
            raise DefrayError("the runtime keeps no compiled kernels; only PoCL on a CPU does")
        listing = subprocess.run(
            [objdump, "-d", "--no-show-raw-insn", str(built[0])], capture_output=True, text=True, check=True
        ).stdout
    return triangle_loop(listing)


def triangle_loop(listing: str) -> Loop:
    """The innermost loop of a disassembly with most floating-point instructions."""
    code = [(int(m[1], 16), m[2], m[3]) for m in map(LINE.match, listing.splitlines()) if m]
    place = {address: number for number, (address, _, _) in enumerate(code)}
    loops = []
    for number, (address, name, operands) in enumerate(code):
        target = re.match(r"^(?:0x)?([0-9a-f]+)", operands)
        if name.startswith("j") and target and int(target[1], 16) <= address and int(target[1], 16) in place:
            loops.append((place[int(target[1], 16)], number + 1))
    innermost = [(a, b) for a, b in loops if not any(a <= c and d <= b and (a, b) != (c, d) for c, d in loops)]
    if not innermost:
        raise DefrayError("the compiled kernel has no loop")
    bodies = [code[a:b] for a, b in innermost]
    body = max(bodies, key=lambda lines: sum(bool(ARITHMETIC.match(name)) for _, name, _ in lines))
    return Loop(
        instructions=len(body),
        arithmetic=sum(bool(ARITHMETIC.match(name)) for _, name, _ in body),
        stack=sum("(%rsp" in operands or "(%rbp" in operands for _, _, operands in body),
        text="\n".join(f"{name} {operands}" for _, name, operands in body),
    )
