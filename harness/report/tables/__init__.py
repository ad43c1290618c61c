"""Tables of the report, one file each.

A table module has `ORDER`, `SECTION`, `TITLE`, `NEEDS`, `select(runs) -> DataFrame` and
`caption(runs, numbers) -> str`, as a figure does, and no `draw`. A new table is a new file.
"""

from __future__ import annotations

from types import ModuleType

from harness.report.figures import modules_in


def tables() -> dict[str, ModuleType]:
    """Every table of this folder by name, in the order of the report."""
    return modules_in(__name__, __path__)
