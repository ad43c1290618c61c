"""Writes one figure or table: its numbers, its drawing and its origin to files, and what the page shows of it.

Where a folder holds several machines, `Entry.machines` says how they are shown.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from markupsafe import Markup

from harness.analysis.results import Results
from harness.report.contents import Listed
from harness.report.entry import Entry, Figure, Found, Machines
from harness.report.entry_origin import entry_origin, record_ids
from harness.report.figures import chart, style
from harness.report.figures.inline import inline_svg
from harness.report.page_table import page_table


@dataclass(frozen=True)
class Drawing:
    """A figure as drawn: its SVG file, the same inline for wide and narrow pages, its chart as JSON if it has one."""

    file: Path
    wide: Markup
    narrow: Markup
    chart: Markup | None


@dataclass(frozen=True)
class PagePart:
    """A figure or table of one machine, or of all together: what the page shows of it.

    `stem`: of its files. `machine`: its title where the folder holds several that are shown apart. `table`: as
    `page_table` makes it. `commands`: what measured its records. `origin`: as in its JSON file. `drawing`: of a
    figure alone.
    """

    stem: str
    machine: str
    caption: str
    table: dict
    commands: list[str]
    origin: dict
    drawing: Drawing | None


@dataclass(frozen=True)
class Written:
    """A figure or table in its place in the report, and its parts; none where the records do not allow it."""

    listed: Listed
    parts: list[PagePart]

    @property
    def entry(self) -> Entry:
        """What it is."""
        return self.listed.entry


def write_entry(machines: list[Results], index: dict, listed: Listed) -> Written:
    """Select, draw and write one figure or table; `index`: as `index_records` makes it of the folder."""
    entry = listed.entry
    found = [(runs, numbers) for runs in machines if not (numbers := entry.select(runs)).empty]
    if len(machines) == 1 or entry.machines is Machines.APART:
        return Written(listed, [write_part([pair], pair[1], index, entry) for pair in found])
    return Written(listed, [write_part(found, joined(found, entry), index, entry)] if found else [])


def joined(found: Found, entry: Entry) -> pd.DataFrame:
    """The numbers of all machines: with a column that names each, or each row once where they are shared."""
    if entry.machines is Machines.TOGETHER:
        every = [numbers.assign(machine=runs.machine) for runs, numbers in found]
        return entry.together(pd.concat(every, ignore_index=True))
    every = pd.concat([numbers for _, numbers in found], ignore_index=True)
    same = [name for name in every.columns if name not in ("runs", "picture")]
    return every.drop_duplicates(same, ignore_index=True)


def write_part(found: Found, numbers: pd.DataFrame, index: dict, entry: Entry) -> PagePart:
    """Numbers, drawing and origin to their files, and all as part of the page.

    `found`: the machines that it shows, each with its own numbers; `numbers`: what is drawn of them.
    """
    runs = found[0][0]
    several = "machine" in numbers or numbers is not found[0][1]
    stem = entry.name if several else entry.name + runs.suffix
    title = "" if several else runs.machine
    csv = numbers.to_csv(index=False)
    (runs.folder / "tables" / f"{stem}.csv").write_text(csv, encoding="utf-8")
    origin = entry_origin(found, index, entry, numbers, csv)
    place = runs.folder / ("figures" if isinstance(entry, Figure) else "tables") / f"{stem}.json"
    place.write_text(json.dumps(origin, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    commands = [command for runs, own in found for command in runs.command_of(record_ids(own))]
    mark = f"{entry.name} {origin['id']}" + (f", {title}" if title else "")
    return PagePart(
        stem=stem,
        machine=title,
        caption=whole_caption(runs, entry, numbers, title),
        table=page_table(numbers),
        commands=list(dict.fromkeys(commands)),
        origin=origin,
        drawing=write_drawing(found, entry, numbers, stem, mark) if isinstance(entry, Figure) else None,
    )


def whole_caption(runs: Results, entry: Entry, numbers: pd.DataFrame, title: str) -> str:
    """The entry's caption, and whose numbers these are where the folder holds several machines."""
    text = entry.caption(runs, numbers)
    if "machine" in numbers:
        return f"{text} Machines: {'; '.join(filter(None, dict.fromkeys(numbers['machine'])))}."
    return f"{text} Measured on {title}." if title else text


def write_drawing(found: Found, figure: Figure, numbers: pd.DataFrame, stem: str, mark: str) -> Drawing:
    """The figure's files, and its two drawings and its chart for the page; `mark` stands small below each."""
    runs = found[0][0]
    wide, narrow = (style.fix_layout(figure.draw(runs, numbers, on_phone)) for on_phone in (False, True))
    file = style.save(wide, runs.folder / "figures" / stem, mark)[0]
    return Drawing(
        file=file,
        wide=Markup(inline_svg(file.read_text(encoding="utf-8"), f"{stem}-wide")),
        narrow=Markup(inline_svg(style.svg_text(narrow, mark), f"{stem}-narrow")),
        chart=chart_json(found, figure, numbers),
    )


def chart_json(found: Found, figure: Figure, numbers: pd.DataFrame) -> Markup | None:
    """The figure's chart to explore as JSON; None for a figure without one."""
    if len(found) > 1:
        return chart.as_json(figure.chart_together(found)) if figure.chart_together else None
    return chart.as_json(figure.chart(found[0][0], numbers)) if figure.chart else None
