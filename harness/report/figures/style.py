"""The one look of every figure: colours, marks, type, and how a figure becomes a file or part of a page.

The palette is Okabe and Ito's, distinguishable without colour vision; every series also has its own marker.
In the report each colour becomes a CSS variable, so that a figure follows the page into the dark.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import contextmanager
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from harness.analysis.names import short_number
from harness.spec.tracer_facts import tracer_facts, tracer_place

WIDE, NARROW = 7.2, 3.9  # inches: two columns of a page, and a telephone
FORMATS = ("svg", "pdf", "png")
STRIP = 0.16  # inches below a figure for its id
INK, MUTED, RULE, BAND, PAGE = "#16181b", "#5d636b", "#d5d8dc", "#f1f3f5", "#fffffe"
BLUE, ORANGE, GREEN, RED, PINK, SKY, GREY = (
    "#0072b2",
    "#e69f00",
    "#009e73",
    "#d55e00",
    "#b8568f",
    "#56b4e9",
    "#8b9097",
)
TOKENS = {
    INK: "ink",
    MUTED: "muted",
    RULE: "rule",
    BAND: "band",
    PAGE: "page",
    BLUE: "blue",
    ORANGE: "orange",
    GREEN: "green",
    RED: "red",
    PINK: "pink",
    SKY: "sky",
    GREY: "grey",
}
# On a cell or bar whose colour a dark page keeps, words keep theirs too: none of these is a variable of the page.
PAPER, PRINT, FAINT = "#ffffff", "#111214", "#6b7077"
TRACER_LOOKS = ((SKY, "X"), (INK, "<"), (MUTED, "p"))  # in turn, of tracers that state none
INTERSECTOR_COLOURS = {"ray-space": BLUE, "moller-trumbore": ORANGE}
INTERSECTOR_MARKERS = {"ray-space": "o", "moller-trumbore": "s"}
INTERSECTOR_TITLES = {"ray-space": "ray space", "moller-trumbore": "Möller–Trumbore"}
SCENE_LOOKS = {
    "sponza": (BLUE, "o"),
    "conference": (ORANGE, "s"),
    "hairball": (GREEN, "^"),
    "crown": (RED, "D"),
    "san-miguel": (PINK, "v"),
}
MACHINE_LOOKS = ((BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "^", "-."), (RED, "v", ":"))
SPARE = ((PINK, "P"), (SKY, "X"), (GREEN, "^"), (GREY, "v"))
STAGE_COLOURS = {"traverse": SKY, "arrange": ORANGE, "intersect": BLUE, "compact": GREEN, "other": GREY}
RC = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "axes.titleweight": "bold",
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "xtick.minor.size": 0,
    "ytick.minor.size": 0,
    "grid.color": RULE,
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.facecolor": PAGE,
    "figure.facecolor": PAGE,
    "savefig.facecolor": PAGE,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "lines.markersize": 5,
    "errorbar.capsize": 2,
    "hatch.linewidth": 0.6,
    "figure.dpi": 200,
    "savefig.dpi": 200,
    "text.hinting": "none",
    "figure.constrained_layout.w_pad": 0.06,
    "svg.hashsalt": "defray",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
    "path.simplify": False,
}


@contextmanager
def style():
    """Draw and save inside this; nothing of the caller's matplotlib settings leaks in or out.

    Only matplotlib's own fonts are seen: a system may have another DejaVu, whose letters are other bytes.
    """
    fonts, own = fontManager.ttflist, matplotlib.get_data_path()
    fontManager.ttflist = [font for font in fonts if font.fname.startswith(own)]
    try:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()
            matplotlib.rcParams.update(RC)
            yield
    finally:
        fontManager.ttflist = fonts


def canvas(height: float, narrow: bool) -> Figure:
    """An empty figure of the standard width; `height` in inches."""
    return Figure(figsize=(NARROW if narrow else WIDE, height), layout="constrained")


def fix_layout(figure: Figure) -> Figure:
    """Lay the figure out once and hold it there, rounded.

    The solver behind constrained layout visits constraints in the order of memory addresses, so its results
    differ in the last digits from draw to draw; rounded, they do not.
    """
    for _ in range(2):
        figure.get_layout_engine().execute(figure)
    figure.set_layout_engine("none")
    for axis in figure.axes:
        axis.set_position([round(float(number), 4) for number in axis.get_position(original=True).bounds])
    return figure


def save(figure: Figure, stem: Path, mark: str = "") -> list[Path]:
    """Write `stem`.svg, .pdf and .png, without a date, so that a redraw is the same bytes; `mark`: see `marked`."""
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
    paths = [stem.with_name(f"{stem.name}.{suffix}") for suffix in FORMATS]
    with marked(figure, mark) as area:
        for path in paths:
            figure.savefig(path, format=path.suffix[1:], metadata=undated[path.suffix[1:]], bbox_inches=area)
    return paths


def svg_text(figure: Figure, mark: str = "") -> str:
    """The figure as SVG, as `save` writes it."""
    buffer = io.StringIO()
    with marked(figure, mark) as area:
        figure.savefig(buffer, format="svg", metadata={"Date": None}, bbox_inches=area)
    return buffer.getvalue()


@contextmanager
def marked(figure: Figure, mark: str):
    """Inside this, `mark` stands small in a strip below the figure; gives the area to save, None without a mark."""
    if not mark:
        yield None
        return
    width, height = figure.get_size_inches()
    text = figure.text(
        1 - 0.04 / width, (STRIP - 0.03) / -height, mark, ha="right", va="baseline", fontsize=5, color=MUTED
    )
    try:
        yield Bbox.from_extents(0, -STRIP, width, height)
    finally:
        text.remove()


def intersector_look(name: str | None, number: int = 0) -> tuple[str, str]:
    """Colour and marker of an intersector; unknown ones take spare pairs in turn."""
    if name in INTERSECTOR_COLOURS:
        return INTERSECTOR_COLOURS[name], INTERSECTOR_MARKERS[name]
    return SPARE[number % len(SPARE)]


def tracer_look(name: str) -> tuple[str, str]:
    """Colour and marker of a tracer, as its file states them; spare ones where it does not."""
    facts, spare = tracer_facts(name), TRACER_LOOKS[tracer_place(name) % len(TRACER_LOOKS)]
    colours = {token: colour for colour, token in TOKENS.items()}
    return colours[facts.colour] if facts.colour else spare[0], facts.marker or spare[1]


def fixed_colour(colour: str) -> str:
    """A colour that a dark page does not replace, and that nobody can tell from this one."""
    return f"#{int(colour[1:], 16) ^ 1:06x}"


def machine_look(number: int) -> tuple[str, str]:
    """Colour and marker of a report's machine, counted from 0."""
    return MACHINE_LOOKS[number % len(MACHINE_LOOKS)][:2]


