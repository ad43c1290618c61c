"""OpenCL programs: kernel files joined with their includes, built once per device and set of definitions."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from harness.device.opened import Device
from harness.device.runtime import cl
from harness.errors import DefrayError
from harness.files import cache_folder, extra_folders
from harness.spec.intersectors import KERNELS

LOCAL_SIZE = 64  # PoCL compiles a kernel anew for every work-group size, so there is one
INCLUDE = re.compile(r'^\s*#include\s+(?:"([^"]+)"|(INTERSECTOR|STRUCTURE))\s*$')
_programs: dict[tuple, Program] = {}
launch_listeners: list[Callable[[str, cl.Event], None]] = []  # told of every launch: kernel's name and its event


class Program:
    """The kernels of one built program: `program.launch("count_pairs", count, *arguments)`."""

    def __init__(self, device: Device, built: cl.Program, source_hash: str):
        self.queue = device.queue
        self.source_hash = source_hash
        self._kernels = {kernel.function_name: kernel for kernel in built.all_kernels()}

    def launch(self, name: str, count: int, *arguments, local: int = LOCAL_SIZE) -> cl.Event | None:
        """Enqueue kernel `name` over `count` work-items; Python ints are passed as int32."""
        if count <= 0:
            return None
        size = (count + local - 1) // local * local
        values = [np.int32(a) if isinstance(a, int) else getattr(a, "data", a) for a in arguments]
        event = self._kernels[name](self.queue, (size,), (local,), *values)
        for listener in launch_listeners:
            listener(name, event)
        return event


def build(
    device: Device,
    *files: str,
    intersector: str | None = None,
    structure: str | None = None,
    lanes: int = 1,
    defines: dict[str, int] | None = None,
) -> Program:
    """Build kernel files (names under kernels/, of the project or of a folder of DEFRAY_EXTRA) into one program.

    `intersector` is the file under kernels/intersect that `#include INTERSECTOR` stands for, `structure` the header
    that `#include STRUCTURE` stands for. Raises DefrayError with the flags and the compiler's log where the build
    fails, and for a file that does not exist.
    """
    macros = {"LANES": lanes, **(defines or {})}
    options = [f"-D{name}={value}" for name, value in macros.items()]
    if device.correctly_rounded_divide:
        options.append("-cl-fp32-correctly-rounded-divide-sqrt")
    folders = (KERNELS, *extra_folders("kernels")[1:])
    key = (device.handle, folders, files, intersector, structure, tuple(options))
    if key not in _programs:
        source = expanded(*files, intersector=intersector, structure=structure)
        try:
            built = cl.Program(device.context, source).build(options=options)
        except cl.RuntimeError as error:
            raise _build_failure(files, options, source, str(error)) from error
        _programs[key] = Program(device, built, hashlib.sha256(source.encode()).hexdigest()[:16])
    return _programs[key]


def _build_failure(files, options, source: str, log: str) -> DefrayError:
    """One line with the compiler's first error; flags, log and numbered source go to a file."""
    first = next((line.strip() for line in log.splitlines() if "error:" in line), log.splitlines()[0])
    file = cache_folder() / "build.log"
    numbered = "\n".join(f"{number:5} {line}" for number, line in enumerate(source.splitlines(), start=1))
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"{' '.join(options)}\n\n{log}\n\n{numbered}\n")
        where = f"; flags, log and source are in {file}"
    except OSError:
        where = ""
    return DefrayError(f"building {', '.join(files)} failed: {first}{where}")


def expanded(*files: str, intersector: str | None = None, structure: str | None = None) -> str:
    """Text of kernel files with their includes put in place, each file once, with #line markers."""
    stands_for = {"INTERSECTOR": intersector and f"intersect/{intersector}", "STRUCTURE": structure}
    seen: set[str] = set()

    def text(name: str) -> str:
        if name in seen:
            return ""
        seen.add(name)
        lines = [f'#line 1 "{name}"\n']
        for number, line in enumerate(kernel_file(name).read_text(encoding="utf-8").splitlines(), start=1):
            match = INCLUDE.match(line)
            if match and not (match[1] or stands_for[match[2]]):
                raise DefrayError(f"{name}: nothing was said that {match[2]} stands for")
            if match:
                lines += [text(match[1] or stands_for[match[2]]), f'#line {number + 1} "{name}"\n']
            else:
                lines.append(line + "\n")
        return "".join(lines)

    return "".join(text(name) for name in files)


def kernel_file(name: str) -> Path:
    """A kernel file by its name under kernels/; raises DefrayError where no folder has it."""
    for folder in (KERNELS, *extra_folders("kernels")[1:]):
        if (folder / name).is_file():
            return folder / name
    raise DefrayError(f"there is no kernel file {name} in {KERNELS} or in a folder of DEFRAY_EXTRA")
