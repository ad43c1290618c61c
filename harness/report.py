"""One report of an output folder: figures as files, tables as CSV, and a page that needs nothing else.

`write_report(folder)` reads `records.jsonl` and, where they exist, `env.json`, `sweep.json`, `errors.jsonl`
and `views/SCENE.png`. What a figure or table shows is decided in its own module.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from pathlib import Path

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from harness.accuracy_rows import accuracy_file, latest_rows, precision_file
from harness.claims import claims_html, judge_all, write_claims
from harness.errors import DefrayError
from harness.figures import figures, style
from harness.figures.runs import Runs, as_command, label_of, latest, read_published, rung_of
from harness.record import RecordFile
from harness.stability.report import read_results
from harness.tables import tables

HIDDEN = ("runs", "name", "fewer_rays")
WORDS = {"mrays_per_s": "Mrays/s", "ns": "(ns)", "ulp": "(ulp)", "sha256": "SHA-256", "megabytes": "(MB)",
         "t_off": "t off"}
DISAGREEMENTS = ("t_off", "wrong", "missed", "phantom", "nonfinite")


def write_report(folder: Path) -> Path:
    """Draw everything that the folder's records allow; returns the path of `report.html`.

    Raises DefrayError when there is no record, or one that this version cannot read.
    """
    folder = Path(folder)
    runs = read_runs(folder)
    for name, suffixes in (("figures", style.FORMATS), ("tables", ("csv",))):
        make_empty(folder / name, suffixes)
    modules = {**figures(), **tables()}
    ordered = sorted(modules, key=lambda name: (modules[name].ORDER, name))
    with style.style():
        blocks = [make_block(runs, name, modules[name]) for name in ordered]
    judged = judge_all(runs)
    write_claims(judged, runs, folder / "claims.json")
    page = folder / "report.html"
    page.write_text(render(runs, blocks, claims_html(judged)), encoding="utf-8")
    return page


def make_empty(folder: Path, suffixes) -> None:
    """A folder without files of these suffixes, so that no figure of an earlier report is left in it."""
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.suffix[1:] in suffixes:
            path.unlink()


def read_runs(folder: Path) -> Runs:
    """The folder's records, each run once; the device is the one that most of them ran on."""
    records = RecordFile(folder / "records.jsonl").read()
    if not records:
        raise DefrayError(f"no records in {folder / 'records.jsonl'}; run a sweep with --out {folder} first")
    kept = latest(records)
    devices = Counter(r["machine"].get("device") or "" for r in kept if r["tracer"] != "embree")
    device = devices.most_common(1)[0][0] if devices else kept[0]["machine"].get("device") or ""
    accuracy, precision = (
        [row for row in latest_rows(file(folder).read()) if (row["machine"].get("device") or "") == device]
        for file in (accuracy_file, precision_file)
    )
    tests, rates = read_stability(folder, device)
    return Runs(kept, folder, device, read_published(), accuracy, precision, tests, rates)


def read_stability(folder: Path, device: str) -> tuple[list[dict], list[dict]]:
    """Rows and rates of the stress suite, of tests whose hits were right; both empty without a file of this device.

    Raises DefrayError for a file that `defray stability` did not write.
    """
    found = read_results(folder)
    if found is None or (found.machine.get("device") or "") != device:
        return [], []
    rates = [rate.model_dump() for rate in found.kernel_rates if rate.tests_per_second is not None]
    return [row.model_dump() for row in found.rows], rates


def make_block(runs: Runs, name: str, module) -> dict:
    """Numbers of one figure or table to CSV, the figure to its three files, and both as parts of the page."""
    numbers = module.select(runs)
    block = {"name": name, "section": module.SECTION, "title": module.TITLE, "needs": module.NEEDS,
             "is_figure": hasattr(module, "draw"), "empty": numbers.empty}
    if numbers.empty:
        return block
    numbers.to_csv(runs.folder / "tables" / f"{name}.csv", index=False)
    ids = " ".join(numbers["runs"]).split() if "runs" in numbers else []
    block |= {"caption": module.caption(runs, numbers), "table": page_table(numbers),
              "commands": runs.command_of(ids)}
    if block["is_figure"]:
        wide, narrow = (style.settle(module.draw(runs, numbers, on_phone)) for on_phone in (False, True))
        drawn = style.save(wide, runs.folder / "figures" / name)[0].read_text(encoding="utf-8")
        block["wide"] = Markup(style.inline_svg(drawn, f"{name}-wide"))
        block["narrow"] = Markup(style.inline_svg(style.svg_text(narrow), f"{name}-narrow"))
    return block


