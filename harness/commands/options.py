"""What several commands share: options, how they print JSON and errors, and the records of a folder."""

from __future__ import annotations

import json
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.errors import DefrayError

SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE_OR_FILE", help="A name that 'defray scenes' lists, or a mesh file.")
]
FolderArgument = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sweep, with its records.jsonl.")]
DeviceOption = Annotated[
    str | None, typer.Option(metavar="PART", help="Part of 'platform / name' as 'defray doctor' prints it.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, nothing else there.")]
RaysOption = Annotated[str, typer.Option(metavar="COUNT", help="Number of rays: 64k, 1M, 2500000.")]
KindOption = Annotated[str, typer.Option(help="primary, diffuse, ambient-occlusion or random.")]
SeedOption = Annotated[int, typer.Option(help="Seed of the rays; the same seed gives the same rays.")]
ViewOption = Annotated[str | None, typer.Option(help="Camera of the scene; its first by default.")]
StructureOption = Annotated[
    str,
    typer.Option(
        "--structure",
        "--grid",
        metavar="TEXT",
        help="What space is cut into: '8/128' (cells per axis of the two levels), '8/128 per-cell', 'adaptive', "
        "'adaptive density=0.3', or 'auto': density, wave, growth and batch by a cost model, for the scene, the "
        "rays, the device and the deferred variant, if there is one.",
    ),
]
ResumeOption = Annotated[bool, typer.Option("--resume", help="Keep the rows on file and measure what is missing.")]
RepetitionsOption = Annotated[int, typer.Option(min=1, help="Timed repetitions.")]
CheckOption = Annotated[
    str, typer.Option(help="Compare hits with 'embree' or with 'exact' arithmetic, or 'none' (no check).")
]
TracerOption = Annotated[str, typer.Option(help="deferred, streamed, forward, work-optimal, brute or embree.")]
IntersectorOption = Annotated[
    str | None,
    typer.Option(
        help="Ray/triangle test: ray-space (default), moller-trumbore or another of harness/spec/intersectors.py; "
        "embree has its own."
    ),
]
SettingsOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=VALUE",
        help="Option of the tracer, may be repeated: wave, growth (deferred, streamed), arrange, compaction, pairs, "
        "form (deferred), streams (streamed), exit (forward), lanes, batch, contraction (all on a device), robust, "
        "threads (embree).",
    ),
]
RayFileOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Your own rays instead of --kind: .npz with 'origins' and 'directions' float\\[n,3] and maybe "
        "'t_max' float\\[n], or raw little-endian 6 x float32 a ray; the first --rays of them.",
    ),
]


def again() -> str:
    """The command that goes on with this one when it is stopped."""
    arguments = [Path(sys.argv[0]).name, *sys.argv[1:]]
    return shlex.join(arguments + ([] if "--resume" in arguments else ["--resume"]))


def print_json(value: Any) -> None:
    """`value` on one line of standard output; raises ValueError for a number that is not finite."""
    typer.echo(json.dumps(value, allow_nan=False, ensure_ascii=False))


def print_error(message: str) -> None:
    """One line on standard error, red on a terminal."""
    red, plain = ("\033[31m", "\033[0m") if sys.stderr.isatty() and not os.environ.get("NO_COLOR") else ("", "")
    print(f"{red}error:{plain} {message}", file=sys.stderr)


def show_rows(rows: Sequence, json: bool, show: Callable) -> None:
    """JSON of all rows on standard output, or each as `show` prints it."""
    if json:
        print_json([row.as_json() for row in rows])
        return
    for row in rows:
        show(row)


def records_of(folder: Path) -> Path:
    """The records of a sweep's folder; raises DefrayError where there are none."""
    file = folder / "records.jsonl"
    if not file.is_file():
        raise DefrayError(f"{folder} has no records.jsonl; run a sweep first: defray sweep FILE --out {folder}")
    return file