def intersector_title(name: str | None) -> str:
    """Name of an intersector for people; empty where a tracer has none."""
    return INTERSECTOR_TITLES.get(name, name or "")


def log_axis(axis, low: float, high: float, sparse: bool = False) -> None:
    """Labelled ticks for a logarithmic axis of this range: 1-2-5 for short ranges, decades for long ones.

    A range of a few times has more, so that no axis is left with one or two numbers.
    """
    fine = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0) if high / low < 6 else (1.0, 2.0, 5.0)
    subs = fine if high / low < (20 if sparse else 600) else (1.0,)
    axis.set_major_locator(LogLocator(base=10, subs=subs, numticks=30))
    axis.set_major_formatter(FuncFormatter(lambda value, _: short_number(value)))
    axis.set_minor_formatter(NullFormatter())
    axis.set_minor_locator(FixedLocator([]))


def spread(places: Sequence[float], gap: float | Sequence[float], low: float, high: float) -> list[float]:
    """Positions as near to `places` (ascending) as may be, at least `gap` apart, inside [low, high].

    `gap`: one for all, or that between each place and the next. All gaps shrink alike where they do not fit.
    """
    if not len(places):
        return []
    gaps = np.broadcast_to(np.asarray(gap, float), len(places) - 1)
    offsets = np.append(0.0, np.cumsum(gaps))
    offsets *= min(1.0, (high - low) / offsets[-1]) if offsets[-1] else 1.0
    groups: list[tuple[float, int]] = []  # mean and number of neighbours that touch: isotonic regression
    for place in np.asarray(places, float) - offsets:
        mean, count = float(place), 1
        while groups and groups[-1][0] > mean:
            before, number = groups.pop()
            mean, count = (mean * count + before * number) / (count + number), count + number
        groups.append((mean, count))
    shifts = np.concatenate([np.full(count, mean) for mean, count in groups])
    return list(map(float, shifts.clip(low, high - offsets[-1]) + offsets))


def errors(numbers, value: str):
    """Distances from `value` down to `value_low` and up to `value_high`, as matplotlib wants them."""
    down = (numbers[value] - numbers[f"{value}_low"]).clip(lower=0).fillna(0)
    up = (numbers[f"{value}_high"] - numbers[value]).clip(lower=0).fillna(0)
    return [down.to_numpy(dtype=float), up.to_numpy(dtype=float)]
