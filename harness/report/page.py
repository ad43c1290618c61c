"""One report of an output folder: figures as files, tables as CSV, and a page that needs nothing else.

`write_report(folder)` reads `records.jsonl` and, where they exist, `accuracy.jsonl`, `precision.jsonl`,
`coherence.jsonl`, `roofline.jsonl`, `stability.json`, `env.json`, `sweep.json`, `errors.jsonl` and `views/SCENE.png`.
What a figure or table shows is decided in its own module. A folder that holds several machines gets one report with
each of them.
"""

from __future__ import annotations

from pathlib import Path

from markupsafe import Markup

from harness.analysis.results import Results, read_published
from harness.claims import judge_all, write_claims
from harness.errors import DefrayError
from harness.records.accuracy_row import accuracy_file
from harness.records.machines import by_machine, own_folder
from harness.records.origin import latest_rows
from harness.records.precision_row import precision_file
from harness.records.record_file import RecordFile
from harness.records.stability_row import KernelRate, StressRow, read_results
from harness.report.claims_section import claims_html, page_templates
from harness.report.contents import contents, find_entry
from harness.report.entry import Figure
from harness.report.entry_origin import index_records
from harness.report.figures import chart, style
from harness.report.printed import write_pdf
from harness.report.text import (
    METHODS,
    failures,
    machine_rows,
    notices,
    origin_rows,
    provenance_rows,
    redraw_command,
    summary,
)
from harness.report.write_entry import Written, write_entry


def write_report(folder: Path) -> Path:
    """Draw everything that the folder's records allow; returns the path of `report.html`.

    Raises DefrayError when there is no record, or one that this version cannot read.
    """
    folder = Path(folder)
    machines = read_machines(folder)
    for name, suffixes in (("figures", (*style.FORMATS, "json")), ("tables", ("csv", "json"))):
        make_empty(folder / name, suffixes)
    index = index_records(folder)
    with style.style():
        entries = [write_entry(machines, index, listed) for listed in contents()]
    content = page_content(machines, entries)
    page = folder / "report.html"
    page.write_text(render(content), encoding="utf-8")
    write_pdf(content, folder / "report.pdf")
    return page


def redraw(folder: Path, wanted: str) -> list[Path]:
    """Draw one figure or table again, by name, or a figure by number as `fig05`; returns its SVG or CSV files.

    Raises DefrayError for a name that the report lacks, and where the records do not allow the figure.
    """
    folder = Path(folder)
    machines = read_machines(folder)
    listed = find_entry(wanted)
    for name in ("figures", "tables"):
        (folder / name).mkdir(exist_ok=True)
    with style.style():
        written = write_entry(machines, index_records(folder), listed)
    if not written.parts:
        raise DefrayError(f"{listed.label or listed.name} cannot be drawn of {folder}: it needs {listed.entry.needs}")
    kind, suffix = ("figures", "svg") if isinstance(listed.entry, Figure) else ("tables", "csv")
    return [folder / kind / f"{part.stem}.{suffix}" for part in written.parts]


def make_empty(folder: Path, suffixes) -> None:
    """A folder without files of these suffixes, so that no figure of an earlier report is left in it."""
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.suffix[1:] in suffixes:
            path.unlink()


def read_runs(folder: Path) -> Results:
    """The folder's records on the machine that most of them ran on, each run once."""
    return read_machines(folder)[0]


def read_machines(folder: Path) -> list[Results]:
    """The folder's records machine by machine, each run once, the machine with most runs first.

    Raises DefrayError when there is no record, or one that this version cannot read or that was edited.
    """
    records = RecordFile(folder / "records.jsonl").read()
    if not records:
        raise DefrayError(f"no records in {folder / 'records.jsonl'}; run a sweep with --out {folder} first")
    accuracy, precision = (latest_rows(file(folder).read()) for file in (accuracy_file, precision_file))
    apart = by_machine(latest_rows(records))
    several = len(apart) > 1
    found = []
    for key, rows in apart.items():
        own = own_folder(folder, key)
        device = next((row.machine.device for row in rows if row.machine.device), "")
        tests, rates = read_stability(own, device)
        here = [[row for row in kind if row.machine.key == key] for kind in (accuracy, precision)]
        found.append(
            Results(
                rows,
                folder,
                device,
                read_published(),
                *here,
                tests,
                rates,
                machine=key.title if several else "",
                suffix=f"--{key.file_name}" if several else "",
                own=own,
                key=key if several else None,
            )
        )
    return found


def read_stability(folder: Path, device: str) -> tuple[list[StressRow], list[KernelRate]]:
    """Rows and rates of the stress suite, of tests whose hits were right; both empty without a file of this device.

    Raises DefrayError for a file that `defray stability` did not write.
    """
    found = read_results(folder)
    if found is None or (found.machine.device or "") != device:
        return [], []
    return found.rows, [rate for rate in found.kernel_rates if rate.tests_per_second is not None]


def page_content(machines: list[Results], entries: list[Written]) -> dict:
    """What the page and the printed form say."""
    sections: dict[str, list[Written]] = {}
    for written in entries:
        sections.setdefault(written.entry.section, []).append(written)
    first, claims = machines[0], judge_machines(machines)
    return {
        "paper": first.published["paper"],
        "sections": sections,
        "claims": claims,
        "claims_html": verdicts(claims),
        "summaries": [summary(runs) for runs in machines],
        "failures": [failure for runs in machines for failure in failures(runs)],
        "notices": list(dict.fromkeys(notice for runs in machines for notice in notices(runs))),
        "machines": [
            {
                "title": runs.machine or runs.device or "no OpenCL device",
                "facts": machine_rows(runs),
                "provenance": provenance_rows(runs),
            }
            for runs in machines
        ],
        "methods": METHODS,
        "origin_rows": origin_rows,
        "redraw": redraw_command(first.folder),
        "has_charts": any(part.drawing and part.drawing.chart for written in entries for part in written.parts),
    }


def judge_machines(machines: list[Results]) -> list[dict]:
    """The verdicts on the paper's claims, a machine at a time, and `claims.json`."""
    found = []
    for runs in machines:
        judged = judge_all(runs)
        write_claims(judged, runs, runs.folder / f"claims{runs.suffix}.json")
        found.append({"machine": runs.machine, "judged": judged})
    return found


def verdicts(claims: list[dict]) -> Markup:
    """The verdicts of all machines side by side, as part of the page; nothing where nothing judges them."""
    if not claims:
        return Markup()
    return claims_html([(one["machine"], one["judged"]) for one in claims])


def render(content: dict) -> str:
    """The page as HTML."""
    scripts = chart.scripts() if content["has_charts"] else {}
    return page_templates().get_template("page.html.jinja").render(**content, scripts=scripts)
