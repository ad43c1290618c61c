"""From a mesh file to checked records, and runs that repeat bit for bit."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from shapes import icosphere, random_rays, soup

import harness
from harness import structures
from harness.data import Scene, differing
from harness.device.machine import machine_description
from harness.device.stopwatch import Stopwatch
from harness.errors import DefrayError
from harness.measure.pipeline import run_group
from harness.measure.scene import Scenes
from harness.records.origin import finish
from harness.records.run_row import Record
from harness.records.schema import checked
from harness.reference.check import Checker
from harness.reference.embree_scene import EmbreeScene
from harness.spec.intersectors import INTERSECTORS
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import Uniform
from harness.studies import pictures as render
from harness.tracers import find
from harness.tracers.prepared import Prepared

VARIANTS = ("deferred:ray-space", "forward:ray-space", "work-optimal:ray-space", "brute:ray-space", "embree")


@pytest.fixture
def mesh_file(tmp_path):
    file = tmp_path / "ball.ply"
    ball = icosphere(3)
    trimesh.Trimesh(ball.reshape(-1, 3), np.arange(3 * len(ball)).reshape(-1, 3), process=False).export(file)
    return str(file)


def specs(mesh_file, variants=VARIANTS, **fields) -> list[RunSpec]:
    common = {"scene": mesh_file, "grid": Uniform(4, 16), "rays": 2000, "view": "inside", "repetitions": 2}
    return [RunSpec(variant=Variant.parse(text), **{**common, **fields}) for text in variants]


def test_a_group_of_variants_gives_complete_valid_records(device, mesh_file):
    stages = []
    wanted = specs(mesh_file)
    results = list(run_group(wanted, Scenes(device), lambda step: stages.append(step.done)))
    assert [spec.id for spec, _ in results] == [spec.id for spec in wanted]
    for spec, body in results:
        record = finish(Record, body, machine_description(device), id=spec.id)
        assert record.valid and record.agreement.rays == 2000
        assert len(record.samples.total) == 2
        assert record.rate.total.median > 0
        assert checked(Record, json.loads(json.dumps(record.as_json())), "test") == record
    assert len({body.hits_sha256 for spec, body in results if spec.variant.tracer != "embree"}) == 1
    assert stages == sorted(stages) and stages[0] == 0 and stages[-1] <= 1
    assert results[0][1].grid.references > 0 and results[4][1].grid is None


def test_embrees_hierarchy_is_built_once_a_scene(device, mesh_file, monkeypatch):
    scenes = Scenes(device)
    scenes.load(mesh_file)  # loading a mesh looks around in it with a hierarchy of its own
    built = []
    original = EmbreeScene.__init__
    monkeypatch.setattr(
        EmbreeScene, "__init__", lambda self, *rest, **named: (built.append(1), original(self, *rest, **named))[1]
    )
    for rays in (2000, 1000):
        for grid in (Uniform(4, 16), Uniform(4, 8)):
            list(run_group(specs(mesh_file, ("deferred:ray-space", "embree"), rays=rays, grid=grid), scenes))
    assert len(built) == 1


def test_stages_are_timed_where_a_tracer_has_them(device, mesh_file):
    results = {spec.variant.tracer: body for spec, body in run_group(specs(mesh_file), Scenes(device))}
    has = {name: [s for s, values in body.samples.model_dump().items() if values] for name, body in results.items()}
    assert has["deferred"] == ["traverse", "arrange", "intersect", "compact", "total"]
    assert has["forward"] == ["total"]
    assert has["work-optimal"] == ["intersect", "total"]
    for body in results.values():
        for stage, values in body.samples.model_dump().items():
            assert stage == "total" or all(v <= t for v, t in zip(values, body.samples.total, strict=False))


def test_hits_that_change_between_repetitions_are_caught(device, mesh_file, monkeypatch):
    kind = find("forward")
    honest, calls = kind.trace, []

    def flicker(self, rays, watch):
        hits = honest(self, rays, watch)
        calls.append(1)
        if len(calls) == 3:
            hits.t[7] = np.nextafter(hits.t[7], np.float32(0))
        return hits

    monkeypatch.setattr(kind, "trace", flicker)
    ((_, body),) = run_group(specs(mesh_file, ["forward:ray-space"], repetitions=3), Scenes(device))
    assert not body.valid and body.rate.total is None
    assert "changed their hit" in body.agreement.reason


def test_tracers_that_disagree_by_one_bit_are_caught(device, mesh_file, monkeypatch):
    kind = find("deferred")
    honest = kind.trace

    def nudged(self, rays, watch):
        hits = honest(self, rays, watch)
        hits.t[11] = np.nextafter(hits.t[11], np.float32(0))
        return hits

    monkeypatch.setattr(kind, "trace", nudged)
    results = {spec.variant.tracer: body for spec, body in run_group(specs(mesh_file), Scenes(device))}
    assert not results["deferred"].valid
    assert "1 rays differ from" in results["deferred"].agreement.reason
    assert results["forward"].valid and results["brute"].valid


@pytest.mark.parametrize("option", ["contraction=on", "exit=reject"])
def test_tracers_that_promise_no_equal_bits_are_not_held_against_each_other(device, mesh_file, monkeypatch, option):
    kind, (name, value) = find("forward"), option.split("=")
    honest = kind.trace

    def nudged(self, rays, watch):
        hits = honest(self, rays, watch)
        if getattr(self.options, name) == value:
            hits.t[11] = np.nextafter(hits.t[11], np.float32(0))
        return hits

    monkeypatch.setattr(kind, "trace", nudged)
    variants = ("deferred:ray-space", "work-optimal:ray-space", f"forward:ray-space:{option}")
    for _, body in run_group(specs(mesh_file, variants), Scenes(device)):
        assert body.valid, body.agreement.reason


def test_the_run_that_cannot_be_opened_is_named(device, mesh_file):
    good, bad = specs(mesh_file, ["deferred:ray-space", "forward:ray-space:exit=left"])
    steps = []
    with pytest.raises(DefrayError, match="option exit=left of forward"):
        list(run_group([good, bad], Scenes(device), steps.append))
    assert steps[-1].spec == bad, "a sweep goes on without this run alone"


def test_a_grid_with_one_reference_removed_is_caught(device):
    triangles, rays = soup(300), random_rays(20_000)
    prepared = Prepared.on_device(Scene("soup", triangles), device)
    grid = structures.build(prepared.device_scene, Uniform(2, 8))
    trace = find("deferred")

    def agreement():
        tracer = trace(prepared.with_structure(grid), INTERSECTORS["ray-space"], {})
        return Checker(triangles, rays).check(tracer.trace(rays, Stopwatch(device.queue)))

    assert agreement().valid
    honest = grid.references.get()
    hits = trace(prepared.with_structure(grid), INTERSECTORS["ray-space"], {}).trace(rays, Stopwatch(device.queue))
    most_hit = np.bincount(hits.primitive[hits.primitive >= 0]).argmax()
    caught = 0
    for place in np.flatnonzero(honest == most_hit):
        references = honest.copy()
        references[place] = honest[place - 1]  # the triangle is gone from one of its cells
        grid.references.set(references)
        found = agreement()
        caught += not found.valid and found.wrong + found.missed > 0
    assert caught


PROGRAM = """
import hashlib, sys
sys.path.insert(0, "tests/fakes")
from shapes import soup, random_rays
from harness.data import Scene
from harness.engine import trace
from harness.spec.structure import Uniform
scene, rays = Scene("soup", soup(2000, size=0.1)), random_rays(30000)
for intersector in ("ray-space", "moller-trumbore"):
    for wave, batch in (("4", "8192"), ("4", "30000"), ("all", "8192"), ("all", "30000")):
        hits = trace(scene, rays, "deferred", intersector, Uniform(4, 32), wave=wave, batch=batch)
        print(intersector, hashlib.sha256(hits.tobytes()).hexdigest())
