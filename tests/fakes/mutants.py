"""Kernels with one deliberate mistake each, to show that a check can fail: unified diffs in tests/mutants."""

from __future__ import annotations

import shutil
from pathlib import Path

from harness.files import ROOT

PATCHES = Path(__file__).parents[1] / "mutants"


class DoesNotApply(Exception):
    """The lines that a patch replaces do not stand in the file exactly once."""


def hunks_of(patch: str) -> list[tuple[str, str, str]]:
    """(file, lines that it has, lines that take their place) of each hunk; line numbers are not read."""
    file, hunks = "", []
    for line in patch.splitlines(keepends=True):
        if line.startswith("+++ b/"):
            file = line[len("+++ b/") :].strip()
        elif line.startswith("@@"):
            hunks.append((file, [], []))
        elif hunks and line[0] in " -+" and not line.startswith("--- a/"):
            _, old, new = hunks[-1]
            if line[0] != "+":
                old.append(line[1:])
            if line[0] != "-":
                new.append(line[1:])
    return [(name, "".join(old), "".join(new)) for name, old, new in hunks]


def apply(patch: Path, root: Path) -> None:
    """Apply a unified diff to the files under `root`; raises DoesNotApply where one of its hunks has no one place."""
    hunks = hunks_of(patch.read_text())
    if not hunks:
        raise DoesNotApply(f"{patch.name} changes nothing")
    for name, old, new in hunks:
        file = root / name
        source = file.read_text() if file.exists() else ""
        if not old or old == new or source.count(old) != 1:
            raise DoesNotApply(f"{patch.name}: its lines stand {source.count(old)} times in {name}:\n{old}")
        file.write_text(source.replace(old, new))


def kernels_with(folder: Path, *names: str) -> Path:
    """A copy of kernels/ below `folder` with patches of tests/mutants, by name without .patch."""
    kernels = Path(shutil.copytree(ROOT / "kernels", folder / "kernels", dirs_exist_ok=True))
    for name in names:
        apply(PATCHES / f"{name}.patch", folder)
    return kernels
