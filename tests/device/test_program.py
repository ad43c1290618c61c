"""Building kernels: includes, caching, and a failed build that can be read."""

from __future__ import annotations

import numpy as np
import pytest

from harness.device import program
from harness.device.program import build
from harness.device.runtime import cl
from harness.errors import DefrayError


def test_equal_builds_are_one_program_and_other_definitions_another(device):
    first, again = (build(device, "tracers/hits.cl", intersector="ray_space.cl") for _ in range(2))
    assert first is again
    assert build(device, "tracers/hits.cl", intersector="moller_trumbore.cl") is not first


def test_each_file_is_included_once(device, tmp_path, monkeypatch):
    """A second definition of `three` would not compile; INTERSECTOR stands for the chosen file."""
    (tmp_path / "intersect").mkdir()
    (tmp_path / "three.clh").write_text("int three(void) { return 3; }\n")
    (tmp_path / "intersect" / "mine.cl").write_text('#include "three.clh"\nint nine(void) { return 3 * three(); }\n')
    (tmp_path / "both.cl").write_text(
        '#include "three.clh"\n#include INTERSECTOR\n#include "three.clh"\n'
        "kernel void both(global int *out) { out[0] = three(), out[1] = nine(); }\n"
    )
    monkeypatch.setattr(program, "KERNELS", tmp_path)
    out = cl.array.zeros(device.queue, 2, np.int32)
    build(device, "both.cl", "three.clh", intersector="mine.cl").launch("both", 1, out, local=1)
    assert out.get().tolist() == [3, 9]


def test_a_failed_build_is_one_line_and_leaves_its_log(device, tmp_path, monkeypatch):
    for name in ("common.clh", "intersect.clh", "tracers/hits.cl"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text((program.KERNELS / name).read_text())
    (tmp_path / "intersect").mkdir()
    (tmp_path / "intersect" / "broken.cl").write_text("typedef RayLanes Frame;\nthis is no C\n")
    monkeypatch.setattr(program, "KERNELS", tmp_path)
    monkeypatch.setenv("DEFRAY_CACHE", str(tmp_path / "cache"))
    with pytest.raises(DefrayError) as caught:
        build(device, "tracers/hits.cl", intersector="broken.cl")
    message = str(caught.value)
    assert "building tracers/hits.cl failed" in message and "build.log" in message and "\n" not in message
    assert "broken.cl:2" in message
    log = (tmp_path / "cache" / "build.log").read_text()
    assert "-DLANES=1" in log and "this is no C" in log