"""


def test_threads_waves_and_batches_change_no_byte():
    """Separate processes, because a runtime reads its number of threads once."""
    seen = set()
    for threads in ("1", "2"):
        environment = {**os.environ, "DEFRAY_THREADS": threads}
        command = [sys.executable, "-c", PROGRAM]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        lines = done.stdout.splitlines()
        assert len(lines) == 8
        seen.update(lines)
    assert len(seen) == 2, "one digest an intersector"


def test_the_picture_of_a_mesh_file_is_of_that_file(device, mesh_file, tmp_path, monkeypatch):
    drawn = {}
    monkeypatch.setattr(render, "_write", lambda file, setting_of: [drawn.setdefault(file.name, setting_of().scene)])
    render.write_views(tmp_path / "views", {"ball": mesh_file, "ball@1/4": f"{mesh_file}@1/4"}, device)
    assert [(name, len(scene)) for name, scene in drawn.items()] == [("ball.png", len(icosphere(3)))]


def test_the_python_interface_traces_a_scene(device, mesh_file):
    scene = harness.load_scene(mesh_file)
    rays = random_rays(500, low=-0.3, high=0.3)
    deferred = harness.trace(scene, rays, device=device)
    reference = harness.trace(scene, rays, tracer="brute", intersector="ray-space", device=device)
    outside = harness.trace(scene, rays, tracer="embree")
    assert (deferred.primitive >= 0).all()
    assert differing(deferred, reference) == 0
    assert deferred.t == pytest.approx(outside.t, rel=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tracer": "backward"}, "unknown tracer"),
        ({"intersector": "best"}, "unknown intersector"),
        ({"structure": "3/10"}, "not a multiple of top 3"),
        ({"wave": 0}, "option wave=0"),
    ],
)
def test_the_python_interface_names_what_is_wrong(device, arguments, message):
    with pytest.raises(DefrayError, match=message):
        harness.trace(Scene("soup", soup(20)), random_rays(10), device=device, **arguments)
