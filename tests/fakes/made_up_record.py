"""A made-up record of one run, and the machine it says that it ran on."""

from __future__ import annotations

from harness.records.run_row import Record
from harness.records.schema import SCHEMA, checked
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import Uniform

MACHINE = {
    "cpu": "a cpu",
    "cores": 2,
    "os": "an os",
    "device": "a device",
    "platform": "a platform",
    "driver": "1",
    "versions": {"numpy": "2"},
}

RATE = {"median": 1e6, "low": 9e5, "high": 1.1e6}


def make_record(identity: str = "0" * 16, **changes) -> dict:
    """A record, as JSON has it, that validates."""
    spec = RunSpec(scene="sponza", variant=Variant.parse("deferred:ray-space"), structure=Uniform())
    whole = {
        "schema": SCHEMA,
        "id": identity,
        "time_utc": "2030-01-01T00:00:00Z",
        "command": "defray trace sponza",
        "commit": "unknown",
        "dirty": False,
        "machine": dict(MACHINE),
        "view": None,
        "repetitions": 1,
        "spec": spec.model_dump(mode="json"),
        **make_body(),
    }
    return {**whole, **changes}


def make_body() -> dict:
    """The part of a record that the pipeline measures."""
    return {
        "scene": {"name": "sponza", "source": "real", "triangles": 10, "sha256": "ab"},
        "rays": {"kind": "diffuse", "count": 1000, "seed": 1},
        "grid": {
            "top": 8,
            "leaf": 128,
            "reading": "total",
            "cells": 9,
            "nonempty": 4,
            "references": 12,
            "bytes": 100,
            "build_seconds": 0.5,
        },
        "tracer": "deferred",
        "intersector": "ray-space",
        "options": {"wave": "4"},
        "samples": {
            "traverse": [0.1],
            "arrange": [0.1],
            "intersect": [0.1],
            "compact": [],
            "total": [0.3],
        },
        "rate": {"traverse": dict(RATE), "intersect": dict(RATE), "total": dict(RATE)},
        "counters": {
            "steps": 1,
            "pairs": 1,
            "tests": 1,
            "lane_tests": 1,
            "waves": 1,
            "finished_per_wave": [1],
            "padding": 0,
        },
        "agreement": {
            "reference": "embree",
            "same": 1000,
            "tie": 0,
            "t_off": 0,
            "wrong": 0,
            "missed": 0,
            "phantom": 0,
            "reference_wrong": 0,
            "settled": 0,
            "nonfinite": 0,
            "worst_band_ulp": 0.0,
            "rays": 1000,
            "valid": True,
            "reason": "",
            "t_relative_error": {"p50": 0.0, "p99": 0.0, "max": 0.0},
        },
        "valid": True,
    }


def typed(*arguments, **changes) -> Record:
    """`make_record` as a record."""
    return checked(Record, make_record(*arguments, **changes), "here")
