"""Devices: probing survives broken runtimes, opening says what is wrong, records say what was used."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness.device.machine import machine_description
from harness.device.opened import open_device, probe_all
from harness.device.runtime import cl
from harness.errors import DefrayError

# pyopencl's loader always shows a runtime installed into its own folder: PoCL's wheel.
needs_hidden_devices = pytest.mark.skipif(
    any(Path(cl.__file__).parent.glob(".libs/*.icd")), reason="PoCL's wheel cannot be hidden"
)


def doctor(vendors, *arguments) -> subprocess.CompletedProcess:
    """Run the doctor with only the ICD files of the folder `vendors`."""
    environment = {**os.environ, "OCL_ICD_VENDORS": str(vendors)}
    command = [sys.executable, "-m", "harness.commands.doctor", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_a_device_passes_its_probe():
    assert any(probe.ok for probe in probe_all()), probe_all()


def test_opened_device_is_described(device):
    assert device.native_lanes in (1, 4, 8, 16)
    assert device.compute_units > 0
    assert 0 < device.max_allocation_bytes <= device.memory_bytes
    assert device.queue.properties & cl.command_queue_properties.PROFILING_ENABLE
    assert not device.queue.properties & cl.command_queue_properties.OUT_OF_ORDER_EXEC_MODE_ENABLE


def test_a_device_is_opened_once(device):
    assert open_device(device.title) is device
    assert open_device(device.title.upper()) is device


def test_opened_device_computes(device):
    source = "kernel void twice(global float *x) { x[get_global_id(0)] *= 2.0f; }"
    values = np.arange(64, dtype=np.float32)
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    buffer = cl.Buffer(device.context, flags, hostbuf=values)
    result = np.empty_like(values)
    cl.Program(device.context, source).build().twice(device.queue, (64,), (8,), buffer)
    cl.enqueue_copy(device.queue, result, buffer)
    np.testing.assert_array_equal(result, 2 * values)


def test_unknown_device_lists_what_exists(device):
    with pytest.raises(DefrayError) as error:
        open_device("no such device")
    assert "no such device" in str(error.value)
    assert device.title in str(error.value)
    assert "\n" not in str(error.value)


def test_environment_chooses_the_device(device, monkeypatch):
    monkeypatch.setenv("DEFRAY_DEVICE", device.name[:5].upper())
    assert device.name[:5] in open_device().title
    monkeypatch.setenv("DEFRAY_DEVICE", "no such device")
    with pytest.raises(DefrayError, match="no such device"):
        open_device()


def test_machine_description_is_complete(device):
    description = machine_description(device)
    assert description.device == device.name
    assert description.driver == device.driver
    assert description.cores >= 1
    assert description.versions["pyopencl"]
    assert description.environment["PYOPENCL_NO_CACHE"]
    assert sys.prefix not in json.dumps(description.as_json())
    assert machine_description(None).device is None


@needs_hidden_devices
def test_doctor_without_any_device_names_the_remedy(tmp_path):
    done = doctor(tmp_path)
    assert done.returncode == 1
    assert "pocl-opencl-icd" in done.stdout
    answer = json.loads(doctor(tmp_path, "--json").stdout)
    assert answer["works"] is False
    assert answer["devices"] == []
    assert "pocl-opencl-icd" in answer["remedy"]


@needs_hidden_devices
def test_doctor_survives_a_missing_library(tmp_path):
    (tmp_path / "broken.icd").write_text("/nonexistent/libbroken.so\n")
    done = doctor(tmp_path)
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr
    assert "pocl-opencl-icd" in done.stdout


@needs_hidden_devices
def test_doctor_survives_a_crashing_library(tmp_path):
    source = tmp_path / "crash.c"
    source.write_text("__attribute__((constructor)) static void crash(void) { *(volatile int *)0 = 0; }\n")
    library = tmp_path / "libcrash.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    (tmp_path / "crash.icd").write_text(f"{library}\n")
    done = doctor(tmp_path, "--json")
    assert done.returncode == 1
    answer = json.loads(done.stdout)
    assert "crashed" in answer["devices"][0]["message"]
    assert "crash.icd" in answer["remedy"]


FAKE_PROBE = """
import json, os, signal, sys
if sys.argv[1] == "list":
    print(json.dumps([{{"place": [0, 0], "platform": "Broken", "name": "thing", "version": "1", "is_cpu": True}}]))
else:
    {run}
"""
WITH_PROBE = """
import sys
from pathlib import Path
from harness.device import opened
from harness.errors import DefrayError
opened.PROBE = Path(sys.argv[1])
print(opened.probe_all())
try:
    opened.open_device("thing")
except DefrayError as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("run", "failure"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", "the runtime crashed (signal 11)"),
        ("print(json.dumps('wrong numbers'))", "wrong numbers"),
        ("sys.exit('SomeError: no memory')", "SomeError: no memory"),
        ("sys.exit(3)", "exit code 3"),
    ],
)
def test_a_device_that_is_listed_and_then_fails_is_refused_with_the_remedy(tmp_path, run, failure):
    """In a process of its own, since answers of the probe are kept."""
    (tmp_path / "probe.py").write_text(FAKE_PROBE.format(run=run))
    command = [sys.executable, "-c", WITH_PROBE, str(tmp_path / "probe.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    probed, opened = done.stdout.splitlines()
    assert "ok=False" in probed and failure in probed and "pocl-opencl-icd" in probed
    assert f"Broken / thing: {failure}" in opened and "pocl-opencl-icd" in opened
