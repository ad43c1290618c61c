"""Made-up records of a whole report: runs of every tracer with invented times, and folders as a sweep leaves them."""

from __future__ import annotations

import hashlib
import json
import re

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from made_up_accuracy import write_accuracy
from made_up_roofline import write_roofline

from harness.data import Samples
from harness.records.digest import sealed
from harness.records.run_row import Record
from harness.records.schema import SCHEMA, checked
from harness.report.page import write_report
from harness.stats import rates

SIZES = {"sponza": 279_163, "conference": 331_179, "hairball": 2_880_000, "crown": 3_540_215, "san-miguel": 9_390_000}
STAND_INS = ("hairball",)
# Invented nanoseconds a ray on the paper's grid: walk, arrange, deferred intersection, work-optimal.
TIMES = {
    "sponza": (70, 29, 91, 1823),
    "conference": (45, 32, 54, 308),
    "hairball": (900, 210, 1400, 9100),
    "crown": (430, 80, 610, 4532),
    "san-miguel": (240, 116, 178, 3900),
}
EMBREE = {"sponza": 270, "conference": 82, "hairball": 400, "crown": 204, "san-miguel": 314}
RAYS = 1_000_000
SMOKE = ("sponza", "hairball")


def agreement(rays: int, wrong: int = 0) -> dict:
    """An agreement in which so many rays are wrong."""
    return {
        "reference": "embree",
        "rays": rays,
        "same": rays - 120 - wrong,
        "tie": 118,
        "t_off": 2,
        "wrong": wrong,
        "missed": 0,
        "phantom": 0,
        "reference_wrong": 3,
        "settled": 5,
        "nonfinite": 0,
        "worst_band_ulp": 2.5,
        "t_relative_error": {"p50": 1e-8, "p99": 3e-7, "max": 4e-5},
        "valid": wrong == 0,
        "reason": f"{wrong} rays hit a wrong primitive" if wrong else "",
    }


def one_record(
    scene, tracer, intersector, stages, *, options=None, grid=(8, 128, "total"), rays=RAYS, wrong=0, repetitions=5
) -> dict:
    """A record with made-up times: `stages` maps a stage to nanoseconds a ray."""
    name = json.dumps([scene, tracer, intersector, options, grid, rays])
    identity = hashlib.sha256(name.encode()).hexdigest()[:16]
    random = np.random.default_rng(int(identity, 16) % 2**32)
    seconds = {
        stage: [float(value * rays * 1e-9 * factor) for factor in random.lognormal(0, 0.03, repetitions)]
        for stage, value in stages.items()
    }
    samples = {stage: seconds.get(stage, []) for stage in ("traverse", "arrange", "intersect", "compact")}
    samples["total"] = seconds.get("total") or [
        float(sum(part) * 1.06) for part in zip(*filter(None, samples.values()), strict=True)
    ]
    rated = rates(Samples(**samples), rays, valid=wrong == 0)
    rate = {stage: found and found.as_dict() for stage, found in rated.items()}
    cells = (grid[1] * (grid[0] if grid[2] == "per-cell" else 1)) ** 3 // 20 if grid else 0
    return {
        "schema": SCHEMA,
        "id": identity,
        "time_utc": "2026-01-02T03:04:05Z",
        "command": f"defray trace {scene} --tracer {tracer}",
        "commit": "0123456789abcdef",
        "dirty": False,
        "machine": {
            "cpu": "Test CPU",
            "cores": 2,
            "os": "Linux",
            "device": "pthread-test AVX-512 device",
            "platform": "Portable Computing Language",
            "driver": "3.1",
            "versions": {"numpy": "2.0", "pyopencl": "2026.1"},
        },
        "scene": {
            "name": scene,
            "source": "stand-in" if scene in STAND_INS else "real",
            "triangles": SIZES[scene],
            "sha256": "ab" * 32,
        },
        "view": None,
        "rays": {"kind": "diffuse", "count": rays, "seed": 1},
        "grid": {
            "top": grid[0],
            "leaf": grid[1],
            "reading": grid[2],
            "cells": cells,
            "nonempty": cells // 9,
            "references": SIZES[scene] * 3,
            "bytes": SIZES[scene] * 12 + cells * 4,
            "build_seconds": 1.5,
        }
        if grid
        else None,
        "tracer": tracer,
        "intersector": intersector,
        "options": options or {},
        "repetitions": repetitions,
        "spec": {},
        "samples": samples,
        "rate": rate,
        "counters": {
            "steps": 33 * rays,
            "pairs": 8 * rays,
            "tests": 140 * rays,
            "lane_tests": 149 * rays,
            "waves": 6,
            "finished_per_wave": [rays],
            "padding": 4 * rays,
        },
        "agreement": agreement(rays, wrong),
        "valid": wrong == 0,
    }


