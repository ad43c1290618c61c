"""The verdicts on the paper's claims as a part of the page, details folded into each row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from harness.claims.judge import Judged
from harness.claims.wording import MARKS, counts_text, finding_text, measured_text, minutes_text


def claims_html(machines: Sequence[tuple[str, Sequence[Judged]]]) -> Markup:
    """The table as a fragment of the page, with its own few styles.

    `machines`: the verdicts of each with its name; several stand side by side, a column each.
    """
    template = page_templates().get_template("claims.html.jinja")
    return Markup(
        template.render(
            machines=machines,
            several=len(machines) > 1,
            claims=list(zip(*(judged for _, judged in machines), strict=True)),
            marks=MARKS,
            counts_text=counts_text,
            finding_text=finding_text,
            measured_text=measured_text,
            minutes_text=minutes_text,
        )
    )


def page_templates() -> Environment:
    """The templates of this folder: values are escaped, and an unknown one is an error."""
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
