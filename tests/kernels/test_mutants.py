"""Patches with deliberate mistakes apply to the kernels as they are now, or fail loudly."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from mutants import PATCHES, DoesNotApply, apply, kernels_with

from harness.files import ROOT

NAMES = sorted(path.stem for path in PATCHES.iterdir())
PATCH = "--- a/x.cl\n+++ b/x.cl\n@@ -1 +1 @@\n-int a;\n+int b;\n"


@pytest.mark.parametrize("name", NAMES)
def test_a_patch_applies_and_changes_a_kernel(tmp_path, name):
    kernels = kernels_with(tmp_path, name)
    files = [file.relative_to(kernels) for file in kernels.rglob("*.cl*")]
    assert any((kernels / file).read_text() != (ROOT / "kernels" / file).read_text() for file in files)


@pytest.mark.parametrize("name", NAMES)
def test_a_patch_is_used_by_a_test(name):
    tests = [file.read_text() for file in Path(__file__).parents[1].glob("*/test_*.py")]
    assert any(re.search(rf'mutate\([^)]*"{name}"', text) for text in tests)


@pytest.mark.parametrize(("source", "times"), [("int c;\n", 0), ("int a;\nint a;\n", 2)])
def test_a_patch_whose_lines_stand_there_not_once_is_refused(tmp_path, source, times):
    (tmp_path / "x.cl").write_text(source)
    (tmp_path / "x.patch").write_text(PATCH)
    with pytest.raises(DoesNotApply, match=f"x.patch: its lines stand {times} times in x.cl"):
        apply(tmp_path / "x.patch", tmp_path)
    (tmp_path / "x.patch").write_text("no hunk\n")
    with pytest.raises(DoesNotApply, match=r"x.patch changes nothing"):
        apply(tmp_path / "x.patch", tmp_path)


def test_a_patch_replaces_its_lines_wherever_they_stand(tmp_path):
    (tmp_path / "x.cl").write_text("// more\n\nint a;\nint d;\n")
    (tmp_path / "x.patch").write_text(PATCH)
    apply(tmp_path / "x.patch", tmp_path)
    assert (tmp_path / "x.cl").read_text() == "// more\n\nint b;\nint d;\n"


def test_kernels_have_no_switch_that_the_harness_never_sets():
    """A macro that a kernel asks for is defined by a kernel or given by the harness."""
    kernels = "\n".join(file.read_text() for file in (ROOT / "kernels").rglob("*.cl*"))
    asked = {
        name for line in re.findall(r"^#(?:el)?if.*", kernels, re.M) for name in re.findall(r"\b[A-Z_]{3,}\b", line)
    }
    made = set(re.findall(r"^#define (\w+)", kernels, re.M))
    given = "\n".join(file.read_text() for file in (ROOT / "harness").rglob("*.py"))
    assert {"LANES", "COUNT_WORK"} <= asked
    assert not [name for name in asked - made if not re.search(rf"\b{name}\b", given)]
