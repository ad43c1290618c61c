"""env.json says what a result may depend on, and nothing that it cannot read."""

from __future__ import annotations

import json

from harness.device.machine import caches, environment_description, turbo


def test_the_description_holds_the_machine_its_devices_and_every_package(device):
    found = environment_description(device)
    assert json.loads(json.dumps(found)) == found
    assert {
        "cpu",
        "cores",
        "caches",
        "memory_bytes",
        "os",
        "kernel",
        "governor",
        "turbo",
        "platform",
        "driver",
        "environment",
        "commit",
        "dirty",
    } <= set(found)
    assert found["packages"]["numpy"] == found["versions"]["numpy"]
    assert any(one["works"] and device.name in one["device"] for one in found["opencl_devices"])


def test_caches_and_turbo_are_read_where_the_system_says_them(tmp_path):
    for index, facts in enumerate([("1", "Data", "32K"), ("1", "Instruction", "32K"), ("2", "Unified", "1M")]):
        folder = tmp_path / f"cpu0/cache/index{index}"
        folder.mkdir(parents=True)
        for name, value in zip(("level", "type", "size"), facts, strict=True):
            (folder / name).write_text(f"{value}\n")
    assert caches(tmp_path) == {"L1 data": "32K", "L1 instruction": "32K", "L2": "1M"}
    assert turbo(tmp_path) is None
    (tmp_path / "cpufreq").mkdir()
    (tmp_path / "cpufreq/boost").write_text("0\n")
    assert turbo(tmp_path) == "off"
