"""Names the real machine in pytest-benchmark's output, whose own idea of it knows no CPU and no device."""

from harness.device.machine import machine_description
from harness.device.opened import open_device


def pytest_benchmark_update_machine_info(config, machine_info):
    machine_info["defray"] = machine_description(open_device()).as_json()
