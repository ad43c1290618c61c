"""`env.json`: everything of a machine that a result may depend on, as far as it can be read."""

from __future__ import annotations

import os
import platform as host
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

from harness.device.opened import Device, probe_all
from harness.files import commit_and_dirty, now_utc
from harness.records.schema import Machine

VERSIONED = ("numpy", "pyopencl", "embreex", "trimesh", "pandas", "matplotlib")
RECORDED_VARIABLES = ("POCL_", "PYOPENCL_", "OCL_", "OPENCL_", "CL_CONFIG_")


def machine_description(device: Device | None) -> Machine:
    """The `machine` part of a row: hardware, operating system, versions and OpenCL environment."""
    return Machine(
        cpu=_cpu_name(),
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        memory_bytes=os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        os=_os_name(),
        kernel=host.release(),
        governor=_file_text("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
        device=device.name if device else None,
        platform=device.platform if device else None,
        driver=device.driver if device else None,
        versions=_versions(device),
        environment=_environment(),
    )


def _file_text(path: str) -> str | None:
    try:
        return Path(path).read_text().strip()
    except OSError:
        return None


def _cpu_name() -> str:
    """Model name from the operating system, else the architecture."""
    names = re.findall(r"^model name\s*:\s*(.+)$", _file_text("/proc/cpuinfo") or "", re.MULTILINE)
    return names[0] if names else host.processor() or host.machine()


def _environment() -> dict[str, str]:
    """Every variable that steers an OpenCL runtime; the Python environment's folder is written VENV."""
    steering = {k: v for k, v in sorted(os.environ.items()) if k.startswith(RECORDED_VARIABLES)}
    return {k: v.replace(sys.prefix, "VENV") for k, v in steering.items()}


def _os_name() -> str:
    try:
        return host.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return host.system()


def _versions(device: Device | None) -> dict[str, str | None]:
    """Versions of what a result may depend on; PoCL's and LLVM's as far as the platform names them."""
    versions: dict[str, str | None] = {"python": host.python_version()}
    for package in VERSIONED:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = None
    described = device.handle.platform.version if device else ""
    versions["opencl"] = described or None
    for key, pattern in (("pocl", r"PoCL ([\w.+~-]+)"), ("llvm", r"LLVM ([\w.+~-]+)")):
        found = re.search(pattern, described)
        versions[key] = found.group(1).rstrip(".") if found else None
    return versions


CPU = Path("/sys/devices/system/cpu")
TURBO = {"intel_pstate/no_turbo": {"0": "on", "1": "off"}, "cpufreq/boost": {"1": "on", "0": "off"}}


def environment_description(device) -> dict:
    """The machine as records have it, and beside it what they do not repeat: caches, turbo, every OpenCL device,
    every installed package, compilers, commit. What cannot be read is None or missing."""
    commit, dirty = commit_and_dirty()
    return {
        **machine_description(device).as_json(),
        "logical_cpus": os.cpu_count(),
        "caches": caches(),
        "turbo": turbo(),
        "frequency_mhz": _number(_read(CPU / "cpu0/cpufreq/scaling_cur_freq"), 1e-3),
        "load_average": list(os.getloadavg()) if hasattr(os, "getloadavg") else None,
        "opencl_devices": [
            {"device": probe.title, "version": probe.version, "works": probe.ok, "message": probe.message}
            for probe in probe_all()
        ],
        "packages": packages(),
        "compiler": _first_line(["cc", "--version"]),
        "commit": commit,
        "dirty": dirty,
        "described_utc": now_utc(),
    }


def caches(cpu: Path = CPU) -> dict[str, str]:
    """Size of each cache of the first core by level and kind, `{"L1 data": "32K"}`."""
    found = {}
    for folder in sorted((cpu / "cpu0/cache").glob("index*")):
        level, kind, size = (_read(folder / name) for name in ("level", "type", "size"))
        if level and size:
            found[f"L{level}" + (f" {kind.lower()}" if kind and kind != "Unified" else "")] = size
    return found


def turbo(cpu: Path = CPU) -> str | None:
    """`on` or `off`; None where the system does not say."""
    for path, meanings in TURBO.items():
        value = _read(cpu / path)
        if value in meanings:
            return meanings[value]
    return None


def packages() -> dict[str, str]:
    """Version of every installed Python package."""
    found = {distribution.metadata["Name"]: distribution.version for distribution in metadata.distributions()}
    return {name: found[name] for name in sorted(found, key=str.lower) if name}


def _read(path: Path) -> str | None:
    try:
        return path.read_text().strip()
    except OSError:
        return None


def _number(text: str | None, factor: float) -> float | None:
    return float(text) * factor if text and re.fullmatch(r"\d+", text) else None


def _first_line(command: list[str]) -> str | None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.splitlines()[0] if done.returncode == 0 and done.stdout else None
