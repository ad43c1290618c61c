"""The report's contents: one file is enough for a figure or a table, which is then found by name and by number."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from made_up_report import deferred, make_folder

from harness.errors import DefrayError
from harness.report import figures as figure_folder
from harness.report import tables as table_folder
from harness.report.contents import ORDER, contents, find_entry
from harness.report.entry import Figure
from harness.report.page import redraw, write_report

TOY = '''
import pandas as pd

from harness.report.entry import {kind}
from harness.report.figures import style


def select(runs):
    """Rates of all runs."""
    return runs.all[["scene", "total", "run"]].rename(columns={{"run": "runs"}})


def caption(runs, numbers):
    """A word."""
    return "Toy."


def draw(runs, numbers, narrow):
    """A line."""
    figure = style.canvas(1.5, narrow)
    figure.subplots().plot(numbers["total"])
    return figure


{name} = {kind}(
    name="{file}", section="{section}", title="A toy", needs="any run", select=select, caption=caption, {more}
)
'''


def add_toy(folder: Path, monkeypatch, kind: str, file: str, section: str) -> None:
    """One file with a figure or table in a folder that the report looks into."""
    folder.mkdir(exist_ok=True)
    more = "draw=draw" if kind == "Figure" else ""
    text = TOY.format(kind=kind, name=kind.upper(), file=file, section=section, more=more)
    (folder / f"{file}.py").write_text(text)
    package = figure_folder if kind == "Figure" else table_folder
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(folder)])


def test_the_order_names_every_entry_that_is_there_once():
    assert sorted(ORDER) == sorted(listed.name for listed in contents())


def test_figures_are_numbered_from_one_and_found_by_number_and_by_name():
    numbered = [listed for listed in contents() if isinstance(listed.entry, Figure)]
    assert [listed.label for listed in numbered] == [f"fig{number:02}" for number in range(1, len(numbered) + 1)]
    for listed in numbered:
        assert find_entry(listed.label) == find_entry(listed.name) == listed
    assert all(not listed.label for listed in contents() if listed not in numbered)


def test_an_unknown_figure_is_one_line_with_the_known_ones():
    with pytest.raises(DefrayError, match=r"^unknown figure 'fig99'; known: agreement, .*fig01, fig02"):
        find_entry("fig99")


def test_one_figure_is_drawn_by_its_number_as_by_its_name(tmp_path):
    make_folder(tmp_path, [deferred("sponza")])
    label = next(listed.label for listed in contents() if listed.name == "traversal_rate")
    (by_number,) = redraw(tmp_path, label)
    drawn = by_number.read_bytes()
    (by_name,) = redraw(tmp_path, "traversal_rate")
    assert by_number == by_name == tmp_path / "figures" / "traversal_rate.svg"
    assert drawn == by_name.read_bytes()


def test_make_hands_the_number_of_a_figure_on():
    done = subprocess.run(
        ["make", "-n", "fig31", "OUT=some-folder"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert re.search(r"defray report \"some-folder\" --only fig31\b", done.stdout)


def test_a_figure_is_one_file(tmp_path, monkeypatch):
    before = {listed.name: listed.number for listed in contents()}
    add_toy(tmp_path / "more", monkeypatch, "Figure", "toy_of_rates", "Toys")
    assert {listed.name: listed.number for listed in contents()[:-1]} == before
    assert contents()[-1].name == "toy_of_rates"
    make_folder(tmp_path / "out", [deferred("sponza")])
    page = write_report(tmp_path / "out").read_text(encoding="utf-8")
    assert page.index('id="toy_of_rates"') > page.index('id="views"')
    (file,) = redraw(tmp_path / "out", contents()[-1].label)
    assert file.name == "toy_of_rates.svg" and "toy_of_rates" in file.read_text()


def test_a_table_is_one_file_and_comes_last_in_its_section(tmp_path, monkeypatch):
    add_toy(tmp_path / "more", monkeypatch, "Table", "toy_table", "End to end")
    section = [listed.name for listed in contents() if listed.entry.section == "End to end"]
    assert section[-1] == "toy_table" and section[-2] == "break_even"
    make_folder(tmp_path / "out", [deferred("sponza")])
    (file,) = redraw(tmp_path / "out", "toy_table")
    assert file.read_text().startswith("scene,total,runs\nsponza,")


def test_two_of_one_name_are_one_clear_line(tmp_path, monkeypatch):
    add_toy(tmp_path / "more", monkeypatch, "Table", "waves", "End to end")
    with pytest.raises(DefrayError, match="a figure and a table are both called 'waves'"):
        contents()


def test_two_files_of_one_name_are_one_clear_line(tmp_path, monkeypatch):
    add_toy(tmp_path / "more", monkeypatch, "Figure", "second_views", "Scenes")
    file = tmp_path / "more" / "second_views.py"
    file.write_text(file.read_text().replace('name="second_views"', 'name="views"'))
    with pytest.raises(DefrayError, match="second_views is called 'views', as another is"):
        contents()
