"""Where a row comes from: commit, command, time and machine, added to a body when it is finished."""

from __future__ import annotations

import hashlib
import json
from typing import Any, TypeVar

from pydantic import ValidationError

from harness.errors import DefrayError, first_problem
from harness.files import command_line, commit_and_dirty, now_utc
from harness.records.schema import Body, Machine, Row

RowType = TypeVar("RowType", bound=Row)


def identity(**facts: Any) -> str:
    """16 hex digits that name a row by what was measured: equal facts, equal id."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()[:16]


def latest_rows(rows: list[RowType]) -> list[RowType]:
    """The last row of each measurement on each machine and geometry: one measured again replaces the earlier one."""
    return list({row.measurement: row for row in rows}.values())


def finish(row: type[RowType], body: Body, machine: Machine, **given: Any) -> RowType:
    """A whole row of a measured body: when, where and by which command it was measured, at which commit.

    `given`: the `id` of a body that has none of its own. Raises DefrayError where the body holds a number that is not
    finite, or what the row's class forbids.
    """
    commit, dirty = commit_and_dirty()
    fields = {name: getattr(body, name) for name in type(body).model_fields}
    origin = {"time_utc": now_utc(), "command": command_line(), "commit": commit, "dirty": dirty}
    try:
        return row(**{**fields, **origin, "machine": machine, **given})
    except ValidationError as error:
        raise DefrayError(f"a row of {body.scene.name}: {first_problem(error)}") from None
