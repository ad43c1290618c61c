"""One figure or table of the report: its numbers, files and sidecar, and what the page shows of it.

Where a folder holds several machines, a module's `MACHINES` says how they are shown: `TOGETHER`, in one figure that
names each machine (its numbers have a column `machine`); `SHARED`, once, for what is the same on every machine;
otherwise one figure a machine, whose caption names it.
"""

from __future__ import annotations

import json

import pandas as pd
from markupsafe import Markup

from harness.analysis.results import Results
from harness.report.cells import page_table
from harness.report.figures import APART, TOGETHER, chart, style
from harness.report.figures.inline import inline_svg
from harness.report.provenance import ids_of, sidecar


def make_block(machines: list[Results], index: dict, entry) -> dict:
    """One figure or table: its files, and its parts of the page.

    `entry`: an Entry of `harness.report.contents`; `index`: as `harness.provenance.index_of` makes it.
    """
    module = entry.module
    found = [(runs, numbers) for runs in machines if not (numbers := module.select(runs)).empty]
    how = getattr(module, "MACHINES", APART) if len(machines) > 1 else APART
    if how == APART:
        parts = [make_part([pair], pair[1], index, entry) for pair in found]
    else:
        parts = [make_part(found, joined(found, module, how), index, entry)] if found else []
    return {
        "name": entry.name,
        "section": module.SECTION,
        "title": module.TITLE,
        "needs": module.NEEDS,
        "label": entry.label,
        "number": entry.number,
        "is_figure": entry.number is not None,
        "parts": parts,
        "empty": not parts,
    }


def joined(found: list[tuple[Results, pd.DataFrame]], module, how: str) -> pd.DataFrame:
    """The numbers of all machines: with a column that names each, or each row once where they are shared.

    A module's `together(numbers)` may tidy what stands there once for each machine though it is of none.
    """
    if how == TOGETHER:
        every = pd.concat([numbers.assign(machine=runs.machine) for runs, numbers in found], ignore_index=True)
        return module.together(every) if hasattr(module, "together") else every
    every = pd.concat([numbers for _, numbers in found], ignore_index=True)
    same = [name for name in every.columns if name not in ("runs", "picture")]
    return every.drop_duplicates(same, ignore_index=True)


def make_part(found: list[tuple[Results, pd.DataFrame]], numbers: pd.DataFrame, index: dict, entry) -> dict:
    """Numbers, figure and sidecar to their files, and all as part of the page.

    `found`: the machines that it shows, each with its own numbers; `numbers`: what is drawn of them.
    """
    runs, module = found[0][0], entry.module
    several = "machine" in numbers or numbers is not found[0][1]
    stem = entry.name if several else entry.name + runs.suffix
    csv = numbers.to_csv(index=False)
    (runs.folder / "tables" / f"{stem}.csv").write_text(csv, encoding="utf-8")
    origin = sidecar(found, index, entry.name, module, numbers, csv)
    place = runs.folder / ("figures" if entry.number else "tables") / f"{stem}.json"
    place.write_text(json.dumps(origin, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    title = "" if several else runs.machine
    commands = [one for runs, own in found for one in runs.command_of(ids_of(own))]
    part = {
        "stem": stem,
        "machine": title,
        "caption": caption_of(runs, module, numbers, title),
        "table": page_table(numbers),
        "commands": list(dict.fromkeys(commands)),
        "origin": origin,
    }
    return part | (draw_part(found, entry, numbers, stem, origin["id"], title) if entry.number else {})


def caption_of(runs: Results, module, numbers: pd.DataFrame, title: str) -> str:
    """The module's caption, and whose numbers these are where the folder holds several machines."""
    text = module.caption(runs, numbers)
    if "machine" in numbers:
        return f"{text} Machines: {'; '.join(filter(None, dict.fromkeys(numbers['machine'])))}."
    return f"{text} Measured on {title}." if title else text


def draw_part(
    found: list[tuple[Results, pd.DataFrame]], entry, numbers: pd.DataFrame, stem: str, identity: str, title: str
) -> dict:
    """The figure's files, and its two drawings and its chart, if it has one, for the page."""
    runs, module = found[0][0], entry.module
    wide, narrow = (style.fix_layout(module.draw(runs, numbers, on_phone)) for on_phone in (False, True))
    mark = f"{entry.name} {identity}" + (f", {title}" if title else "")
    drawn = style.save(wide, runs.folder / "figures" / stem, mark)[0].read_text(encoding="utf-8")
    part = {
        "wide": Markup(inline_svg(drawn, f"{stem}-wide")),
        "narrow": Markup(inline_svg(style.svg_text(narrow, mark), f"{stem}-narrow")),
        "file": runs.folder / "figures" / f"{stem}.svg",
    }
    if hasattr(module, "chart"):
        drawing = module.chart(runs, numbers) if len(found) == 1 else module.chart_together(found)
        part["chart"] = chart.as_json(drawing)
    return part
