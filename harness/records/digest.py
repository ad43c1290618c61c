"""Digests of stored rows: a row that was edited after it was measured is found by its own content.

Every line of a records file holds `digest`, the SHA-256 of all its other keys as canonical JSON (keys sorted, no
spaces, ASCII). A digest shows that a row is what was written, not that what was written is true.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

from harness.errors import DefrayError

KEY = "digest"


def digest_of(row: dict) -> str:
    """64 hex digits over every key of `row` but its digest; equal content, equal digest, in any order of keys."""
    content = {key: value for key, value in row.items() if key != KEY}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def sealed(row: dict) -> dict:
    """`row` with its digest as the last key, in place of an earlier one. Raises ValueError for NaN or infinity."""
    content = {key: value for key, value in row.items() if key != KEY}
    return {**content, KEY: digest_of(content)}


def unsealed(row: Any, where: str) -> Any:
    """`row` without its digest, whatever it is where it has none.

    Raises DefrayError, naming `where`, when the digest is not that of the content.
    """
    if not isinstance(row, dict) or KEY not in row:
        return row
    try:
        same = row[KEY] == digest_of(row)
    except ValueError:
        raise DefrayError(f"{where}: holds a number that is not finite") from None
    if not same:
        raise DefrayError(
            f"{where}: edited after it was written, for its digest is not that of its content; "
            "restore it from a copy, or delete it and measure again"
        )
    return {key: value for key, value in row.items() if key != KEY}


def needs_digest(row: dict, where: str) -> None:
    """Raises DefrayError, naming `where`, when a stored row has no digest."""
    if KEY not in row:
        raise DefrayError(f"{where}: has no digest, so nobody can tell whether it was edited")


def check_schema(row: dict, schema: int, where: str) -> None:
    """Raises DefrayError, naming `where`, when `row` is not of this schema."""
    found = row.get("schema")
    if found != schema:
        raise DefrayError(f"{where}: schema {found!r}, but this version reads schema {schema}")


def split_lines(text: str) -> list[str]:
    """Lines of a file of rows. A line feed alone ends one: texts in JSON may hold U+2028 and others, at which
    `str.splitlines` would cut."""
    return text.removesuffix("\n").split("\n") if text else []


def row_title(row: Any) -> str:
    """A row for people: its id, scene and variant, as far as it has them; empty where it has none."""
    if not isinstance(row, dict):
        return ""
    scene = row.get("scene") if isinstance(row.get("scene"), dict) else {}
    variant = row.get("variant") or ":".join(
        str(row[key]) for key in ("tracer", "intersector") if isinstance(row.get(key), str)
    )
    words = " ".join(str(part) for part in (scene.get("name"), variant) if part)
    return ", ".join(part for part in (f"id {row['id']}" if "id" in row else "", words) if part)


def row_place(row: Any, path, line: int) -> str:
    """Where a row lies and what it is, for messages: `records.jsonl, line 3 (id 63ea..., crown embree)`."""
    name = row_title(row)
    return f"{path}, line {line}" + (f" ({name})" if name else "")
