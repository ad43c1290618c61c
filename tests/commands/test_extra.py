"""A tracer from one file and a structure from one file and one header, in a folder of their own: both are then in the
command line, the agreement tests, the figures and the report, with no other edit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapes import icosphere

ROOT = Path(__file__).resolve().parents[2]
# The examples of the guide, so that they are known to work: what stands under which heading, and where it goes.
GUIDE = ROOT / "docs" / "extend.md"
FILES = {
    ("A tracer", "python"): "tracers/octants.py",
    ("A structure", "python"): "structures/all_triangles.py",
    ("A structure", "c"): "kernels/structures/all_triangles_walk.clh",
}
SWEEP = """
[tiers.own]
about = "a tracer and a structure of one's own"
[[tiers.own.sweeps]]
name = "one"
scenes = ["ball.npz"]
structures = ["all-triangles", "8/16"]
kinds = ["diffuse"]
rays = "600"
variants = ["deferred", "forward", "work-optimal", "streamed", "octants", "brute"]
repetitions = 2
check = "exact"
"""


def example(heading: str, language: str) -> str:
    """The first block of code in a language under a heading of the guide."""
    section = GUIDE.read_text(encoding="utf-8").split(f"\n## {heading}\n")[1].split("\n## ")[0]
    return section.split(f"```{language}\n")[1].split("```")[0]


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """A temporary folder with the two files and the header, a mesh and a sweep file."""
    folder = tmp_path_factory.mktemp("own")
    for (heading, language), file in FILES.items():
        path = folder / "extra" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(example(heading, language))
    mesh = icosphere(2)
    np.savez(folder / "ball.npz", vertices=mesh.reshape(-1, 3), faces=np.arange(3 * len(mesh)).reshape(-1, 3))
    (folder / "sweep.toml").write_text(SWEEP)
    return folder


def run(own: Path, *command: str) -> subprocess.CompletedProcess:
    """A command in the folder, as a user would run it."""
    environment = os.environ | {"DEFRAY_EXTRA": str(own / "extra"), "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-m", *command], cwd=own, env=environment, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def report(own):
    """The folder of a sweep with both, and its report drawn."""
    for command in (("sweep", "sweep.toml", "--tier", "own", "--out", "out"), ("report", "out")):
        done = run(own, "harness.commands.main", *command)
        assert done.returncode == 0, done.stderr
    return own / "out"


def test_both_are_in_the_command_line(own):
    command = "trace ball.npz --tracer octants --structure all-triangles --kind random --rays 500 --json"
    done = run(own, "harness.commands.main", *command.split())
    assert done.returncode == 0, done.stderr
    record = json.loads(done.stdout)
    assert record["tracer"] == "octants" and record["valid"]
    assert record["grid"]["reading"] == "all-triangles" and record["grid"]["cells"] == 1
    done = run(own, "harness.commands.main", "trace", "ball.npz", "--structure", "all-triangle")
    assert done.returncode == 2 and "unknown structure 'all-triangle'; known: adaptive, all-triangles" in done.stderr
    done = run(own, "harness.commands.main", "trace", "ball.npz", "--structure", "all-triangles leaf=4")
    assert done.returncode == 2 and "unknown option of structure all-triangles 'leaf'; known: none" in done.stderr


def test_all_tracers_give_brute_forces_bits_in_the_structure(report):
    records = [json.loads(line) for line in (report / "records.jsonl").read_text().splitlines()]
    inside = [one for one in records if (one["grid"] or {}).get("reading") == "all-triangles"]
    assert {one["tracer"] for one in inside} == {"deferred", "forward", "work-optimal", "streamed", "octants"}
    assert len({one["hits_sha256"] for one in records}) == 1 and all(one["valid"] for one in records)


def test_both_are_in_a_figure_and_the_report(report):
    page = (report / "report.html").read_text()
    assert "octants" in page and "all-triangles" in page
    drawn = [path.name for path in (report / "figures").glob("*.svg") if "octants" in path.read_text()]
    assert drawn, "no figure shows the tracer"
    assert any("all-triangles" in path.read_text() for path in (report / "tables").glob("*.csv"))


@pytest.mark.parametrize("files", ["structures/test_agreement.py", "tracers/test_tracers.py"])
def test_both_are_in_the_agreement_tests(own, files):
    name = "all-triangles" if "structures" in files else "octants"
    where = "--rootdir", str(ROOT), "-c", str(ROOT / "pyproject.toml"), str(ROOT / "tests" / files)
    done = run(own, "pytest", "-q", "-p", "no:cacheprovider", *where, "-k", name, "-m", "not slow")
    assert done.returncode == 0 and " passed" in done.stdout, done.stdout[-2000:]
