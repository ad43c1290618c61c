"""Made-up rows of accuracy.jsonl and a made-up stability.json, for the report's tests."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from harness.records.accuracy_row import AccuracyRow, accuracy_file
from harness.records.digest import sealed
from harness.records.precision_row import PrecisionRow, precision_file
from harness.records.schema import SCHEMA, Row, checked
from harness.records.stability_row import StressResults
from harness.stats import interval, rates_of

DEVICE = "pthread-test AVX-512 device"
# variant: million rays a second, leaks of 100,000 aimed rays, relative error of t
VARIANTS = {
    "deferred:ray-space": (0.30, 0, 2e-7),
    "deferred:ray-space:contraction=on": (0.31, 0, 2e-7),
    "deferred:moller-trumbore": (0.36, 9_000, 3e-7),
    "deferred:plucker": (0.25, 40, 2e-7),
    "deferred:baldwin-weber": (0.28, 20_000, 8e-6),
    "forward:ray-space": (0.20, 0, 2e-7),
    "embree": (1.5, 400, 2e-7),
    "embree:robust=false": (2.0, 15_000, 2e-7),
}
MACHINE = {
    "cpu": "Test CPU",
    "cores": 2,
    "os": "Linux",
    "device": DEVICE,
    "platform": "Portable Computing Language",
    "driver": "3.1",
    "versions": {"numpy": "2.0"},
}


def common(scene: str, name: str, triangles: int) -> dict:
    identity = hashlib.sha256(f"{scene} {name}".encode()).hexdigest()[:16]
    return {
        "schema": SCHEMA,
        "id": identity,
        "time_utc": "2026-01-02T03:04:05Z",
        "machine": MACHINE,
        "dirty": False,
        "command": f"defray accuracy {scene}",
        "commit": "0123456789abcdef",
        "scene": {
            "name": scene,
            "source": "stand-in" if scene == "hairball" else "real",
            "triangles": triangles,
            "sha256": "ab" * 32,
        },
    }


def as_row(kind: type[Row], made: dict) -> Row:
    """A made-up JSON object as a row of its class, which says what is wrong with it."""
    return checked(kind, made, "a made-up row")


def as_results(made: dict) -> StressResults:
    """A made-up stability.json as the suite's results."""
    return checked(StressResults, made, "a made-up stability.json")


def times(rate: float, rays: int, seed: int) -> dict:
    noise = np.random.default_rng(seed).lognormal(0, 0.01, 5)
    seconds = [float(rays / (rate * 1e6) * factor) for factor in noise]
    return {"seconds": seconds, "rate": interval(rates_of(seconds, rays)).as_dict()}


def accuracy_row(
    scene: str, variant: str, triangles: int = 279_163, aimed: int = 100_000, rays: int = 64_000, **changed
) -> dict:
    """A row with a variant's made-up numbers, `changed` over them: rate, leaks, t_error."""
    tracer, *rest = variant.split(":")
    options = dict(part.split("=") for part in rest if "=" in part)
    rate, leaks, error = VARIANTS.get(variant, (0.3, 0, 2e-7))
    rate, leaks, error = (changed.get(k, v) for k, v in (("rate", rate), ("leaks", leaks), ("t_error", error)))
    agreement = {
        "reference": "embree",
        "rays": rays,
        "same": rays - 5,
        "tie": 5,
        "t_off": 0,
        "wrong": 0,
        "missed": 0,
        "phantom": 0,
        "reference_wrong": 0,
        "settled": 0,
        "nonfinite": 0,
        "worst_band_ulp": 0.0,
        "t_relative_error": {"p50": error / 9, "p99": error, "max": error * 9},
        "valid": True,
        "reason": "",
    }
    embree = tracer == "embree"
    return (
        common(scene, variant, triangles)
        | times(rate, rays, len(variant))
        | {
            "variant": variant,
            "tracer": tracer,
            "intersector": None if embree else rest[0],
            "contraction": None if embree else options.get("contraction", "off"),
            "options": options,
            "grid": None if embree else {"top": 8, "leaf": 128, "reading": "total"},
            "binning": None if embree else "padded",
            "rays": {"kind": "diffuse", "count": rays, "seed": 1},
            "repetitions": 5,
            "residual_p99_ulp": 2.5,
            "distance_rmse": 1e-7,
            "agreement": agreement,
            "valid": True,
            "aimed": {
                "rays": aimed,
                "leaks": leaks,
                "at_vertices": aimed // 2,
                "vertex_leaks": leaks // 2,
                "seed": 1,
            },
            "t_error": {"p50": error / 9, "p99": error, "max": error * 9},
        }
    )


