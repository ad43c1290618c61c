"""Fixtures of the sweep's tests: a made-up pipeline and a request."""

import pytest
from made_up_sweep import TIER, install_fakes

from harness.campaign import sweeps as sweep


@pytest.fixture
def fakes(monkeypatch):
    install_fakes(monkeypatch)
    return lambda run_group: install_fakes(monkeypatch, run_group)


@pytest.fixture
def request_(tmp_path):
    file = tmp_path / "tiers.toml"
    file.write_text(TIER)
    return sweep.SweepRequest(file, "small", tmp_path / "out", seed=5)
