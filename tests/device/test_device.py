"""Devices: probing survives broken runtimes, opening says what is wrong, records say what was used."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness.device import opened as device_module
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


def test_probe_reports_a_kernel_that_does_not_run(monkeypatch):
    """A runtime that lists a device and then fails is a failed probe with a remedy, not an exception."""
    monkeypatch.setattr(device_module, "_ask", lambda *arguments: (None, "the runtime crashed (signal 11)"))
    place = tuple(device_module._list_devices()[0]["place"])
    probe = device_module._probe.__wrapped__(place)
    assert not probe.ok
    assert "signal 11" in probe.message
    assert probe.remedy


def test_failing_devices_make_opening_fail_with_the_remedy(monkeypatch):
    entry = {"place": [0, 0], "platform": "Broken", "name": "thing", "version": "", "is_cpu": True}
    monkeypatch.setattr(device_module, "_list_devices", lambda: [entry])
    monkeypatch.setattr(device_module, "_ask", lambda *arguments: (None, "wrong numbers"))
    monkeypatch.setattr(device_module, "_probe", device_module._probe.__wrapped__)
    with pytest.raises(DefrayError, match=r"Broken / thing: wrong numbers.*pocl-opencl-icd"):
        open_device("thing")
