"""The committed figures are those that their records make, byte for byte, on a machine without OpenCL."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from harness.records.digest import digest_of
from harness.report.figures import speed_accuracy, waves
from harness.spec.run_spec import Variant
from harness.tracers import check_variant
from harness.tracers.deferred.tracer import DeferredOptions

REFERENCE = Path(__file__).parents[2] / "results" / "reference"
FOLDERS = sorted(path.parent for path in REFERENCE.glob("*/records.jsonl"))
# Stands in for a machine without OpenCL: no platform is found, and importing pyopencl fails.
REDRAW = """
import sys
sys.modules["pyopencl"] = None
from pathlib import Path
from harness.report.page import redraw
for name in sys.argv[2:]:
    redraw(Path(sys.argv[1]), name)
"""


def committed(folder: Path) -> dict[str, Path]:
    """The SVG files of a reference by name."""
    return {path.stem: path for path in sorted((folder / "figures").glob("*.svg"))}


def redrawn(folder: Path, work: Path, names) -> Path:
    """A copy of the folder's records with these figures drawn again by another process."""
    copy = work / folder.name
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("figures", "tables", "report.*"))
    environment = os.environ | {"OCL_ICD_VENDORS": str(work / "none"), "PYTHONHASHSEED": "7"}
    subprocess.run([sys.executable, "-c", REDRAW, str(copy), *names], env=environment, check=True, timeout=400)
    return copy


def test_there_is_a_reference_and_it_weighs_little():
    assert FOLDERS
    drawn = {path for pattern in ("report.*", "*.pdf") for path in REFERENCE.rglob(pattern)}  # kept by nobody
    kept = [path for path in REFERENCE.rglob("*") if path.is_file() and path not in drawn]
    assert sum(path.stat().st_size for path in kept) < 20e6


@pytest.mark.slow
@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_every_committed_figure_is_drawn_again_to_the_same_bytes(folder, tmp_path):
    names = {json.loads(path.with_suffix(".json").read_text())["name"] for path in committed(folder).values()}
    again = redrawn(folder, tmp_path, sorted(names))
    differing = [
        stem
        for stem, path in committed(folder).items()
        if (again / "figures" / path.name).read_bytes() != path.read_bytes()
    ]
    assert differing == [], f"draw them again: make figures OUT={folder.relative_to(REFERENCE.parents[1])}"


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_one_committed_figure_is_drawn_again_to_the_same_bytes(folder, tmp_path):
    name = "traversal_rate"
    again = redrawn(folder, tmp_path, [name])
    assert (again / "figures" / f"{name}.svg").read_bytes() == committed(folder)[name].read_bytes()


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_every_committed_id_resolves_to_records_on_file(folder):
    digests = {}
    for path in folder.glob("*.jsonl"):
        for line in path.read_text().splitlines():
            row = json.loads(line)
            assert digest_of(row) == row["digest"]
            digests[path.name, row["id"], row["digest"]] = row
    assert committed(folder)
    for stem, path in committed(folder).items():
        origin = json.loads(path.with_suffix(".json").read_text())
        assert re.search(rf"<!-- {origin['name']} {origin['id']} -->", path.read_text()), stem
        assert origin["records"] or origin["files"], stem
        assert all((one["file"], one["id"], one["digest"]) in digests for one in origin["records"]), stem


def test_what_drawing_knows_without_opencl_is_what_measuring_says():
    assert str(check_variant(Variant(tracer="deferred"))) == speed_accuracy.DEFAULT
    assert DeferredOptions().wave == waves.USUAL
