"""Fixtures for every test: the OpenCL devices, and an empty cache where a test asks for one."""

from __future__ import annotations

import os

import pytest
from made_up_report import drawn  # noqa: F401  (a fixture)
from mutants import kernels_with

from harness.device import program
from harness.device.opened import Probe, default_order, open_device, probe_all


def working_devices() -> list[Probe]:
    """One probe for each title that works, the default device first; only DEFRAY_DEVICE's where it is set."""
    part = os.environ.get("DEFRAY_DEVICE", "").lower()
    probes = sorted(probe_all(), key=default_order)
    return list({p.title: p for p in probes if p.ok and part in p.title.lower()}.values())


def pytest_generate_tests(metafunc):
    """Run every test that takes `device` on every working OpenCL device."""
    if "device" not in metafunc.fixturenames:
        return
    probes = working_devices()
    platforms = [probe.platform for probe in probes]
    names = [p.platform if platforms.count(p.platform) == 1 else p.title for p in probes]
    # Without a device the tests must fail with the remedy, not be skipped in silence.
    metafunc.parametrize(
        "device", [p.title for p in probes] or [None], ids=names or ["none"], indirect=True, scope="session"
    )


@pytest.fixture(scope="session")
def device(request):
    """An opened Device; a test that takes it runs once on every working one."""
    return open_device(request.param)


@pytest.fixture(scope="session")
def _cache_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def fresh_cache(_cache_folder, monkeypatch):
    """A cache folder that was empty when the tests began; other tests keep the user's cache, to stay quick."""
    monkeypatch.setenv("DEFRAY_CACHE", str(_cache_folder))
    return _cache_folder


@pytest.fixture
def mutate(tmp_path, monkeypatch):
    """`mutate("name", ...)`: from then on kernels are built with these patches of tests/mutants, and no others."""
    return lambda *names: monkeypatch.setattr(
        program, "KERNELS", kernels_with(tmp_path / "-".join(["with", *names]), *names)
    )
