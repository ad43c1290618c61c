"""Files and the facts beside them: the checkout's root, the cache, JSON lines, git, writing whole or not at all."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from functools import cache, lru_cache
from pathlib import Path
from types import ModuleType

from platformdirs import user_cache_dir

from harness.errors import DefrayError

ROOT = Path(__file__).resolve().parent.parent  # of the checkout


def extra_folders(kind: str) -> list[Path]:
    """Folders of one kind, `tracers`, `structures` or `kernels`: the checkout's own, then each that is in a folder of
    DEFRAY_EXTRA, a list as PATH is one. Raises DefrayError where that names something else than a folder."""
    found = [ROOT / kind if kind == "kernels" else ROOT / "harness" / kind]
    for text in filter(None, os.environ.get("DEFRAY_EXTRA", "").split(os.pathsep)):
        folder = Path(text).resolve()
        if not folder.is_dir():
            raise DefrayError(f"DEFRAY_EXTRA names {text}, which is no folder")
        if (folder / kind).is_dir():
            found.append(folder / kind)
    return found


def files_of(kind: str) -> list[Path]:
    """Python files of a kind in its folders; a folder with a file of the kind's name (`tracer.py`) counts as one."""
    patterns = "[!_]*.py", f"*/{kind.removesuffix('s')}.py"
    found = (sorted(file for one in patterns for file in folder.glob(one)) for folder in extra_folders(kind))
    return [file for files in found for file in files]


@cache
def module_of(kind: str, file: Path) -> ModuleType:
    """A file of a kind, imported: one of the checkout as a module of `harness.KIND`, another by its path.

    Raises DefrayError for one of the latter that cannot be imported.
    """
    own = ROOT / "harness" / kind
    if file.is_relative_to(own):
        return importlib.import_module(".".join(("harness", kind, *file.relative_to(own).with_suffix("").parts)))
    stem = file.stem if f"{file.stem}s" != kind else file.parent.name
    specification = importlib.util.spec_from_file_location(f"extra_{kind}_{stem}", file)
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module  # where dataclasses and pydantic look for it
    try:
        specification.loader.exec_module(module)
    except Exception as error:
        del sys.modules[specification.name]
        raise DefrayError(f"cannot load {file}: {type(error).__name__}: {error}") from error
    return module


def cache_folder() -> Path:
    """DEFRAY_CACHE, else the user's cache folder; it need not exist."""
    return Path(os.environ.get("DEFRAY_CACHE") or user_cache_dir("defray"))


def now_utc() -> str:
    """The time now, ISO 8601 in UTC, to the second."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def command_line() -> str:
    """The command that started this process, without the folder that it is installed in."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


@lru_cache(maxsize=1)
def commit_and_dirty() -> tuple[str, bool]:
    """Commit of this checkout and whether anything in it differs; outside one, what scripts/carry.sh packed, else
    (`unknown`, False).

    Read once a process: the code that runs is the code that was there when it started.
    """
    root = ROOT
    top = _git(root, "rev-parse", "--show-toplevel")
    commit = _git(root, "rev-parse", "HEAD")
    # An installed copy may lie inside some other project's checkout, whose commit says nothing about it.
    if not commit or not top or Path(top).resolve() != root:
        return _carried_commit(root), False
    return commit, bool(_git(root, "status", "--porcelain"))


def _carried_commit(root: Path) -> str:
    try:
        return (root / "carried-commit").read_text().strip() or "unknown"
    except OSError:
        return "unknown"


def _git(root: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments],
            capture_output=True,
            text=True,
            timeout=20,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def append_line(path: Path, value: dict) -> None:
    """Append `value` as one JSON line: one write, then a sync. Raises DefrayError if it cannot be stored."""
    try:
        line = json.dumps(value, allow_nan=False, ensure_ascii=False) + "\n"
    except ValueError as error:
        raise DefrayError(f"{path}: a record holds a number that is not finite ({error})") from None
    try:
        with open(path, "ab", buffering=0) as file:
            start = file.seek(0, os.SEEK_END)
            data = line.encode()
            if file.write(data) != len(data):
                file.truncate(start)  # a full disk took part of it; a torn line must not meet a next one
                raise OSError("the disk is full")
            os.fsync(file.fileno())
    except OSError as error:
        raise DefrayError(f"cannot write {path}: {error.strerror or error}") from None
