"""The floors of harness/: where imports stand, what files are called, and that a forbidden import is refused."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

from harness.files import ROOT

HARNESS = ROOT / "harness"
SINGLE = {"__init__", "data", "engine", "errors", "files", "stats"}  # modules beside the packages
# Imports when called: the table of commands, names of the package that are looked up when first used, and the probe,
# which runs as a program of its own.
LAZY = {"__init__.py", "commands/main.py", "device/probe.py"}


def modules() -> dict[str, Path]:
    """Every module of harness/ by its path from there."""
    return {path.relative_to(HARNESS).as_posix(): path for path in sorted(HARNESS.rglob("*.py"))}


def inner_imports(source: str) -> list[int]:
    """Lines with an import inside a function."""
    functions = (
        node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    )
    inner = (node for function in functions for node in ast.walk(function))
    return sorted({node.lineno for node in inner if isinstance(node, ast.Import | ast.ImportFrom)})


def lint_imports(root: Path) -> subprocess.CompletedProcess:
    """Check the contracts of pyproject.toml on the harness/ under `root`."""
    command = [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--no-logo"]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)


def test_imports_stand_at_the_top():
    assert inner_imports("import a\ndef f():\n    if 1:\n        import b\n    from c import d\n") == [4, 5]
    found = {name: inner_imports(path.read_text()) for name, path in modules().items() if name not in LAZY}
    assert len(found) > 100 and {name: lines for name, lines in found.items() if lines} == {}


def test_no_file_name_twice():
    """A command may be called like a package."""
    packages = [path.parent.name for path in modules().values() if path.stem == "__init__"]
    files = [path.stem for path in modules().values() if path.stem != "__init__"]
    commands = {path.stem for path in (HARNESS / "commands").glob("*.py")}
    count = Counter(packages) + Counter(files) - Counter(commands.intersection(packages))
    assert {name for name, times in count.items() if times > 1} == set()


def test_no_class_name_twice():
    """But for `Rule`, as the one class that each file of rules has is called."""
    trees = [ast.parse(path.read_text()) for path in modules().values()]
    count = Counter(node.name for tree in trees for node in tree.body if isinstance(node, ast.ClassDef))
    assert len(count) > 100 and {name for name, times in count.items() if times > 1} == {"Rule"}


def test_only_few_files_stand_beside_the_packages():
    assert {path.stem for path in HARNESS.glob("*.py")} == SINGLE
    folders = {path.name for path in HARNESS.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders == {path.parent.name for path in HARNESS.glob("*/__init__.py")}


def test_a_forbidden_import_fails(tmp_path):
    shutil.copytree(HARNESS, tmp_path / "harness", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    kept = lint_imports(tmp_path)
    assert kept.returncode == 0, kept.stdout
    text = tmp_path / "harness" / "report" / "text.py"
    text.write_text(text.read_text() + "\nimport harness.device.opened  # noqa\n")
    broken = lint_imports(tmp_path)
    assert broken.returncode != 0 and "harness.report.text -> harness.device.opened" in broken.stdout
