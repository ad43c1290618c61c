"""What the report says around its figures: what was measured, what failed, on which machine, from where."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from harness.analysis.names import scene_and_size
from harness.analysis.results import Results
from harness.errors import DefrayError
from harness.records.agreement import why_failed
from harness.records.digest import split_lines
from harness.records.run_row import Record
from harness.spec.run_spec import STAND_IN


def summary(runs: Results) -> str:
    """What was measured, in one line, without a verdict."""
    whole = runs.scenes.assign(base=[scene_and_size(name)[0] for name in runs.scenes["scene"]])
    sources = whole.drop_duplicates("base")["source"]
    stand_ins = int((sources == "stand-in").sum())
    refused = runs.all[~runs.all["valid"]]["record"]
    unchecked, unfinished = int(refused.map(is_unchecked).sum()), len(unfinished_runs(runs))
    tier = read_json(runs.home / "sweep.json").get("tier")
    parts = [
        counted(len(sources), "scene") + (f" ({counted(stand_ins, 'stand-in')})" if stand_ins else ""),
        runs.device or "no OpenCL device",
        f"tier {tier}" if tier else "",
        counted(len(runs.all), "run"),
        counted(len(refused) - unchecked, "failed check"),
    ]
    parts += [f"{counted(unchecked, 'run')} without a check"] if unchecked else []
    parts += [f"{counted(unfinished, 'run')} stopped by an error"] if unfinished else []
    return " · ".join(part for part in parts if part)


def counted(number: int, noun: str) -> str:
    """`1 run`, `2 runs`."""
    return f"{number:,} {noun}" + ("" if number == 1 else "s")


def failures(runs: Results) -> list[dict]:
    """Every run whose check failed and every run that an error stopped, with the reason."""
    found = []
    for _, run in runs.all[~runs.all["valid"]].iterrows():
        what = ", ".join(part for part in (run["title"], run["label"], run["grid"], f"{run['kind']} rays") if part)
        found.append(
            {
                "what": what,
                "reason": why_failed(run["record"].agreement),
                "command": run["record"].command,
                "kind": "no check" if is_unchecked(run["record"]) else "check failed",
            }
        )
    return found + unfinished_runs(runs)


def is_unchecked(record: Record) -> bool:
    """Whether nobody compared the run's hits with anything."""
    return not record.agreement.is_checked


def unfinished_runs(runs: Results) -> list[dict]:
    """Runs that an error stopped and that no later record replaced; a damaged line is shown as it stands."""
    path = runs.home / "errors.jsonl"
    if not path.is_file():
        return []
    measured = {record.id for record in runs.records}
    found = {}
    for line in filter(str.strip, split_lines(path.read_text(encoding="utf-8"))):
        try:
            entry = json.loads(line)
            identity, what, reason = entry["id"], entry["run"], entry["error"]
        except (ValueError, KeyError, TypeError):
            identity, what, reason = line, "a run", line
        if identity not in measured:
            found[identity] = {"what": what, "reason": reason, "kind": "error", "command": ""}
    return list(found.values())


def notices(runs: Results) -> list[str]:
    """What the reader should know before reading numbers."""
    found = []
    planned = read_json(runs.home / "sweep.json").get("runs")
    if isinstance(planned, int) and planned > len(runs.all):
        found.append(f"{len(runs.all):,} of {planned:,} planned runs are on file.")
    if runs.grid != runs.paper_grid:
        found.append(runs.grid_note())
    single = sorted(set(runs.all[runs.all["repetitions"] == 1]["tracer"]))
    if single:
        found.append(
            f"Runs with a single repetition ({', '.join(single)}) have intervals without width, "
            "which say nothing of their spread."
        )
    both = sorted(set(runs.all[runs.all["scene"].str.contains(STAND_IN)]["title"]))
    if both:
        found.append(f"Real geometry and stand-in were both measured, and are both shown: {', '.join(both)}.")
    if runs.all["record"].map(lambda record: record.dirty).any():
        found.append("Some runs were made from a working tree with uncommitted changes.")
    return found