def render(runs: Runs, blocks: list[dict], claims: Markup) -> str:
    """The page as HTML; `claims` is the table of claims, ready for it."""
    environment = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True,
                              undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    sections: dict[str, list[dict]] = {}
    for block in blocks:
        sections.setdefault(block["section"], []).append(block)
    template = environment.get_template("report.html.jinja")
    return template.render(paper=runs.published["paper"], summary=summary(runs), failures=failures(runs),
                           notices=notices(runs), claims=claims, sections=sections, machine=machine_rows(runs),
                           provenance=provenance_rows(runs), redraw=redraw_command(runs.folder))


def summary(runs: Runs) -> str:
    """What was measured, in one line, without a verdict."""
    whole = runs.scenes.assign(base=[rung_of(name)[0] for name in runs.scenes["scene"]])
    sources = whole.drop_duplicates("base")["source"]
    stand_ins = int((sources == "stand-in").sum())
    refused = runs.all[~runs.all["valid"]]["record"]
    unchecked, unfinished = int(refused.map(is_unchecked).sum()), len(unfinished_runs(runs))
    tier = read_json(runs.folder / "sweep.json").get("tier")
    parts = [counted(len(sources), "scene") + (f" ({counted(stand_ins, 'stand-in')})" if stand_ins else ""),
             runs.device or "no OpenCL device", f"tier {tier}" if tier else "", counted(len(runs.all), "run"),
             counted(len(refused) - unchecked, "failed check")]
    parts += [f"{counted(unchecked, 'run')} without a check"] if unchecked else []
    parts += [f"{counted(unfinished, 'run')} stopped by an error"] if unfinished else []
    return " · ".join(part for part in parts if part)


def counted(number: int, noun: str) -> str:
    """`1 run`, `2 runs`."""
    return f"{number:,} {noun}" + ("" if number == 1 else "s")


def failures(runs: Runs) -> list[dict]:
    """Every run whose check failed and every run that an error stopped, with the reason."""
    found = []
    for _, run in runs.all[~runs.all["valid"]].iterrows():
        what = ", ".join(part for part in (run["title"], run["label"], run["grid"], f"{run['kind']} rays")
                         if part)
        found.append({"what": what, "reason": reason_of(run["record"].get("agreement") or {}),
                      "command": as_command(run["record"].get("command") or ""),
                      "kind": "no check" if is_unchecked(run["record"]) else "check failed"})
    return found + unfinished_runs(runs)


def is_unchecked(record: dict) -> bool:
    """Whether nobody compared the run's hits with anything."""
    return (record.get("agreement") or {}).get("reference") == "none"


def reason_of(agreement: dict) -> str:
    """Why a check failed: as recorded, else the classes of rays that disagree."""
    if agreement.get("reason"):
        return agreement["reason"]
    if agreement.get("reference") == "none":
        return "not checked against any reference"
    counts = [f"{agreement[name]:,} {name.replace('_', ' ')}" for name in DISAGREEMENTS
              if agreement.get(name)]
    return f"rays that disagree with {agreement.get('reference')}: {', '.join(counts) or 'not recorded'}"


def unfinished_runs(runs: Runs) -> list[dict]:
    """Runs that an error stopped and that no later record replaced."""
    path = runs.folder / "errors.jsonl"
    if not path.is_file():
        return []
    measured = {record["id"] for record in runs.records}
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            entry = {"error": line} if line.strip() else None
        if isinstance(entry, dict) and entry.get("id") not in measured:
            what = name_of_error(entry)
            reason = str(entry.get("error") or entry.get("message") or entry)
            found[entry.get("id") or what] = {"what": what, "reason": reason, "kind": "error",
                                              "command": as_command(entry.get("command") or "")}
    return list(found.values())


def name_of_error(entry: dict) -> str:
    """The run of an error line, as far as the line names it."""
    if entry.get("run"):
        return str(entry["run"])
    spec = entry.get("spec") if isinstance(entry.get("spec"), dict) else {}
    variant = entry.get("variant") or spec.get("variant") or ""
    if isinstance(variant, dict):
        variant = label_of(variant)
    scene = entry.get("scene") or spec.get("scene") or ""
    return ", ".join(part for part in (str(scene), str(variant)) if part) or str(entry.get("id", "a run"))


