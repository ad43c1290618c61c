"""The report on paper: the page's content as a PDF, set by Typst, which its Python package brings whole.

No browser is needed, nor any font of the system, and equal content gives equal bytes.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import typst

from harness.claims.wording import claims_rows, counts_text
from harness.errors import DefrayError
from harness.report.text import origin_rows
from harness.report.write_entry import Written

TEMPLATE = Path(__file__).with_name("paper.typ")
MOST_ROWS = 60  # of a table on paper; the rest is in its CSV
MOST_COLUMNS = 11


def write_pdf(content: dict, path: Path) -> None:
    """Write the content of `report.page_content` to `path`. Raises DefrayError when it cannot be set."""
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        (folder / "paper.typ").write_bytes(TEMPLATE.read_bytes())
        (folder / "report.json").write_text(json.dumps(document(content, folder), ensure_ascii=False), "utf-8")
        try:
            typst.compile(folder / "paper.typ", output=path, ignore_system_fonts=True, timestamp=0)
        except (RuntimeError, OSError) as error:
            raise DefrayError(f"cannot write {path}: {error}") from None


def document(content: dict, folder: Path) -> dict:
    """What the template reads; the figures are copied into `folder`."""
    return {
        "paper": {key: content["paper"][key] for key in ("title", "authors")},
        "summaries": content["summaries"],
        "notices": content["notices"],
        "methods": list(content["methods"]),
        "failures": [{key: failure[key] for key in ("what", "kind", "reason")} for failure in content["failures"]],
        "claims": _claims(content["claims"]),
        "sections": [
            {"title": title, "entries": [_entry(written, folder) for written in entries]}
            for title, entries in content["sections"].items()
        ],
        "machines": [
            {"title": one["title"], "facts": one["facts"], "provenance": one["provenance"]}
            for one in content["machines"]
        ],
    }


def _claims(claims: list[dict]) -> dict:
    """Counts of each machine, and a row a claim: with one machine its verdict and numbers, else those of each."""
    rows = [claims_rows(one["judged"]) for one in claims]
    several = len(claims) > 1
    header = ["claim", *(one["machine"] for one in claims)] if several else ["verdict", "claim", "measured"]
    cells = [
        [same[0]["claim"], *(f"{one['verdict']}: {one['measured']}" for one in same)]
        if several
        else [same[0][name] for name in header]
        for same in zip(*rows, strict=True)
    ]
    counts = [f"{one['machine']}: " * several + counts_text(one["judged"]) for one in claims]
    return {"counts": "; ".join(counts), "header": header, "rows": cells}


def _entry(written: Written, folder: Path) -> dict:
    parts = []
    for part in written.parts:
        if part.drawing:
            (folder / f"{part.stem}.svg").write_bytes(part.drawing.file.read_bytes())
        parts.append(
            {
                "stem": part.stem,
                "machine": part.machine,
                "caption": part.caption,
                "table": None if part.drawing else _table(part.table),
                "origin": origin_rows(part.origin),
            }
        )
    entry = written.entry
    return {"title": entry.title, "number": written.listed.number, "needs": entry.needs, "parts": parts}


def _table(table: dict) -> dict:
    """The table as far as a page holds it: columns that name records go first, then those beyond the width."""
    names = ("run", "runs")
    kept = [place for place, name in enumerate(table["header"]) if name not in names][:MOST_COLUMNS]
    rows = [[row[place] for place in kept] for row in table["rows"][:MOST_ROWS]]
    left = [f"{len(table['rows']) - MOST_ROWS} more rows"] if len(table["rows"]) > MOST_ROWS else []
    others = [name for place, name in enumerate(table["header"]) if place not in kept and name not in names]
    left += [f"columns {', '.join(others)}"] if others else []
    return {
        "header": [table["header"][place] for place in kept],
        "rows": rows,
        "numeric": [bool(table["numeric"][place]) for place in kept],
        "left_out": f"In the CSV file: {' and '.join(left)}." if left else "",
    }