def machine_rows(runs: Results) -> list[tuple[str, str]]:
    """Machine and software, one fact a row: `env.json` over what the records say."""
    machines = [record.machine for record in runs.records]
    here = next((one for one in machines if (one.device or "") == runs.device), machines[0])
    return flat({**here.as_json(), **read_json(runs.home / "env.json")})


def flat(facts: dict, before: str = "") -> list[tuple[str, str]]:
    """Nested facts as rows; what is unknown is left out."""
    rows = []
    for key, value in facts.items():
        name = f"{before}{key.replace('_', ' ') if not before else key}"
        if isinstance(value, dict):
            rows += (
                [(name, ", ".join(f"{one} {version}" for one, version in value.items()))]
                if key == "packages"
                else flat(value, f"{name}: ")
            )
        elif value and isinstance(value, list) and isinstance(value[0], dict):
            rows += [(name, "; ".join(", ".join(f"{k} {v}" for k, v in one.items() if v != "") for one in value))]
        elif value not in (None, "", []):
            rows.append((name, ", ".join(map(str, value)) if isinstance(value, list) else str(value)))
    return rows


def provenance_rows(runs: Results) -> list[tuple[str, str]]:
    """Where the numbers come from, enough to make them again."""
    sweep = read_json(runs.home / "sweep.json")
    commits = list(dict.fromkeys(record.commit for record in runs.records))
    dirty = sum(record.dirty for record in runs.records)
    times = sorted(record.time_utc for record in runs.records)
    digest = hashlib.sha256((runs.folder / "records.jsonl").read_bytes()).hexdigest()
    rows = [
        ("commit", ", ".join(commits)),
        ("working tree", f"{counted(dirty, 'run')} with uncommitted changes" if dirty else "clean"),
        ("measured", f"{times[0]} to {times[-1]}"),
        ("records", f"{len(runs.records):,}"),
        ("records.jsonl, SHA-256", digest),
    ]
    rows += [
        (f"sweep {key}", str(value))
        for key, value in sweep.items()
        if value not in (None, "") and not isinstance(value, dict)
    ]
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


METHODS = (
    "A run is one tracer with one ray/triangle test and its options, on one scene, one set of rays and one grid. "
    "Runs on the same rays and grid are warmed up, then measured in one process with their repetitions "
    "interleaved in random order, so that a change of the machine strikes all of them. A rate is rays over "
    "seconds, the median of the repetitions with its 95 % interval; a ratio pairs repetitions. No rate includes "
    "loading the scene, nor building the grid or Embree's hierarchy, which is reported apart.",
    "Every run's hits are compared ray by ray with Embree's, and each ray in dispute is settled in exact integer "
    "arithmetic. A run that fails has no rate and is drawn nowhere; a run that nobody checked has none either. "
    "Speed against accuracy alone shows rates of variants that fail, beside their errors. "
    "Counters of work (steps, pairs, tests) are exact integers from an instrumented build, equal in every run.",
    "Each record is a line of JSON with a digest of its own content. A record that was edited, that lacks a key "
    "or is of a foreign schema is refused by name, and no report is drawn. Where the paper's geometry is not at "
    "hand, a seeded generator stands in for it, and the name says so.",
    "This is a replication in the sense of the ACM's artifact review: other people, another implementation, "
    "written from the paper without its authors' code.",
)


def origin_rows(origin: dict) -> list[tuple[str, str]]:
    """An origin, as `entry_origin` makes it, as facts for the page; the records stand in its file."""
    files = sorted({record["file"] for record in origin["records"]} | set(origin["files"]))
    return [
        ("id", origin["id"]),
        ("drawn from", f"{counted(len(origin['records']), 'record')} of {', '.join(files)}"),
        ("needs", origin["filter"]["needs"]),
        ("script", f"{origin['script']['path']}, SHA-256 {origin['script']['sha256'][:16]}"),
        ("measured at commit", ", ".join(origin["commits"]) or "not recorded"),
    ]