def notices(runs: Runs) -> list[str]:
    """What the reader should know before reading numbers."""
    found = []
    elsewhere = runs.all[(runs.all["device"] != runs.device) & (runs.all["tracer"] != "embree")]
    if len(elsewhere):
        names = ", ".join(sorted(set(elsewhere["device"])))
        found.append(f"{counted(len(elsewhere), 'run')} on other devices ({names}): in the table of "
                     "agreement and drawn nowhere.")
    planned = read_json(runs.folder / "sweep.json").get("runs")
    if isinstance(planned, int) and planned > len(runs.all):
        found.append(f"{len(runs.all):,} of {planned:,} planned runs are on file.")
    if runs.grid != runs.paper_grid:
        found.append(runs.grid_note())
    single = sorted(set(runs.all[runs.all["repetitions"] == 1]["tracer"]))
    if single:
        found.append(f"Runs with a single repetition ({', '.join(single)}) have intervals without width, "
                     "which say nothing of their spread.")
    if runs.all["record"].map(lambda record: record.get("dirty")).any():
        found.append("Some runs were made from a working tree with uncommitted changes.")
    return found


def machine_rows(runs: Runs) -> list[tuple[str, str]]:
    """Machine and software, one fact a row: `env.json` over what the records say."""
    machines = [record["machine"] for record in runs.records]
    here = next((one for one in machines if (one.get("device") or "") == runs.device), machines[0])
    return flat({**here, **read_json(runs.folder / "env.json")})


def flat(facts: dict, before: str = "") -> list[tuple[str, str]]:
    """Nested facts as rows; what is unknown is left out."""
    rows = []
    for key, value in facts.items():
        name = f"{before}{key.replace('_', ' ') if not before else key}"
        if isinstance(value, dict):
            rows += flat(value, f"{name}: ")
        elif value not in (None, "", []):
            rows.append((name, ", ".join(map(str, value)) if isinstance(value, list) else str(value)))
    return rows


def provenance_rows(runs: Runs) -> list[tuple[str, str]]:
    """Where the numbers come from, enough to make them again."""
    sweep = read_json(runs.folder / "sweep.json")
    commits = list(dict.fromkeys(record["commit"] for record in runs.records))
    dirty = sum(bool(record["dirty"]) for record in runs.records)
    times = sorted(record["time_utc"] for record in runs.records)
    digest = hashlib.sha256((runs.folder / "records.jsonl").read_bytes()).hexdigest()
    rows = [("commit", ", ".join(commits)),
            ("working tree", f"{counted(dirty, 'run')} with uncommitted changes" if dirty else "clean"),
            ("measured", f"{times[0]} to {times[-1]}"), ("records", f"{len(runs.records):,}"),
            ("records.jsonl, SHA-256", digest)]
    rows += [(f"sweep {key}", as_command(value) if key == "command" else str(value))
             for key, value in sweep.items() if value not in (None, "") and not isinstance(value, dict)]
    return rows


def redraw_command(folder: Path) -> str:
    """The command that draws this report again, from the current folder where that holds the output."""
    try:
        return f"defray report {folder.resolve().relative_to(Path.cwd())}"
    except ValueError:
        return f"defray report {folder.name}"


def read_json(path: Path) -> dict:
    """A JSON object, or nothing where there is no file. Raises DefrayError for a file that is not one."""
    if not path.is_file():
        return {}
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DefrayError(f"{path} is not JSON ({error}); remove it or write it again") from error
    if not isinstance(value, dict):
        raise DefrayError(f"{path} holds no JSON object; remove it or write it again")
    return value


def page_table(numbers: pd.DataFrame) -> dict:
    """Header, alignment and cells of a table as the page shows it; an interval joins its value."""
    columns = [name for name in numbers.columns if name not in HIDDEN
               and not (name.endswith(("_low", "_high")) and name.rsplit("_", 1)[0] in numbers.columns)]
    numeric = [pd.api.types.is_numeric_dtype(numbers[name]) and numbers[name].dtype != bool
               for name in columns]
    rows = [[cell(row, name) for name in columns] for _, row in numbers.iterrows()]
    return {"header": [heading(name) for name in columns], "numeric": numeric, "rows": rows}


def heading(column: str) -> str:
    """A column's name for people."""
    for code, word in WORDS.items():
        column = re.sub(rf"(^|_){code}($|_)", rf"\1{word}\2", column)
    return column.replace("_", " ")


def cell(row: pd.Series, name: str) -> str:
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
    interval = "" if any(end is None or pd.isna(end) for end in ends) or ends[0] == ends[1] else \
        f" [{digits(ends[0])}, {digits(ends[1])}]"
    return digits(value) + interval


def digits(value: float) -> str:
    """Three significant digits with their zeros; zero as it is."""
    return style.three_digits(value) if value else "0"