def precision_row(scene: str, knob: str, value: str, rate: float, error: float, triangles: int = 279_163, **more):
    """A row of precision.jsonl."""
    return (
        common(scene, f"{knob} {value}", triangles)
        | times(rate, 64_000, 3)
        | {
            "knob": knob,
            "value": value,
            "variant": "deferred:ray-space",
            "rays": 64_000,
            "error": error,
            "image_error": None,
            "differing": None,
            **more,
        }
    )


def precision_rows(scene: str, triangles: int = 279_163) -> list[dict]:
    found = [precision_row(scene, "grid", f"8/{leaf}", 0.3 * 64 / leaf, 2e-8, triangles) for leaf in (32, 64, 128)]
    found += [
        precision_row(scene, "precision", "half", 0.31, 2e-3, triangles, image_error=0.03, differing=99),
        precision_row(scene, "precision", "float", 0.30, 2e-8, triangles, image_error=0.0, differing=0),
        precision_row(scene, "precision", "double", 0.28, 1e-8, triangles, image_error=0.0, differing=0),
    ]
    return found + [
        precision_row(scene, "samples", str(samples), 0.3, 0.4 / samples**0.5, triangles)
        for samples in (1, 4, 16, 64)
    ]


def stability(families=("W1", "W2", "A1", "A2", "A3", "D1")) -> dict:
    """A stability.json of three intersectors, of which Möller and Trumbore's fails."""
    rows, rates = [], []
    for place, name in enumerate(("ray-space", "moller-trumbore", "woop-benthin-wald-kahan")):
        bad = name == "moller-trumbore"
        for mode in ("off", "on"):
            for family in families:
                measures = family[0] == "A"
                rows.append(
                    {
                        "intersector": name,
                        "contraction": mode,
                        "family": family,
                        "size": "smoke",
                        "rays": 20_000,
                        "leaks": None if measures else 900 * bad,
                        "double_hits": 3 if family == "W2" else None,
                        "band_ulp": (1e3 if bad else 3.0) if measures else None,
                        "residual_p99_ulp": (1e5 if bad else 4.0 - place) if measures else None,
                        "gross": 0 if measures else None,
                        "nonfinite": 0,
                        "self_hits": None,
                        "tunnels": None,
                        "passed": not bad,
                    }
                )
            median = (150 - 10 * place) * 1e6
            rates.append(
                {
                    "intersector": name,
                    "contraction": mode,
                    "wrong": 0,
                    "tests_per_second": {"median": median, "low": 0.98 * median, "high": 1.02 * median},
                }
            )
    return {
        "schema": SCHEMA,
        "machine": MACHINE,
        "contracts": {"off": False, "on": True},
        "rows": rows,
        "kernel_rates": rates,
    }


def write_accuracy(folder: Path, scenes=("sponza", "hairball")) -> None:
    """accuracy.jsonl, precision.jsonl and stability.json, as `defray accuracy` and `defray stability` leave them."""
    for scene in scenes:
        for variant in VARIANTS:
            accuracy_file(folder).append(as_row(AccuracyRow, accuracy_row(scene, variant)))
        for row in precision_rows(scene):
            precision_file(folder).append(as_row(PrecisionRow, row))
    (folder / "stability.json").write_text(json.dumps(sealed(stability())), encoding="utf-8")
