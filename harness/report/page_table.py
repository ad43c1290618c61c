"""Numbers as the page and the printed report show them: headings, digits, an interval beside its value."""

from __future__ import annotations

import re

import pandas as pd

from harness.analysis.names import three_digits

HIDDEN = ("runs", "name", "fewer_rays")
WORDS = {
    "mrays_per_s": "Mrays/s",
    "ns": "(ns)",
    "ulp": "(ulp)",
    "sha256": "SHA-256",
    "megabytes": "(MB)",
    "t_off": "t off",
}


def page_table(numbers: pd.DataFrame) -> dict:
    """Header, alignment and cells of a table as the page shows it; an interval joins its value."""
    columns = [
        name
        for name in numbers.columns
        if name not in HIDDEN and not (name.endswith(("_low", "_high")) and name.rsplit("_", 1)[0] in numbers.columns)
    ]
    numeric = [pd.api.types.is_numeric_dtype(numbers[name]) and numbers[name].dtype != bool for name in columns]
    rows = [[cell_text(row, name) for name in columns] for _, row in numbers.iterrows()]
    return {"header": [heading(name) for name in columns], "numeric": numeric, "rows": rows}


def heading(column: str) -> str:
    """A column's name for people."""
    for code, word in WORDS.items():
        column = re.sub(rf"(^|_){code}($|_)", rf"\1{word}\2", column)
    return column.replace("_", " ")


def cell_text(row: pd.Series, name: str) -> str:
    """A value as text: all digits of a count, three and the interval of a measurement, else four."""
    value = row[name]
    if value is None or (not isinstance(value, str) and pd.isna(value)):
        return "–"
    if isinstance(value, str):
        return value
    if str(value) in ("True", "False"):
        return "yes" if value else "no"
    if float(value).is_integer() and f"{name}_low" not in row:
        return f"{int(value):,}"
    if f"{name}_low" not in row:
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    ends = [row.get(f"{name}_low"), row.get(f"{name}_high")]
    interval = (
        ""
        if any(end is None or pd.isna(end) for end in ends) or ends[0] == ends[1]
        else f" [{three_digits(ends[0])}, {three_digits(ends[1])}]"
    )
    return three_digits(value) + interval
