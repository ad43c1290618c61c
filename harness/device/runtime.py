"""Prepares the process's environment and imports pyopencl: every module gets `cl` from here.

`from harness.device.runtime import cl`. Nothing else in the package imports pyopencl first.
"""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from pathlib import Path

SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")
"""Where the loader looks for ICD files when nobody says otherwise."""


def environment_vendors() -> Path:
    """Folder of ICD files inside the Python environment, filled by set-up; it need not exist."""
    return Path(sys.prefix) / "etc" / "defray" / "opencl-vendors"


def prepare() -> None:
    """Set the environment variables that pyopencl and the OpenCL runtimes read once, at their start."""
    # pyopencl's own binary cache doubles PoCL's compile time; PoCL keeps its own.
    os.environ.setdefault("PYOPENCL_NO_CACHE", "1")
    threads = os.environ.get("DEFRAY_THREADS")
    if threads:
        os.environ.setdefault("POCL_MAX_PTHREAD_COUNT", threads)
        os.environ.setdefault("CL_CONFIG_CPU_TBB_NUM_WORKERS", threads)
    if "OCL_ICD_VENDORS" not in os.environ and "OPENCL_VENDOR_PATH" not in os.environ:
        _show_environment_vendors()


def _show_environment_vendors() -> None:
    """Point the loader at the environment's ICD files, where there are any, beside the system's."""
    folder = environment_vendors()
    if not any(folder.glob("*.icd")):
        return
    # The loader reads one folder only, so the system's files are linked into ours.
    for icd in SYSTEM_VENDORS.glob("*.icd"):
        link = folder / f"system-{icd.name}"
        # Another process may link it first, or the environment may be read-only.
        with contextlib.suppress(OSError):
            if not link.is_symlink():
                link.symlink_to(icd)
    os.environ["OCL_ICD_VENDORS"] = str(folder)


prepare()

import pyopencl as cl  # noqa: E402  (the environment must be ready before this import)
import pyopencl.array  # noqa: E402  (makes cl.array)

# A build log that is not empty is no news: harness/device/program.py shows the log of a failed build.
warnings.filterwarnings("ignore", category=cl.CompilerWarning)


__all__ = ["SYSTEM_VENDORS", "cl", "environment_vendors", "prepare"]
