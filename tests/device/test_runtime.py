"""The environment is prepared before OpenCL is loaded, which reads it once."""

from __future__ import annotations

import os
import subprocess
import sys

CODE = """
import builtins, os
before, real = {}, builtins.__import__
def noting(name, *rest, **more):
    if name.split(".")[0] == "pyopencl" and not before:
        before.update(os.environ)
    return real(name, *rest, **more)
builtins.__import__ = noting
from harness.device.runtime import cl
print(before["PYOPENCL_NO_CACHE"], before["POCL_MAX_PTHREAD_COUNT"], hasattr(cl, "array"))
"""


def test_the_environment_is_ready_before_pyopencl_is_imported():
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYOPENCL", "POCL_MAX"))}
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=environment | {"DEFRAY_THREADS": "1"}, capture_output=True, text=True
    )
    assert done.stdout.split() == ["1", "1", "True"], done.stderr
