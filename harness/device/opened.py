"""OpenCL devices: find them, probe them, open one, and describe the machine for the records."""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from harness.device.runtime import SYSTEM_VENDORS, cl, environment_vendors
from harness.errors import DefrayError

PROBE = Path(__file__).with_name("probe.py")  # run in a process of its own
PROBE_SECONDS = 120  # a first compile on a loaded machine takes seconds, a hung runtime for ever
REMEDY = (
    "install PoCL ('apt-get install pocl-opencl-icd' on Debian and Ubuntu, as root), or run "
    "'scripts/setup.sh --with-intel' to add Intel's CPU runtime to .venv"
)


@dataclass(frozen=True)
class Probe:
    """Verdict on one OpenCL device; `place` is its (platform, device) index, `remedy` empty when `ok`."""

    platform: str
    name: str
    version: str
    ok: bool
    message: str
    remedy: str
    is_cpu: bool = False
    place: tuple[int, int] = (-1, -1)

    @property
    def title(self) -> str:
        """What `--device` and DEFRAY_DEVICE are matched against."""
        return f"{self.platform} / {self.name}"


@dataclass(frozen=True, eq=False)
class Device:
    """One opened OpenCL device with its context and its in-order, profiling queue.

    `native_lanes`: float lanes of one hardware vector (1, 4, 8 or 16; 1 on a GPU).
    """

    platform: str
    name: str
    version: str
    driver: str
    compute_units: int
    native_lanes: int
    memory_bytes: int
    max_allocation_bytes: int
    is_cpu: bool
    has_int64_atomics: bool
    has_double: bool
    correctly_rounded_divide: bool
    handle: cl.Device
    context: cl.Context
    queue: cl.CommandQueue

    @property
    def title(self) -> str:
        """Platform and device name, as `open_device` matches them."""
        return f"{self.platform} / {self.name}"


def open_device(part: str | None = None) -> Device:
    """The device whose "platform / name" contains `part`, ignoring case; one Device a process and handle.

    Without `part`, DEFRAY_DEVICE says it; without either, the first that passes its probe, in this order:
    PoCL on a CPU, another CPU, anything else (the paper's figures are redrawn on CPUs, and a choice that
    changes with the drivers installed would make runs differ). Raises DefrayError when nothing matches
    `part`, and, with the remedy, when no matching device works.
    """
    part = part or os.environ.get("DEFRAY_DEVICE") or ""
    listed = sorted(_list_devices(), key=lambda entry: _order(entry["platform"], entry["is_cpu"]))
    matching = [e for e in listed if part.lower() in f"{e['platform']} / {e['name']}".lower()]
    if listed and not matching:
        titles = ", ".join(f"'{e['platform']} / {e['name']}'" for e in listed)
        raise DefrayError(f"no OpenCL device matches '{part}'; there are: {titles}")
    failures = []
    for entry in matching:
        probe = _probe(tuple(entry["place"]))
        if probe.ok:
            return _open(probe.place)
        failures.append(f"{probe.title}: {probe.message}")
    found = "; ".join(failures) or _listing_failure() or "none is installed"
    raise DefrayError(f"no working OpenCL device ({found}); {REMEDY}")


def probe_all() -> list[Probe]:
    """Probe every OpenCL device; empty when none is installed. Raises nothing, whatever a runtime does.

    Where merely listing the devices fails, one Probe says so and names the ICD files.
    """
    failure = _listing_failure()
    if failure:
        remedy = f"remove or repair the ICD file that fails, among: {_icd_files() or 'none'}; or {REMEDY}"
        return [Probe("(all)", "(none listed)", "", False, failure, remedy)]
    return [_probe(tuple(entry["place"])) for entry in _list_devices()]


def _ask(*arguments: str) -> tuple[object, str]:
    """Answer of PROBE and the failure; one of the two is None or empty."""
    command = [sys.executable, "-P", str(PROBE), *arguments]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=PROBE_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return None, f"no answer within {PROBE_SECONDS} s"
    except OSError as error:
        return None, f"the probe could not start: {error}"
    if done.returncode < 0:
        return None, f"the runtime crashed (signal {-done.returncode})"
    lines = done.stdout.strip().splitlines()
    if done.returncode == 0 and lines:
        return json.loads(lines[-1]), ""
    text = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return None, next((line for line in reversed(text) if "rror" in line), f"exit code {done.returncode}")


@functools.cache
def _ask_list() -> tuple[object, str]:
    return _ask("list")


def _list_devices() -> list[dict]:
    return _ask_list()[0] or []


def _listing_failure() -> str:
    return _ask_list()[1]


@functools.cache
def _probe(place: tuple[int, int]) -> Probe:
    """Compile and run the probe kernel on the device at `place`."""
    entry = next(e for e in _list_devices() if tuple(e["place"]) == place)
    answer, failure = _ask("run", str(place[0]), str(place[1]))
    message = failure or str(answer)
    return Probe(
        platform=entry["platform"],
        name=entry["name"],
        version=entry["version"],
        ok=not message,
        message=message or "compiled and ran a kernel",
        remedy=REMEDY if message else "",
        is_cpu=entry["is_cpu"],
        place=place,
    )


def _order(platform: str, is_cpu: bool) -> tuple[bool, bool]:
    """PoCL on a CPU first, then other CPUs, then the rest."""
    return not (is_cpu and platform == "Portable Computing Language"), not is_cpu


def default_order(probe: Probe) -> tuple[bool, bool]:
    """Sort key that puts the devices in the order in which `open_device` tries them."""
    return _order(probe.platform, probe.is_cpu)


def _icd_files() -> str:
    """The ICD files that the loader reads, for a message."""
    folder = os.environ.get("OCL_ICD_VENDORS") or os.environ.get("OPENCL_VENDOR_PATH")
    folders = [Path(folder)] if folder else [environment_vendors(), SYSTEM_VENDORS]
    return ", ".join(str(icd) for each in folders for icd in sorted(each.glob("*.icd")))


@functools.cache
def _open(place: tuple[int, int]) -> Device:
    """Open the device at `place`; it has passed its probe."""
    handle = cl.get_platforms()[place[0]].get_devices()[place[1]]
    context = cl.Context([handle])
    is_cpu = bool(handle.type & cl.device_type.CPU)
    divide = cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT
    return Device(
        platform=handle.platform.name.strip(),
        name=handle.name.strip(),
        version=handle.version.strip(),
        driver=handle.driver_version.strip(),
        compute_units=handle.max_compute_units,
        native_lanes=_native_lanes(handle) if is_cpu else 1,
        memory_bytes=handle.global_mem_size,
        max_allocation_bytes=handle.max_mem_alloc_size,
        is_cpu=is_cpu,
        has_int64_atomics="cl_khr_int64_extended_atomics" in handle.extensions.split(),
        has_double="cl_khr_fp64" in handle.extensions.split(),
        correctly_rounded_divide=bool(handle.single_fp_config & divide),
        handle=handle,
        context=context,
        queue=cl.CommandQueue(context, properties=cl.command_queue_properties.PROFILING_ENABLE),
    )


def _native_lanes(handle) -> int:
    """Float lanes of the device's vectors, rounded down to 1, 4, 8 or 16."""
    # Intel's runtime prefers 1 (it vectorises over work-items) but says what the hardware has as native.
    width = max(handle.native_vector_width_float, handle.preferred_vector_width_float)
    return max((lanes for lanes in (1, 4, 8, 16) if lanes <= width), default=1)
