"""The figures and tables in the order of the report, and the numbers of the figures."""

from __future__ import annotations

from dataclasses import dataclass

from harness.errors import DefrayError, known
from harness.report.entry import Entry
from harness.report.figures import figures
from harness.report.tables import tables

# What is not listed comes after the rest, by name; a section stands where its first entry does.
ORDER = (
    "views",
    "intersection_speedup",
    "traversal_rate",
    "view_pairs",
    "scenes",
    "resolution",
    "resolution_map",
    "size_ladder",
    "ray_count",
    "end_to_end",
    "intersectors",
    "published_rates",
    "published",
    "break_even",
    "stages",
    "kernel_times",
    "arrangements",
    "roofline",
    "waves",
    "agreement",
    "counters",
    "coherence",
    "grids",
    "speed_accuracy",
    "stability_map",
    "kernel_accuracy",
    "speed_at_floor",
    "precision",
)


@dataclass(frozen=True)
class Listed:
    """A figure or table in its place in the report; `number` counts the figures from 1, a table has none."""

    entry: Entry
    number: int | None

    @property
    def name(self) -> str:
        """Of its files."""
        return self.entry.name

    @property
    def label(self) -> str:
        """`fig05`; empty for a table."""
        return f"fig{self.number:02}" if self.number else ""


def contents() -> list[Listed]:
    """Every figure and table in the order of the report. Raises DefrayError where two have one name."""
    drawn, tabled = figures(), tables()
    for name in sorted(drawn.keys() & tabled.keys()):
        raise DefrayError(f"a figure and a table are both called '{name}'; rename one")
    entries = {**drawn, **tabled}
    places = {name: place for place, name in enumerate(ORDER)}
    ordered = sorted(entries, key=lambda name: (places.get(name, len(places)), name))
    sections = list(dict.fromkeys(entries[name].section for name in ordered))
    ordered.sort(key=lambda name: sections.index(entries[name].section))
    numbers = {name: number for number, name in enumerate((name for name in ordered if name in drawn), 1)}
    return [Listed(entries[name], numbers.get(name)) for name in ordered]


def find_entry(wanted: str) -> Listed:
    """The entry of this name, or the figure with this label, `fig05`; raises DefrayError listing the known ones."""
    entries = contents()
    found = next((one for one in entries if wanted in (one.name, one.label)), None)
    if found is None:
        raise known("figure", wanted, [one.label or one.name for one in entries])
    return found
