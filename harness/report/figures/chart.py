"""Charts to explore: Vega-Lite specifications that the page draws where scripts run, in place of the printed figure.

A figure module with `chart(runs, numbers) -> dict` has one. The library's script comes out of the package vl-convert
and into the page, so that it needs no network. Colours are the page's CSS variables and follow it into the dark.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import pandas as pd
import vl_convert
from markupsafe import Markup

from harness.analysis.results import Results
from harness.report.figures import style

PAGE_SCRIPT = Path(__file__).parents[1] / "page.js"
SCHEMA = "https://vega.github.io/schema/vega-lite/v6.json"
ALL = "all"
INK, MUTED, RULE = (f"var(--{name})" for name in ("ink", "muted", "rule"))
CONFIG = {
    "background": None,
    "font": "system-ui, 'DejaVu Sans', sans-serif",
    "view": {"stroke": None},
    "axis": {
        "labelColor": INK,
        "titleColor": INK,
        "gridColor": RULE,
        "domainColor": MUTED,
        "tickColor": MUTED,
        "titleFontWeight": "normal",
        "labelFontSize": 11,
        "titleFontSize": 12,
    },
    "legend": {
        "labelColor": INK,
        "titleColor": MUTED,
        "orient": "bottom",
        "columns": {"expr": "width < 250 ? 1 : width < 420 ? 2 : 5"},
        "symbolStrokeColor": MUTED,
        "titleFontWeight": "normal",
        "labelLimit": 220,
    },
    "title": {"color": INK},
}
SHAPES = {
    "o": "circle",
    "s": "square",
    "D": "diamond",
    "P": "cross",
    "X": "stroke",
    "v": "triangle-down",
    "^": "triangle-up",
    "<": "triangle-left",
    "p": "wedge",
    "h": "arrow",
    "*": "triangle-right",
}


def explored(rows: list[dict], filters: dict[str, str], layers: list[dict], height, defaults=None) -> dict:
    """A chart of `rows` whose reader chooses by `filters`, column to heading.

    The first column starts at its first value, another at what `defaults` says, else at all. The last of
    `layers` holds the points.
    """
    rows = [{key: value for key, value in row.items() if not _absent(value)} for row in rows]
    first = next(iter(filters))
    starts = {first: rows[0][first]} | (defaults or {})
    return {
        "$schema": SCHEMA,
        "width": "container",
        "height": height,
        "data": {"name": "rows", "values": rows},
        "params": [choice(rows, column, title, starts.get(column, ALL)) for column, title in filters.items()],
        "transform": [
            {
                "filter": " && ".join(
                    f"(choose_{column} == '{ALL}' || datum['{column}'] == choose_{column})" for column in filters
                )
            }
        ],
        "layer": [{**layer, "name": f"layer_{place}"} for place, layer in enumerate(layers)],
        "config": CONFIG,
    }


def choice(rows: list[dict], column: str, title: str, start: str) -> dict:
    """A drop-down over the values of a column, with all of them as a choice."""
    values = list(dict.fromkeys(row[column] for row in rows if column in row))
    return {
        "name": f"choose_{column}",
        "value": start,
        "bind": {"input": "select", "name": title, "options": [ALL, *values]},
    }


def by_tracer(rows: list[dict]) -> dict:
    """Colour by tracer, as the figures have it."""
    names = list(dict.fromkeys(row["tracer"] for row in rows))
    colours = [f"var(--{style.TOKENS[style.tracer_look(name)[0]]})" for name in names]
    return {"field": "tracer", "type": "nominal", "title": None, "scale": {"domain": names, "range": colours}}


def tooltip(fields: dict[str, str]) -> list[dict]:
    """What hovering shows: field to heading; numbers with four digits, counts whole."""
    return [{"field": field, "title": title} for field, title in fields.items()]


def number(value, digits: int = 4) -> str | None:
    """A number as hovering shows it; None for none."""
    if value is None or pd.isna(value):
        return None
    return f"{int(value):,}" if float(value).is_integer() else f"{value:.{digits}g}"


def interval(row, name: str) -> str | None:
    """A rate with its 95 % interval, as hovering shows it."""
    if pd.isna(row[name]):
        return None
    return f"{row[name]:.4g} [{row[f'{name}_low']:.4g}, {row[f'{name}_high']:.4g}]"


def record_facts(runs: Results, identity: str) -> dict[str, str]:
    """Of the record behind a point: its id, when and at which commit it was measured, and its command."""
    rows = [*runs.records, *runs.accuracy]
    record = next((row for row in rows if row.id == identity), None)
    if record is None:
        return {"record": identity}
    return {
        "record": identity,
        "measured": record.time_utc,
        "commit": record.commit[:10],
        "command": record.command,
    }


RECORD_FIELDS = {"record": "record", "measured": "measured", "commit": "commit", "command": "command"}


def _absent(value) -> bool:
    return value is None or (isinstance(value, float) and pd.isna(value))


def as_json(specification: dict) -> Markup:
    """A specification for a script element: `<` cannot end it."""
    return Markup(json.dumps(specification, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c"))


@lru_cache(maxsize=1)
def scripts() -> dict[str, Markup]:
    """The library as one script, and the page's own few lines."""
    library = vl_convert.javascript_bundle(vl_version="6.4")
    return {
        "library": Markup("(() => {" + library.replace("</script", "<\\/script") + "})();"),
        "page": Markup(PAGE_SCRIPT.read_text(encoding="utf-8")),
    }
