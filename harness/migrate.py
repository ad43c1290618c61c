"""Folders of an older schema brought to this one: `defray migrate DIR`.

From schema 1 to 2, rows gain a digest of their own content. A digest given after the fact cannot show that nothing
was edited before, so each row says when it got it (`migrated_utc`), and the report says how many there are.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

from harness.accuracy_rows import FILE as ACCURACY
from harness.accuracy_rows import PRECISION_FILE, accuracy_row, precision_row
from harness.accuracy_rows import SCHEMA as ROW_SCHEMA
from harness.digest import lines_of, place_of, sealed, unsealed
from harness.errors import DefrayError
from harness.record import now_utc, validated
from harness.record_schema import SCHEMA
from harness.stability import report as stability

FROM = 1
FILES = {"records.jsonl": (SCHEMA, validated), ACCURACY: (ROW_SCHEMA, accuracy_row),
         PRECISION_FILE: (ROW_SCHEMA, precision_row)}


def migrate(folder: Path) -> dict[str, int]:
    """Bring every file of `folder` here; how many rows of each were of schema 1. Rows of this schema stay.

    Nothing is written unless every row of every file is good. Raises DefrayError naming the first that is not.
    """
    time = now_utc()
    planned = {name: _lines(folder / name, *rules, time) for name, rules in FILES.items() if (folder / name).exists()}
    suite = _suite(folder / stability.FILE, time)
    for name, (lines, count) in planned.items():
        if count:
            _replace(folder / name, "".join(line + "\n" for line in lines))
    if suite:
        stability.write_results(folder / stability.FILE, suite)
    counts = {name: count for name, (_, count) in planned.items()}
    return counts | ({stability.FILE: 1} if suite else {})


def _lines(path: Path, schema: int, validate, time: str) -> tuple[list[str], int]:
    """The file's lines in this schema, and how many were not."""
    lines, count = [], 0
    for number, line in enumerate(lines_of(_text(path)), 1):
        row = _json(line, f"{path}, line {number}")
        where = place_of(row, path, number)
        if isinstance(row, dict) and row.get("schema") == FROM and "digest" not in row:
            row = validate({**row, "schema": schema, "migrated_utc": time}, where)
            line, count = json.dumps(sealed(row), allow_nan=False, ensure_ascii=False), count + 1
        else:
            validate(unsealed(row, where), where)
        lines.append(line)
    return lines, count


def _suite(path: Path, time: str) -> stability.Results | None:
    """The stress suite's results in this schema; None where there are none of schema 1."""
    if not path.exists():
        return None
    data = _json(_text(path), str(path))
    if not isinstance(data, dict) or data.get("schema") != FROM:
        stability.read_results(path.parent)
        return None
    return stability.as_results({**data, "schema": stability.SCHEMA, "migrated_utc": time}, path)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DefrayError(f"cannot read {path}: {error}") from None


def _json(text: str, where: str):
    try:
        return json.loads(text)
    except ValueError:
        raise DefrayError(f"{where}: not JSON; restore the file from a copy or delete that line") from None


def _replace(path: Path, text: str) -> None:
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, path)
    except OSError as error:
        raise DefrayError(f"cannot write {path}: {error.strerror}") from None
