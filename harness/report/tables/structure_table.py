"""The grids the runs used: size, memory, time to build."""

from __future__ import annotations

import pandas as pd

from harness.analysis.names import grid_text
from harness.analysis.results import Results
from harness.records.schema import GridFacts
from harness.report.entry import Table


def select(runs: Results) -> pd.DataFrame:
    """One row a scene and grid; adaptive grids of several densities are several."""
    rows = runs.valid[runs.valid["grid"] != ""]
    rows = rows.assign(name=[_name(record.grid) for record in rows["record"]]).drop_duplicates(["scene", "name"])
    return pd.DataFrame([_numbers(run) for _, run in rows.iterrows()])


def _name(grid: GridFacts) -> str:
    return grid_text(grid) if grid.density is None else f"{grid_text(grid)}, density {grid.density:g}"


def _numbers(run: pd.Series) -> dict:
    grid, triangles = run["record"].grid, run["triangles"]
    return {
        "scene": run["title"],
        "triangles": triangles,
        "grid": run["name"],
        "cells": grid.cells,
        "nonempty": grid.nonempty,
        "references": grid.references,
        "references_per_triangle": grid.references / triangles if grid.references and triangles else None,
        "grid_megabytes": grid.bytes / 1e6,
        "build_seconds": grid.build_seconds,
        "runs": run["run"],
    }


def caption(runs: Results, numbers: pd.DataFrame) -> str:
    """When the build is timed."""
    return "A grid is built once and shared by the runs that use it; no rate includes its build."


TABLE = Table(
    name="grids",
    section="Correctness and work",
    title="Grids",
    needs="runs on a grid",
    select=select,
    caption=caption,
)
