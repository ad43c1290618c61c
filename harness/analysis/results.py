"""Records as a table: one row a run, rates in millions of rays a second, and the selections figures share."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pandas as pd

from harness.analysis.names import (
    RATES,
    beside_text,
    grid_text,
    options_text,
    plain,
    scene_and_size,
    stand_in_name,
    variant_text,
)
from harness.analysis.ratios import main_workload
from harness.errors import DefrayError
from harness.files import ROOT
from harness.records.accuracy_row import AccuracyRow
from harness.records.coherence_row import CoherenceRow, coherence_file
from harness.records.origin import latest_rows
from harness.records.precision_row import PrecisionRow
from harness.records.roofline_row import RooflineRow, roofline_file
from harness.records.run_row import Record
from harness.records.schema import GridFacts, MachineKey, Row, SceneFacts
from harness.records.stability_row import KernelRate, StressRow
from harness.spec.run_spec import STAND_IN
from harness.spec.tracer_facts import tracer_place
from harness.stats import megarays

PUBLISHED = ROOT / "harness" / "paper" / "published.toml"


@dataclass(frozen=True, eq=False)
class Results:
    """What a report is drawn from, of one machine: the latest record of each run, and what stands beside them.

    `accuracy`: the latest rows of accuracy.jsonl on the report's device, `precision` those of precision.jsonl.
    `stability`: the rows of stability.json, and `kernel_rates` its rates of tests. Each is empty without its file.
    """

    records: list[Record]
    folder: Path
    device: str
    published: dict = field(default_factory=dict)
    accuracy: list[AccuracyRow] = field(default_factory=list)
    precision: list[PrecisionRow] = field(default_factory=list)
    stability: list[StressRow] = field(default_factory=list)
    kernel_rates: list[KernelRate] = field(default_factory=list)
    machine: str = ""  # its title, where the folder holds several
    suffix: str = ""  # of the names of its files, likewise
    own: Path | None = None  # where the machine's own files are, if not in `folder`
    key: MachineKey | None = None  # what tells it from the others, where the folder holds several

    @cached_property
    def home(self) -> Path:
        """Where the files are that a folder has one of for each machine."""
        return self.own or self.folder

    @cached_property
    def all(self) -> pd.DataFrame:
        """Every run, in an order that does not depend on when it was measured: the paper's order of scenes,
        then kind and number of rays, grid, tracer, intersector, options."""
        rows = pd.DataFrame([run_columns(record, self.title_of(record.scene)) for record in self.records])
        sources = rows.groupby("scene")["source"].transform("nunique") > 1
        both = sources & (rows["source"] == "stand-in")
        rows.loc[both, "scene"] = [stand_in_name(name) for name in rows.loc[both, "scene"]]
        rows["place"] = [self.scene_place(name) for name in rows["scene"]]
        rows["order"] = [order_of(row) for row in rows.itertuples()]
        by = ["place", "triangles", "scene", "order"]
        return rows.sort_values(by, kind="stable").drop(columns="order").reset_index(drop=True)

    @cached_property
    def whole(self) -> pd.DataFrame:
        """Valid runs on whole scenes: the rungs of the size ladder have a figure of their own."""
        return self.valid[self.valid["size"] == "1"].reset_index(drop=True)

    @cached_property
    def valid(self) -> pd.DataFrame:
        """Runs whose hits were checked and found right, on the report's device: all that figures draw."""
        rows = self.all
        here = (rows["device"] == self.device) | (rows["tracer"] == "embree")
        return rows[(rows["valid"]) & here].reset_index(drop=True)

    @cached_property
    def every_diffuse(self) -> pd.DataFrame:
        """Valid diffuse runs on whole scenes, of any number of rays."""
        return self.whole[self.whole["kind"] == "diffuse"].reset_index(drop=True)

    @cached_property
    def diffuse(self) -> pd.DataFrame:
        """Valid diffuse runs of each scene's main workload: view, ray count and seed of most tracers and tests."""
        return main_workload(self.every_diffuse)

    @cached_property
    def paper_grid(self) -> str:
        """The paper's grid as a grid's name, 8 and 128 cells an axis over the whole scene."""
        return f"{self.published['paper']['top']}/{self.published['paper']['leaf']} total"

    @cached_property
    def grid(self) -> str:
        """The paper's grid if any diffuse run used it, else the grid that most of them used."""
        grids = self.every_diffuse["grid"]
        grids = grids[grids != ""]
        return self.paper_grid if (grids == self.paper_grid).any() or grids.empty else grids.mode().iloc[0]

    @cached_property
    def paper(self) -> pd.DataFrame:
        """Diffuse runs of the main workload on `grid`."""
        return main_workload(self.every_diffuse[self.every_diffuse["grid"] == self.grid])

    @cached_property
    def roofline(self) -> list[RooflineRow]:
        """The latest valid rows of the folder's roofline.jsonl on the report's device and machine."""
        return [
            row
            for row in latest_rows(roofline_file(self.folder).read())
            if row.valid
            and (row.machine.device or "") == self.device
            and (self.key is None or row.machine.key == self.key)
        ]

    @cached_property
    def coherence(self) -> list[CoherenceRow]:
        """The latest rows of the folder's coherence.jsonl, whose counts are those of every device."""
        return list({row.id: row for row in coherence_file(self.folder).read()}.values())

    def grid_note(self) -> str:
        """One sentence: the grid of the runs in `paper`, and a warning where it is not the paper's."""
        if self.grid == self.paper_grid:
            return f"Grid {self.grid}, as in the paper."
        return (
            f"Grid {self.grid}: nothing was measured on the paper's {self.paper_grid}, so these numbers "
            "are not its figure's."
        )

    @cached_property
    def scenes(self) -> pd.DataFrame:
        """One row a scene: name, title, source, triangles."""
        columns = ["scene", "title", "source", "triangles"]
        return self.all[columns].drop_duplicates("scene").reset_index(drop=True)

    def view_file(self, scene: str) -> Path:
        """Where the picture of a scene's view is, if it was made."""
        return self.folder / "views" / f"{scene}.png"

    def published_scene(self, scene: str) -> dict | None:
        """What the paper says of this scene."""
        name = plain(scene.removesuffix(STAND_IN))
        return next((one for one in self.published["scene"] if plain(one["name"]) == name), None)

    def title_of(self, scene: SceneFacts) -> str:
        """Title of the scene that a row describes; a stand-in is called a stand-in."""
        title = self.scene_title(scene.name)
        return f"{title} (stand-in)" if scene.is_stand_in else title

    def scene_title(self, scene: str) -> str:
        """Name of a scene for people, without its source."""
        base, size = scene_and_size(scene)
        known = self.published_scene(base)
        title = known["title"] if known else base
        return title if size == "1" else f"{title} at {size}"

    def scene_place(self, scene: str) -> int:
        """Position of a scene in the paper's figure 1; scenes it lacks come after."""
        names = [plain(one["name"]) for one in self.published["scene"]]
        base = plain(scene_and_size(scene)[0].removesuffix(STAND_IN))
        return names.index(base) if base in names else len(names)

    def command_of(self, ids) -> list[str]:
        """The distinct commands that made these runs, in order."""
        wanted = set(ids)
        every: list[Row] = [*self.records, *self.accuracy, *self.precision, *self.roofline, *self.coherence]
        return list(dict.fromkeys(row.command for row in every if row.id in wanted and row.command))


