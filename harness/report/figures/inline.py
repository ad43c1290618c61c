"""A figure's SVG made fit to stand in a page: light, its ids its own, its colours the page's."""

from __future__ import annotations

import base64
import hashlib
import io
import re

from PIL import Image

from harness.report.figures.style import TOKENS


def inline_svg(text: str, name: str) -> str:
    """SVG to set into a page: no prolog, ids those of `name` alone, colours as CSS variables, no byte too many."""
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    text = _short_ids(text, f"f{hashlib.sha256(name.encode()).hexdigest()[:6]}-")
    for colour, token in TOKENS.items():
        text = text.replace(colour, f"var(--{token})")
    text = re.sub(r'(?<=data:image/)png;base64,([^"]+)', lambda found: _lighter(found[1]), text)
    # Two decimals of a point are less than a pixel, and half of the page's weight.
    text = re.sub(r'(?<= )(d|x|y|transform)="[^"]+"', lambda found: _short_numbers(found[0]), text)
    text = re.sub(r"<g */>|<g>\s*</g>", "", text)
    return re.sub(r"\n\s*", "\n", text).strip()


def _short_ids(text: str, prefix: str) -> str:
    """Ids that something refers to, as the prefix and a number; the others go."""
    used = dict.fromkeys(re.findall(r'(?:href="|url\()#([^")]+)', text))
    short = {name: f"{prefix}{number}" for number, name in enumerate(used)}
    text = re.sub(r' id="([^"]*)"', lambda found: f' id="{short[found[1]]}"' if found[1] in short else "", text)
    return re.sub(r'((?:href="|url\()#)([^")]+)', lambda found: found[1] + short[found[2]], text)


def _short_numbers(attribute: str) -> str:
    """A path or place with two decimals a number and no space that a reader of SVG does not need."""
    attribute = re.sub(
        r"(\.\d\d)\d+" if "matrix" not in attribute and "scale" not in attribute else r"(\.\d{4})\d+",
        r"\1",
        attribute,
    )
    return re.sub(r"\s*([MLQCz])\s*", r"\1", attribute) if attribute.startswith("d=") else attribute


def _lighter(png: str) -> str:
    """A picture, base64 of a PNG, as the end of a data URI that weighs less: WebP."""
    with Image.open(io.BytesIO(base64.b64decode(png))) as picture:
        buffer = io.BytesIO()
        picture.convert("RGB").save(buffer, format="webp", quality=80, method=6)
    return f"webp;base64,{base64.b64encode(buffer.getvalue()).decode()}"