def deferred(scene, intersector="ray-space", walk=1.0, work=1.0, **keys) -> dict:
    """A deferred record whose stages are the table's times by these factors."""
    traverse, arrange, intersect, _ = TIMES[scene]
    slower = 1.4 if intersector == "moller-trumbore" else 1.0
    return one_record(
        scene,
        "deferred",
        intersector,
        {
            "traverse": traverse * walk,
            "arrange": arrange * walk,
            "intersect": intersect * slower * work,
            "compact": arrange * 0.2,
        },
        **keys,
    )


def scene_records(scene: str) -> list[dict]:
    """What the paper tier measures on one scene, without the sweep of resolutions."""
    optimal = TIMES[scene][3]
    found = []
    for name, slower in (("ray-space", 1.0), ("moller-trumbore", 1.15)):
        found += [
            deferred(scene, name),
            one_record(scene, "work-optimal", name, {"intersect": optimal * slower}),
            one_record(scene, "work-optimal", name, {"intersect": optimal * slower / 2.5}, options={"lanes": "8"}),
            one_record(scene, "forward", name, {"total": optimal * slower * 1.1}),
        ]
    found += [
        deferred(scene, options={"arrange": "sort"}, walk=3.0),
        deferred(scene, options={"arrange": "record"}, walk=0.7),
        deferred(scene, options={"arrange": "record", "wave": "8"}, walk=0.7),
        deferred(scene, grid=(8, 128, "per-cell"), walk=5.0, work=0.5),
    ]
    found += [
        one_record(scene, "embree", None, {"total": EMBREE[scene] * slower}, options={"robust": robust}, grid=None)
        for robust, slower in (("true", 1.0), ("false", 0.9))
    ]
    found += [
        deferred(scene, options=options, work=work)
        for options, work in (({"wave": "2"}, 0.9), ({"wave": "all"}, 1.8), ({"compaction": "false"}, 1.1))
    ]
    return [
        *found,
        one_record(scene, "brute", "ray-space", {"total": 900 * SIZES[scene] / 1000}, grid=None, rays=20_000),
    ]


