"""Where a row comes from: commit, command, time and machine, added when it is finished."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from harness.files import command_line, commit_and_dirty, now_utc
from harness.records.machines import key_of
from harness.records.record_file import validated
from harness.records.run_row import SCHEMA
from harness.spec.run_spec import RunSpec


def row_facts(machine: dict) -> dict:
    """When, where and by which command a row is measured; `machine` as `device.machine.machine_description` tells."""
    commit, dirty = commit_and_dirty()
    return {
        "time_utc": now_utc(),
        "command": command_line(),
        "commit": commit,
        "dirty": dirty,
        "machine": machine,
    }


def identity(**facts: Any) -> str:
    """16 hex digits that name a row by what was measured: equal facts, equal id."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()[:16]


def latest_rows(rows: list[dict]) -> list[dict]:
    """The last row of each measurement on each machine and geometry: one measured again replaces the earlier one."""
    return list({(row["id"], key_of(row["machine"]), *source_of(row["scene"])): row for row in rows}.values())


def source_of(scene: dict) -> tuple[str, str]:
    """What tells a scene from another of its name: real, stand-in or file, and the SHA-256 of its triangles."""
    return scene["source"], scene["sha256"]


def finish(body: dict, spec: RunSpec, machine: dict) -> dict:
    """A whole record: the measured `body` of one run with its id, time, command, commit and machine added.

    Raises DefrayError when the body lacks a key, has one too many or holds a number that is not finite.
    """
    record = {
        "view": spec.view,
        **body,
        "schema": SCHEMA,
        "id": spec.id,
        **row_facts(machine),
        "repetitions": spec.repetitions,
        "spec": spec.model_dump(mode="json"),
    }
    return validated(record, f"the record of {spec.scene} {spec.variant}")