def read_published(path: Path = PUBLISHED) -> dict:
    """The paper's and others' numbers."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise DefrayError(f"cannot read published numbers {path.name}: {error}") from error


def run_columns(run: Record, title: str) -> dict:
    """One record as flat columns, itself as `record`; a rate that the run does not have is NaN."""
    grid = run.grid
    columns = {
        "run": run.id,
        "scene": run.scene.name,
        "source": run.scene.source,
        "title": title,
        "size": scene_and_size(run.scene.name)[1],
        "triangles": run.scene.triangles,
        "kind": run.rays.kind,
        "rays": run.rays.count,
        "seed": run.rays.seed,
        "view": run.view or "",
        "tracer": run.tracer,
        "intersector": run.intersector or "",
        "options": options_text(run.options),
        "label": variant_text(run),
        "method": f"{run.tracer}:{run.intersector or ''}",
        "device": run.machine.device or "",
        "valid": run.valid,
        "grid": grid_text(grid),
        "beside": beside_text(run),
        "top": grid.top if grid else None,
        "leaf": grid.leaf if grid else None,
        "reading": grid.reading if grid else "",
        "cells": cells_per_axis(grid),
        "grid_megabytes": grid.bytes / 1e6 if grid else float("nan"),
        "repetitions": run.repetitions,
        "record": run,
    }
    for name in RATES:
        rate = getattr(run.rate, name)
        columns[name] = megarays(rate and rate.median)
        columns[f"{name}_low"] = megarays(rate and rate.low)
        columns[f"{name}_high"] = megarays(rate and rate.high)
    return columns


def order_of(row) -> tuple:
    """Place of a run among those of its scene."""
    grid = (0, 0) if pd.isna(row.top) else (row.top, row.leaf)
    return (
        row.kind != "diffuse",
        row.kind,
        -row.rays,
        row.reading != "total",
        row.reading,
        *grid,
        tracer_place(row.tracer),
        row.tracer,
        row.intersector != "ray-space",
        row.intersector,
        row.options,
    )


def cells_per_axis(grid: GridFacts | None) -> float:
    """Leaf cells an axis over the whole scene; NaN where they differ from place to place, or there is no grid."""
    if grid and grid.reading == "total":
        return float(grid.leaf)
    if grid and grid.reading == "per-cell":
        return float(grid.top * grid.leaf)
    return float("nan")