def resolution_records(scene: str) -> list[dict]:
    """Resolutions around the paper's 128, with fewer rays than figure 1."""
    found = []
    found += [
        deferred(scene, walk=leaf / 128, work=128 / leaf, grid=(16, leaf, "total"), rays=RAYS // 10)
        for leaf in (32, 64, 128)
    ]
    found += [deferred(scene, walk=0.4, work=0.3, grid=(40, 16, "adaptive"), rays=RAYS // 10)]
    for leaf in (32, 64, 128, 256, 512):
        fine, grid = leaf / 128, (8, leaf, "total")
        optimal = TIMES[scene][3] * (0.4 / fine + 0.6)
        usual = {"grid": grid, "rays": RAYS // 10}
        found += [
            deferred(scene, walk=fine, work=0.8 / fine + 0.2, **usual),
            one_record(scene, "work-optimal", "ray-space", {"intersect": optimal}, **usual),
            one_record(scene, "forward", "ray-space", {"total": optimal * 1.1 + 99 * fine}, **usual),
        ]
    return found


def ladder_records(scene: str) -> list[dict]:
    """Rungs of the size ladder with fewer rays than figure 1, the whole scene among them."""
    found = []
    for size, part in (("@1/64", 1 / 64), ("@1/16", 1 / 16), ("@1/4", 1 / 4), ("", 1.0)):
        optimal = {"intersect": TIMES[scene][3] * part**0.6}
        for record in (
            deferred(scene, walk=part**0.2, work=part**0.3, rays=RAYS // 5),
            one_record(scene, "work-optimal", "ray-space", optimal, rays=RAYS // 5),
        ):
            record["id"] = hashlib.sha256((record["id"] + size).encode()).hexdigest()[:16]
            record["scene"] |= {"name": scene + size, "triangles": int(SIZES[scene] * part)}
            found.append(record)
    return found


def ray_count_records(scene: str) -> list[dict]:
    """Few rays cost more each than many; those of figure 1 are the third point."""
    found = []
    for rays, dearer in ((RAYS // 16, 1.6), (RAYS // 4, 1.2), (RAYS * 4, 0.95)):
        found.append(deferred(scene, walk=dearer, work=dearer, rays=rays))
        found.append(
            one_record(
                scene, "embree", None, {"total": EMBREE[scene]}, options={"robust": "true"}, grid=None, rays=rays
            )
        )
    return found


def as_records(made: list[dict]) -> list[Record]:
    """Made-up JSON objects as records, whose class says what is wrong with them."""
    return [checked(Record, one, "a made-up record") for one in made]


def make_folder(folder, records: list[dict], views=()) -> None:
    """An output folder as a sweep leaves it."""
    folder.mkdir(parents=True, exist_ok=True)
    text = "".join(json.dumps(sealed(record)) + "\n" for record in records)
    (folder / "records.jsonl").write_text(text, encoding="utf-8")
    (folder / "env.json").write_text(json.dumps(records[0]["machine"] if records else {}), encoding="utf-8")
    sweep = {"seed": 1, "tier": "paper", "command": "make reproduce TIER=paper"}
    (folder / "sweep.json").write_text(json.dumps(sweep), encoding="utf-8")
    (folder / "views").mkdir(exist_ok=True)
    for name in views:
        down, across = np.mgrid[0:96, 0:128]
        picture = 0.5 + 0.5 * np.sin(across / 9 + len(name)) * np.cos(down / 13)
        matplotlib.image.imsave(folder / "views" / f"{name}.png", picture, cmap="gray")


def paper_folder(folder, scenes=tuple(SIZES)):
    """A full folder: some scenes, a sweep of resolutions, one failed check, one run stopped by an error."""
    records = [one for scene in scenes for one in scene_records(scene)]
    records += [one for scene in scenes for one in resolution_records(scene)]
    records += [one for scene in scenes for one in ladder_records(scene)]
    records += [one for scene in scenes for one in ray_count_records(scene)]
    records.append(deferred("crown", options={"compaction": "broken"}, wrong=17))
    make_folder(folder, records, [*(name for name in scenes if name != "crown"), "sponza-stand-in"])
    error = {
        "id": "feedfeedfeedfeed",
        "scene": "crown",
        "run": "crown 8/128 deferred:ray-space:wave=1",
        "error": "the device ran out of memory",
    }
    (folder / "errors.jsonl").write_text(json.dumps(error) + "\n", encoding="utf-8")
    write_accuracy(folder)
    write_roofline(folder)
    return folder


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A full report, drawn once: its folder."""
    folder = paper_folder(tmp_path_factory.mktemp("report") / "out", ("sponza", "hairball", "crown"))
    assert write_report(folder) == folder / "report.html"
    return folder


def page_of(folder) -> str:
    return (folder / "report.html").read_text(encoding="utf-8")


def without_scripts(page: str) -> str:
    """The page as a reader without scripts has it."""
    return re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def numbers_of(folder, name: str) -> pd.DataFrame:
    return pd.read_csv(folder / "tables" / f"{name}.csv", keep_default_na=False, na_values=[""])
