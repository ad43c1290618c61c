"""Made-up records for claims: runs whose stages took exactly so long, and claims judged by them."""

from __future__ import annotations

from pathlib import Path

from made_up_accuracy import MACHINE
from made_up_report import agreement, as_records

from harness.analysis.results import Results, read_published
from harness.claims import Claim
from harness.claims.judge import judge
from harness.claims.model import FILE
from harness.claims.operands import Evidence
from harness.data import Counters
from harness.records.schema import SCHEMA

SCENES = ("sponza", "conference", "hairball", "crown", "san-miguel")
TRIANGLES = dict(zip(SCENES, (279_162, 331_179, 2_880_000, 3_532_946, 9_384_653), strict=True))
BASE, OURS = "work-optimal:ray-space", "deferred:ray-space"
RATIO = {
    "type": "ratio",
    "of": {"variant": BASE, "seconds": "intersect"},
    "to": {"variant": OURS, "seconds": "intersect"},
}


def record(
    variant: str,
    scene: str,
    seconds,
    *,
    triangles=None,
    grid="8/128 total",
    valid=True,
    rays=1000,
    stage="intersect",
    **counters,
) -> dict:
    """A record whose stages `stage` and `total` took so long, repetition by repetition."""
    tracer, intersector, *options = variant.split(":")
    place, reading = grid.split(" ")
    top, leaf = map(int, place.split("/"))
    times = list(seconds) if isinstance(seconds, (list, tuple)) else [seconds] * 3
    samples = {
        name: times if name in (stage, "total") else []
        for name in ("traverse", "arrange", "intersect", "compact", "total")
    }
    rate = {"median": 1.0, "low": 1.0, "high": 1.0} if valid else None
    return {
        "schema": SCHEMA, "id": f"{variant} {scene} {grid} {rays}", "valid": valid, "command": "defray sweep",
        "commit": "0" * 40, "dirty": False, "machine": MACHINE | {"device": "a device"},
        "time_utc": "2026-01-01T00:00:00Z", "view": "front",
        "scene": {"name": scene, "source": "stand-in" if scene == "hairball" else "real", "sha256": "",
                  "triangles": triangles or TRIANGLES[scene]},
        "rays": {"kind": "diffuse", "count": rays, "seed": 1}, "tracer": tracer, "intersector": intersector or None,
        "options": dict(option.split("=") for option in options), "repetitions": len(times), "spec": {},
        "rate": {"traverse": None, "intersect": rate, "total": rate}, "samples": samples,
        "counters": Counters(tests=100, pairs=50).model_dump() | counters,
        "agreement": agreement(rays, int(not valid)),
        "grid": {"top": top, "leaf": leaf, "reading": reading, "cells": 9, "nonempty": 9, "references": 9,
                 "bytes": 9, "build_seconds": 1.0},
    }  # fmt: skip


def results(records: list[dict], folder: Path = FILE.parent, **fields) -> Results:
    """Results of made-up records."""
    return Results(as_records(records), folder, "a device", read_published(), **fields)


def verdict(rules, records, **fields):
    """The claim with these rules, judged by these records."""
    rules = [rules] if isinstance(rules, dict) else rules
    claim = Claim.model_validate(
        {
            "id": "made-up",
            "title": "Made up",
            "words": "made up",
            "place": "nowhere",
            "kind": "ratio",
            "reading": "as it stands",
            "tier": "paper",
            "minutes": 1,
            "rule": rules,
        }
    )
    folder = fields.pop("folder", FILE.parent)
    records = records or [record("brute:ray-space", "sponza", 1.0)]
    return judge(claim, Evidence(results(records, folder, **fields), SCENES))


def speedups(factors) -> list[dict]:
    """Records of both sides; a factor is one number, or the base's seconds of each repetition, ours taking 1 s."""
    found = []
    for scene, factor in zip(SCENES, factors, strict=False):
        found.append(record(BASE, scene, factor))
        found.append(record(OURS, scene, [1.0] * len(factor) if isinstance(factor, tuple) else 1.0))
    return found
