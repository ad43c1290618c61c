"""Made-up rows of roofline.jsonl and coherence.jsonl, for the report's tests."""

from __future__ import annotations

from pathlib import Path

from made_up_accuracy import as_row, common

from harness.records.coherence_row import CoherenceRow, coherence_file
from harness.records.roofline_row import RooflineRow, roofline_file

GRID = {
    "top": 8,
    "leaf": 128,
    "reading": "total",
    "cells": 2_000_000,
    "nonempty": 50_000,
    "references": 700_000,
    "bytes": 6_000_000,
    "build_seconds": 0.5,
}
RAYS = {"kind": "diffuse", "count": 64_000, "seed": 1}
# kernel, stage, nanoseconds a ray, flops and bytes a ray, least and each load
KERNELS = {
    "deferred": [
        ("record_pairs", "traverse", 120.0, 300, 140, 420),
        ("scatter_pairs", "arrange", 24.0, 0, 310, 330),
        ("intersect_bins", "intersect", 160.0, 4400, 400, 840),
        ("compaction", "compact", 16.0, 0, 40, 40),
    ],
    "work-optimal": [("intersect_visited", "intersect", 700.0, 3700, 90, 3900)],
}


def rate(value: float) -> dict:
    return {"median": value, "low": 0.98 * value, "high": 1.02 * value}


def kernel_row(name: str, stage: str, nanoseconds: float, flops: int, least: int, loads: int) -> dict:
    count = RAYS["count"]
    return {
        "name": name,
        "stage": stage,
        "own": name != "compaction",
        "launches": 8,
        "seconds": [1e-9 * nanoseconds * count * factor for factor in (0.98, 1.0, 1.02)],
        "nanoseconds": rate(nanoseconds),
        "flops": flops * count,
        "executed_flops": 2 * flops * count,
        "bytes": least * count,
        "uncached_bytes": loads * count,
    }


def roofline_row(scene: str, tracer: str) -> dict:
    kernels = [kernel_row(*kernel) for kernel in KERNELS[tracer]]
    limits = (("memory", "bytes/s", 2e10), ("cache", "bytes/s", 6e10), ("fma", "flop/s", 9e10))
    ceilings = {name: {"unit": unit, "samples": [value] * 3, "rate": rate(value)} for name, unit, value in limits}
    agreement = {
        "reference": "embree",
        "rays": RAYS["count"],
        "same": RAYS["count"],
        "worst_band_ulp": 0.0,
        "t_relative_error": dict.fromkeys(("p50", "p99", "max")),
        "valid": True,
        "reason": "",
        **dict.fromkeys(("tie", "t_off", "wrong", "missed", "phantom", "reference_wrong", "settled", "nonfinite"), 0),
    }
    counters = {
        "steps": 9,
        "pairs": 8,
        "tests": 7,
        "lane_tests": 8,
        "waves": 1,
        "finished_per_wave": [1],
        "padding": 0,
    }
    return common(scene, f"roofline {tracer}", 279_163) | {
        "variant": f"{tracer}:ray-space",
        "tracer": tracer,
        "intersector": "ray-space",
        "options": {},
        "lanes": 8,
        "grid": GRID,
        "rays": RAYS,
        "repetitions": 3,
        "ceilings": {**ceilings, "lanes": 8, "memory_bytes": 1 << 28, "cache_bytes": 1 << 23},
        "seconds": [sum(kernel["seconds"][turn] for kernel in kernels) for turn in range(3)],
        "kernels": kernels,
        "counters": counters,
        "agreement": agreement,
        "valid": True,
    }


def coherence_row(scene: str) -> dict:
    models = (("forward", 24_000), ("deferred", 8000), ("deferred-packed", 7200))
    counts = [
        {
            "model": model,
            "lanes": lanes,
            "steps": 1000,
            "step_trips": 4000 // lanes,
            "uneven_step_trips": 100,
            "tests": 6000,
            "test_trips": trips // lanes,
            "uneven_test_trips": 90,
            "line_trips": trips // lanes,
            "line_tests": 6000,
            "lines_64": 2 * trips // lanes,
            "lines_128": trips // lanes,
        }
        for lanes in (8, 32)
        for model, trips in models
    ]
    return common(scene, "coherence", 279_163) | {
        "intersector": "ray-space",
        "wave": 4,
        "grid": GRID,
        "rays": RAYS,
        "counts": counts,
    }


def write_roofline(folder: Path, scenes=("sponza", "hairball")) -> None:
    """Both files, as `defray roofline` and `defray coherence` leave them."""
    for scene in scenes:
        for tracer in KERNELS:
            roofline_file(folder).append(as_row(RooflineRow, roofline_row(scene, tracer)))
        coherence_file(folder).append(as_row(CoherenceRow, coherence_row(scene)))
