"""Figures of the report, one file each, which ends in `FIGURE = Figure(...)`; see harness/report/entry.py."""

from __future__ import annotations

from harness.report.entry import Figure, entries_in


def figures() -> dict[str, Figure]:
    """Every figure of this folder by its name. Raises DefrayError where two have one name."""
    return entries_in(__name__, __path__, Figure)
