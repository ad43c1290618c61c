"""What a figure or table of the report is: the parts that each file in figures/ and tables/ states at its end.

A new figure is one file in harness/report/figures/ that ends in `FIGURE = Figure(...)`, a new table one in
harness/report/tables/ that ends in `TABLE = Table(...)`; nothing else names it. It comes after those that
`harness.report.contents.ORDER` lists, or last in its section.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TypeVar

import pandas as pd
from matplotlib.figure import Figure as Drawing

from harness.analysis.results import Results
from harness.errors import DefrayError

Found = Sequence[tuple[Results, pd.DataFrame]]  # machines, each with its own numbers


class Machines(Enum):
    """How the numbers of a folder's several machines are shown."""

    APART = "one of each machine, whose caption names it"
    TOGETHER = "one of all machines; its numbers have a column `machine`"
    SHARED = "one, of what is the same on every machine"


def unchanged(numbers: pd.DataFrame) -> pd.DataFrame:
    """The same numbers."""
    return numbers


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What figures and tables have in common.

    `name`: of its files, and for `defray report --only`. `needs`: the records it shows, in words. `select`: its
    numbers of one machine, empty where the records do not allow it; a column `runs` names the records behind each
    row, ids with spaces between. `caption`: of these numbers. `files`: patterns of what it reads beside records, in
    the folder, or in the checkout for `harness/`. `together`: tidies the numbers of all machines where `machines` is
    TOGETHER.
    """

    name: str
    section: str
    title: str
    needs: str
    select: Callable[[Results], pd.DataFrame]
    caption: Callable[[Results, pd.DataFrame], str]
    machines: Machines = Machines.APART
    files: tuple[str, ...] = ()
    together: Callable[[pd.DataFrame], pd.DataFrame] = unchanged


@dataclass(frozen=True, kw_only=True)
class Table(Entry):
    """A table: its numbers as CSV, and on the page."""


@dataclass(frozen=True, kw_only=True)
class Figure(Entry):
    """A figure: its numbers and their drawing.

    `draw`: of a machine's results and the numbers, for a narrow page where the last argument is true. `chart`: the
    same as a Vega-Lite specification to explore, where there is one; `chart_together`: that of several machines,
    which a figure with a chart needs where `machines` is not APART.
    """

    draw: Callable[[Results, pd.DataFrame, bool], Drawing]
    chart: Callable[[Results, pd.DataFrame], dict] | None = None
    chart_together: Callable[[Found], dict] | None = None


Kind = TypeVar("Kind", Figure, Table)


def entries_in(package: str, path: Iterable[str], kind: type[Kind]) -> dict[str, Kind]:
    """What the files of a folder state as `FIGURE` or `TABLE`, by name; files that state none help the others.

    Raises DefrayError where two have one name.
    """
    found: dict[str, Kind] = {}
    for file in pkgutil.iter_modules(path):
        entry = vars(importlib.import_module(f"{package}.{file.name}")).get(kind.__name__.upper())
        if entry is None:
            continue
        if entry.name in found:
            raise DefrayError(f"{package}.{file.name} is called '{entry.name}', as another is; rename it")
        found[entry.name] = entry
    return found
