"""Files and the facts beside them: the checkout's root, the cache, JSON lines, git, writing whole or not at all."""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import pkgutil
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
    """Where files of a kind (`tracers`, `structures`, `kernels`) are looked for: the project's own folder first, then
    that of each folder named in DEFRAY_EXTRA, separated as in PATH. The latter need not exist."""
    own = ROOT / kind if kind == "kernels" else ROOT / "harness" / kind
    extra = [part for part in os.environ.get("DEFRAY_EXTRA", "").split(os.pathsep) if part]
    return [own, *(Path(part).expanduser() / kind for part in extra)]


def modules_of(kind: str) -> list[ModuleType]:
    """The modules of `harness.KIND`, for a package its module of the singular name (`tracer`), and then the files of
    that kind in DEFRAY_EXTRA. Raises DefrayError for one of these that cannot be imported."""
    own, *extra = extra_folders(kind)
    found = []
    for entry in pkgutil.iter_modules([str(own)]):
        inner = f".{kind.removesuffix('s')}" if entry.ispkg else ""
        found.append(importlib.import_module(f"harness.{kind}.{entry.name}{inner}"))
    return found + [_module_from(file, kind) for folder in extra for file in sorted(folder.glob("*.py"))]


@cache
def _module_from(file: Path, kind: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"defray_extra.{kind}.{file.stem}", file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise DefrayError(f"{file} cannot be imported: {type(error).__name__}: {error}") from error
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
