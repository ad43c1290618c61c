"""Carrying to a machine without a network: drivers are found without root, what is damaged is named in one line."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

ROOT = Path(__file__).resolve().parents[2]


def find_icds(tmp_path: Path, registered: str = "") -> tuple[list[Path], str]:
    """ICD files written where a driver's library lies on the loader's path, and what was printed."""
    drivers, vendors, found = (tmp_path / name for name in ("drivers", "vendors", "found"))
    drivers.mkdir(exist_ok=True)
    vendors.mkdir(exist_ok=True)
    (drivers / "libnvidia-opencl.so.1").touch()
    # Others that this machine may have are taken for registered.
    (vendors / "others.icd").write_text("libpocl.so.2\nlibamdocl64.so\nlibigdrcl.so\n" + registered)
    environment = {"PATH": "/usr/bin:/bin", "LD_LIBRARY_PATH": str(drivers), "OCL_ICD_VENDORS": str(vendors)}
    command = ["bash", str(ROOT / "scripts/find_icds.sh"), str(found)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return sorted(found.glob("*.icd")), done.stdout


def test_a_driver_that_is_not_registered_gets_a_file_that_names_it(tmp_path):
    files, said = find_icds(tmp_path)
    assert [file.name for file in files] == ["found-nvidia.icd"]
    assert files[0].read_text().strip() == str(tmp_path / "drivers/libnvidia-opencl.so.1")
    assert "libnvidia-opencl.so.1 was not registered" in said


@pytest.mark.parametrize("line", ["libnvidia-opencl.so.1\n", "/usr/lib/libnvidia-opencl.so.550.54\n"])
def test_a_registered_driver_is_left_alone(tmp_path, line):
    assert find_icds(tmp_path, line) == ([], "")


def test_a_driver_that_was_registered_since_loses_its_file(tmp_path):
    assert len(find_icds(tmp_path)[0]) == 1
    assert find_icds(tmp_path, "libnvidia-opencl.so.1\n") == ([], "")


@pytest.fixture
def carried(tmp_path):
    """What scripts/carry.sh packs, with one wheel that is not one, verified sums and the scripts as source."""
    folder = tmp_path / "carried"
    (folder / "wheels").mkdir(parents=True)
    shutil.copy(ROOT / "scripts/carried/run.sh", folder)
    (folder / "commit").write_text("0123456789abcdef\n")
    (folder / "python").write_text(f"{sys.version_info.major}.{sys.version_info.minor}\n")
    (folder / "requirements.txt").write_text(f"absent==1.0 \\\n    --hash=sha256:{'0' * 64}\n")
    (folder / "wheels/other-1.0-py3-none-any.whl").write_text("no wheel")
    (folder / "defray").mkdir()
    digest = hashlib.sha256(b"no wheel").hexdigest()
    (folder / "sums").write_text(f"{digest}  ./wheels/other-1.0-py3-none-any.whl\n")
    return folder


def run(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess:
    command = ["bash", str(folder / "run.sh"), *arguments]
    variables = {"PATH": "/usr/bin:/bin", "DEFRAY_PYTHON": sys.executable, "HOME": str(folder), **environment}
    return subprocess.run(command, env=variables, capture_output=True, text=True, check=False)


def one_line(done: subprocess.CompletedProcess) -> str:
    assert done.returncode == 1 and done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("run: error: ")
    return line


def test_a_missing_wheel_is_named_in_one_line(carried):
    line = one_line(run(carried, "smoke"))
    assert "a wheel is missing" in line and "absent" in line


def test_a_damaged_file_is_named_before_anything_is_done(carried):
    (carried / "wheels/other-1.0-py3-none-any.whl").write_text("damaged")
    assert "./wheels/other-1.0-py3-none-any.whl is missing or damaged" in one_line(run(carried, "smoke"))
    (carried / "wheels/other-1.0-py3-none-any.whl").unlink()
    assert "./wheels/other-1.0-py3-none-any.whl is missing or damaged" in one_line(run(carried, "smoke"))


def test_another_python_is_asked_for(carried):
    (carried / "python").write_text("2.6\n")
    assert "the wheels are for Python 2.6" in one_line(run(carried, "smoke"))


@pytest.mark.parametrize("arguments", [["fast"], ["smoke", "NVIDIA"]])
def test_other_arguments_are_refused(carried, arguments):
    one_line(run(carried, *arguments))


def test_carry_refuses_to_overwrite_what_it_did_not_make(tmp_path):
    (tmp_path / "mine").mkdir()
    for arguments in (["--to", str(tmp_path / "mine")], ["--everything"], ["--to"]):
        command = ["bash", str(ROOT / "scripts/carry.sh"), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 1 and "carry: error: " in done.stderr.splitlines()[-1]
    assert (tmp_path / "mine").is_dir()


def test_what_is_left_out_is_needed_by_nothing_that_measures(tmp_path):
    """A sweep on the grid that is chosen, and every other command that makes rows, with those packages missing."""
    left_out = re.search(r'LEFT_OUT="([^"]*)"', (ROOT / "scripts/carry.sh").read_text()).group(1).split()
    modules = {
        "import-linter": "importlinter",
        "pillow": "PIL",
        "pytest-benchmark": "pytest_benchmark",
        "pytest-xdist": "xdist",
        "fonttools": "fontTools",
        "py-cpuinfo2": "cpuinfo",
        "vl-convert-python": "vl_convert",
    }
    names = [modules.get(name, name) for name in left_out]
    assert "matplotlib" in names
    trimesh.creation.icosphere().export(tmp_path / "ball.ply")
    (tmp_path / "sweeps.toml").write_text(
        '[tiers.smoke]\nabout = "one run"\n[[tiers.smoke.sweeps]]\nname = "one"\nscenes = ["ball.ply"]\n'
        'grids = ["auto"]\nrays = "1k"\nvariants = ["deferred:ray-space"]\n'
    )
    script = f"""
import sys
for name in {names!r}:
    sys.modules[name] = None  # importing it fails
import harness.commands.accuracy, harness.commands.coherence, harness.commands.roofline, harness.commands.stability
import harness.commands.reproduce
from harness.commands.main import app
app(["sweep", "sweeps.toml", "--tier", "smoke", "--out", "out"])
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out/records.jsonl").read_text().count("\n") == 1
