"""Tables of the report, one file each, which ends in `TABLE = Table(...)`; see harness/report/entry.py."""

from __future__ import annotations

from harness.report.entry import Table, entries_in


def tables() -> dict[str, Table]:
    """Every table of this folder by its name. Raises DefrayError where two have one name."""
    return entries_in(__name__, __path__, Table)
