"""The folder of a campaign: locked, its errors stored, its JSON written whole."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout
from pydantic import BaseModel

from harness.campaign.executors import TaskFailed
from harness.errors import DefrayError
from harness.files import append_line, now_utc
from harness.studies.study import Part, Task

ERRORS = "errors.jsonl"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make `folder` and hold it; raises DefrayError when it cannot be written or another measurement holds it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / ".lock", timeout=0)
        lock.acquire()
    except Timeout:
        raise DefrayError(
            f"another measurement is writing to {folder}; wait for it or choose another --out"
        ) from None
    except OSError as error:
        raise DefrayError(f"cannot write to {folder}: {error.strerror}") from None
    try:
        yield
    finally:
        lock.release()


def write_json(path: Path, value: dict) -> None:
    """Replace `path` by `value` as JSON, whole or not at all; raises DefrayError where it cannot be written."""
    write_whole(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def write_whole(path: Path, text: str) -> None:
    """Replace `path` by `text`, whole or not at all; raises DefrayError where it cannot be written."""
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, path)
    except OSError as error:
        raise DefrayError(f"cannot write {path}: {error.strerror}") from None


def drop_errors(folder: Path, ids: set[str]) -> None:
    """Take failures of parts that have been measured since out of `errors.jsonl`; a line that is not JSON stays."""
    path = folder / ERRORS
    if not ids or not path.is_file():
        return
    lines = [line + "\n" for line in path.read_text(encoding="utf-8").split("\n") if line]
    kept = [line for line in lines if _id_of(line) not in ids]
    if len(kept) < len(lines):
        write_whole(path, "".join(kept))


def _id_of(line: str) -> str | None:
    try:
        return json.loads(line).get("id")
    except (ValueError, AttributeError):
        return None


def store_error(folder: Path, task: Task, part: Part, failure: TaskFailed) -> None:
    """Add the failure of one part to `errors.jsonl`."""
    entry = {
        "id": part.id,
        "time_utc": now_utc(),
        "study": task.study.name,
        "run": part.name,
        "spec": part.what.model_dump(mode="json") if isinstance(part.what, BaseModel) else None,
        "error": failure.message,
        "traceback": failure.traceback,
    }
    append_line(folder / ERRORS, entry)
