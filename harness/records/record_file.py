"""Records: what one run leaves behind, and the append-only file that survives a killed sweep.

A record is a JSON object, one a line; `harness.record_schema` declares every key. `RecordFile` writes each with its
digest (`harness.digest`), in a single write and a sync, so a kill can tear the last line at most.
"""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from harness.errors import DefrayError, first_problem
from harness.files import append_line
from harness.records import digest
from harness.records.run_row import SCHEMA, Record


def validated(record: dict, where: str) -> dict:
    """`record` in the schema's key order; raises DefrayError naming `where` and the first bad key."""
    if not isinstance(record, dict):
        raise DefrayError(f"{where}: not a JSON object")
    digest.check_schema(record, SCHEMA, where)
    try:
        return Record.model_validate(record).model_dump(mode="json", by_alias=True)
    except ValidationError as error:
        raise DefrayError(f"{where}: {first_problem(error)}") from None


def _to_stderr(message: str) -> None:
    print(f"warning: {message}", file=sys.stderr)


class RecordFile:
    """An append-only JSON Lines file of records, or of whatever rows `validate(row, where)` accepts.

    Each line holds its digest, which `validate` does not see; `read` leaves it in the rows it returns.
    `warn` receives one-line messages (default: standard error). Only the process that writes the file may
    call `repair`; readers skip a torn last line and leave the file alone.
    """

    def __init__(
        self,
        path: Path | str,
        warn: Callable[[str], None] = _to_stderr,
        validate: Callable[[dict, str], dict] = validated,
    ):
        self.path = Path(path)
        self.warn = warn
        self._validate = validate

    def append(self, record: dict) -> None:
        """Validate and store one record; when this returns, a kill or power cut no longer loses it."""
        where = f"{self.path}: new record"
        append_line(self.path, digest.sealed(self._validate(digest.unsealed(record, where), where)))

    def read(self) -> list[dict]:
        """All records. A torn last line is skipped with a warning; other damage raises DefrayError with
        file and line; a file that is not there has no records."""
        records, torn_at, _ = self._scan()
        if torn_at is not None:
            self.warn(f"{self.path}: skipped the last line, which is incomplete")
        return records

    def done_ids(self) -> set[str]:
        """Ids of all runs on file, valid or not."""
        return {record["id"] for record in self.read()}

    def repair(self) -> list[dict]:
        """`read`, but a torn last line is moved to `<name>.broken` and the file cut to the last good one."""
        records, torn_at, data = self._scan()
        if torn_at is not None:
            aside = self.path.with_name(self.path.name + ".broken")
            with open(aside, "ab") as broken:
                broken.write(data[torn_at:].rstrip(b"\n") + b"\n")
                broken.flush()
                os.fsync(broken.fileno())
            os.truncate(self.path, torn_at)
            self.warn(f"{self.path}: the last line was incomplete; moved it to {aside.name}")
        elif data and not data.endswith(b"\n"):
            # The kill came between the record and its newline: the record is whole.
            with open(self.path, "ab") as file:
                file.write(b"\n")
        return records

    def _checked(self, value: Any, where: str) -> dict:
        """A stored row, its digest as on file. Raises DefrayError for any that is not as it was written."""
        row = self._validate(digest.unsealed(value, where), where)
        digest.needs_digest(value, where)
        return {**row, digest.KEY: value[digest.KEY]}

    def _scan(self) -> tuple[list[dict], int | None, bytes]:
        """Records, byte offset of a torn last line (None if whole), and the file's bytes."""
        try:
            data = self.path.read_bytes()
        except FileNotFoundError:
            return [], None, b""
        except OSError as error:
            raise DefrayError(f"cannot read {self.path}: {error.strerror}") from None
        records, offset = [], 0
        lines = io.BytesIO(data).readlines()
        for number, line in enumerate(lines, 1):
            try:
                value = json.loads(line)
            except ValueError:
                if number == len(lines):
                    return records, offset, data
                raise DefrayError(
                    f"{self.path}, line {number}: not JSON; restore the file from a copy or delete that line"
                ) from None
            records.append(self._checked(value, digest.place_of(value, self.path, number)))
            offset += len(line)
        return records, None, data
