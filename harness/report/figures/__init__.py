"""Figures of the report, one file each.

A figure module has `ORDER` (its place in the report), `SECTION`, `TITLE`, `NEEDS` (the records it draws, in
words), `select(runs) -> DataFrame` (its numbers; a column `runs` names the records behind each row),
`caption(runs, numbers) -> str` and `draw(runs, numbers, narrow) -> Figure`. A new figure is a new file.
`MACHINES` says how several machines are shown (see harness/report_parts.py); a figure with `MACHINES = TOGETHER`
draws numbers with a column `machine` too.
"""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType

APART, TOGETHER, SHARED = "a figure a machine", "one figure of all machines", "the same on every machine"


def modules_in(package: str, path) -> dict[str, ModuleType]:
    """Modules of a folder that state what they need (`NEEDS`), by name, in the order of the report."""
    names = sorted(entry.name for entry in pkgutil.iter_modules(path))
    modules = {name: importlib.import_module(f"{package}.{name}") for name in names}
    blocks = {name: module for name, module in modules.items() if hasattr(module, "NEEDS")}
    return dict(sorted(blocks.items(), key=lambda item: (item[1].ORDER, item[0])))


def figures() -> dict[str, ModuleType]:
    """Every figure of this folder by name, in the order of the report."""
    return modules_in(__name__, __path__)
