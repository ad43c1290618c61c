"""The append-only file of rows, which survives a killed sweep.

A row is a JSON object, one a line; the class of its row declares every key. `RecordFile` writes each with its
digest (`harness.records.digest`), in a single write and a sync, so a kill can tear the last line at most.
"""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from harness.errors import DefrayError
from harness.files import append_line
from harness.records import digest
from harness.records.run_row import Record
from harness.records.schema import Row, checked

R = TypeVar("R", bound=Row)


def _to_stderr(message: str) -> None:
    print(f"warning: {message}", file=sys.stderr)


class RecordFile(Generic[R]):
    """An append-only JSON Lines file of rows of one class, records unless said otherwise.

    Each line holds its digest, which is verified on the line's JSON and is no part of a row.
    `warn` receives one-line messages (default: standard error). Only the process that writes the file may
    call `repair`; readers skip a torn last line and leave the file alone.
    """

    def __init__(self, path: Path | str, row: type[R] = Record, warn: Callable[[str], None] = _to_stderr):
        self.path, self.row, self.warn = Path(path), row, warn

    def append(self, row: R) -> None:
        """Validate and store one row; when this returns, a kill or power cut no longer loses it.

        Raises DefrayError for a row that its class forbids, and where the file cannot be written.
        """
        whole = checked(self.row, row.as_json(), f"{self.path}: new record")
        append_line(self.path, digest.sealed(whole.as_json()))

    def read(self) -> list[R]:
        """All rows. A torn last line is skipped with a warning; other damage raises DefrayError with
        file and line; a file that is not there has no rows."""
        rows, torn_at, _ = self._scan()
        if torn_at is not None:
            self.warn(f"{self.path}: skipped the last line, which is incomplete")
        return rows

    def repair(self) -> list[R]:
        """`read`, but a torn last line is moved to `<name>.broken` and the file cut to the last good one."""
        rows, torn_at, data = self._scan()
        if torn_at is not None:
            aside = self.path.with_name(self.path.name + ".broken")
            with open(aside, "ab") as broken:
                broken.write(data[torn_at:].rstrip(b"\n") + b"\n")
                broken.flush()
                os.fsync(broken.fileno())
            os.truncate(self.path, torn_at)
            self.warn(f"{self.path}: the last line was incomplete; moved it to {aside.name}")
        elif data and not data.endswith(b"\n"):
            # The kill came between the row and its newline: the row is whole.
            with open(self.path, "ab") as file:
                file.write(b"\n")
        return rows

    def _checked(self, value: Any, where: str) -> R:
        """A stored row. Raises DefrayError for any that is not as it was written."""
        row = checked(self.row, digest.unsealed(value, where), where)
        digest.needs_digest(value, where)
        return row

    def _scan(self) -> tuple[list[R], int | None, bytes]:
        """Rows, byte offset of a torn last line (None if whole), and the file's bytes."""
        try:
            data = self.path.read_bytes()
        except FileNotFoundError:
            return [], None, b""
        except OSError as error:
            raise DefrayError(f"cannot read {self.path}: {error.strerror}") from None
        rows, offset = [], 0
        lines = io.BytesIO(data).readlines()
        for number, line in enumerate(lines, 1):
            try:
                value = json.loads(line)
            except ValueError:
                if number == len(lines):
                    return rows, offset, data
                raise DefrayError(
                    f"{self.path}, line {number}: not JSON; restore the file from a copy or delete that line"
                ) from None
            rows.append(self._checked(value, digest.row_place(value, self.path, number)))
            offset += len(line)
        return rows, None, data
