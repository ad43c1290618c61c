"""Coherence counters equal a machine in lockstep played lane by lane in Python, and the tracers' own counters."""

from __future__ import annotations

import json

import numpy as np
import pytest
from made_up_accuracy import DEVICE, as_row
from made_up_roofline import coherence_row, roofline_row
from shapes import icosphere, random_rays, soup
from traced import setting_of
from typer.testing import CliRunner

from harness import tracers
from harness.analysis.results import Results, read_published
from harness.commands.main import app
from harness.errors import DefrayError
from harness.records.coherence_row import Coherence, CoherenceRow, coherence_file, predicted_ratios
from harness.records.roofline_row import RooflineRow, roofline_file
from harness.records.schema import checked
from harness.report.tables import coherence_table as table
from harness.spec.intersectors import INTERSECTORS
from harness.spec.structure import Adaptive, Uniform
from harness.studies.lanes_and_lines import (
    Lists,
    Sequences,
    compare_counts,
    deferred_coherence,
    forward_coherence,
    lists_of,
    record_sequences,
)

TEST = INTERSECTORS["ray-space"]
SPECS = [Uniform(2, 8), Adaptive(1.0)]


def steps_of(sequences: Sequences) -> list[list[tuple[int, int]]]:
    """(wave, cell) of each step, ray by ray."""
    bounds = zip(sequences.first[:-1], sequences.first[1:], strict=True)
    return [list(zip(sequences.wave[a:b].tolist(), sequences.cell[a:b].tolist(), strict=True)) for a, b in bounds]


def counts_of(*values) -> Coherence:
    """Counts in the order of their declaration."""
    return Coherence(**dict(zip(Coherence.model_fields, values, strict=True)))


class Machine:
    """Runs `lanes` lanes trip by trip and counts with sets."""

    def __init__(self, model: str, lanes: int, lists: Lists):
        self.found, self.lists = counts_of(model, lanes, *[0] * 10), lists

    def step(self, left: list[int]) -> None:
        """One loop over the steps that each lane has left."""
        while any(left):
            going = sum(count > 0 for count in left)
            self.found.steps += going
            self.found.step_trips += 1
            self.found.uneven_step_trips += going < self.found.lanes
            left = [max(count - 1, 0) for count in left]

    def test(self, cells: list[int | None]) -> None:
        """One loop over the triangles of each lane's cell."""
        lists = [self.triangles(cell) for cell in cells]
        for k in range(max(map(len, lists), default=0)):
            loaded = [triangles[k] for triangles in lists if k < len(triangles)]
            self.trip(len(loaded), loaded)

    def triangles(self, cell: int | None) -> list[int]:
        start = self.lists.start
        return [] if cell is None else self.lists.references[start[cell] : start[cell + 1]].tolist()

    def trip(self, going: int, loaded: list[int]) -> None:
        found, size = self.found, self.lists.triangle_bytes
        found.tests += going
        found.line_tests += going
        found.test_trips += 1
        found.line_trips += 1
        found.uneven_test_trips += going < found.lanes
        for line in (64, 128):
            lines = {(size * p + byte) // line for p in loaded for byte in range(size)}
            setattr(found, f"lines_{line}", getattr(found, f"lines_{line}") + len(lines))


def naive_forward(sequences: Sequences, lists: Lists, lanes: int) -> Coherence:
    machine, rays = Machine("forward", lanes, lists), steps_of(sequences)
    for first in range(0, len(rays), lanes):
        group = rays[first : first + lanes]
        for round_ in range(1 + max((wave for ray in group for wave, _ in ray), default=-1)):
            now = [[cell for wave, cell in ray if wave == round_] for ray in group]
            machine.step([len(cells) for cells in now])
            machine.test([next((cell for cell in cells if cell >= 0), None) for cells in now])
    return machine.found


def naive_deferred(sequences: Sequences, lists: Lists, lanes: int, packed: bool) -> Coherence:
    machine = Machine("deferred-packed" if packed else "deferred", lanes, lists)
    rays = steps_of(sequences)
    for number in range(1 + max(wave for ray in rays for wave, _ in ray)):
        walks = [cells for cells in ([c for w, c in ray if w == number] for ray in rays) if cells]
        for first in range(0, len(walks), lanes):
            machine.step([len(cells) for cells in walks[first : first + lanes]])
        bins = sorted(cell for cells in walks for cell in cells if cell >= 0)
        groups = [bins] if packed else [[c for c in bins if c == cell] for cell in sorted(set(bins))]
        for pairs in groups:
            for first in range(0, len(pairs), lanes):
                machine.test(pairs[first : first + lanes])
    return machine.found


@pytest.mark.parametrize("lanes", [4, 32])
@pytest.mark.parametrize("spec", SPECS, ids=str)
def test_counts_equal_lanes_played_one_by_one(device, spec, lanes):
    prepared, rays = setting_of(device, soup(150), spec), random_rays(203, low=-0.3, high=1.3)
    lists = lists_of(prepared.structure, TEST.bytes)
    forward, deferred = (record_sequences(prepared, TEST, rays, wave) for wave in (1, 3))
    assert forward_coherence(forward, lists, lanes) == naive_forward(forward, lists, lanes)
    chunks, packed = deferred_coherence(deferred, lists, lanes)
    assert chunks == naive_deferred(deferred, lists, lanes, packed=False)
    assert packed == naive_deferred(deferred, lists, lanes, packed=True)


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("spec", SPECS, ids=str)
def test_sequences_make_the_counts_of_the_tracers(device, spec, lanes):
    prepared, rays = setting_of(device, icosphere(), spec), random_rays(2000, low=-0.5, high=0.5)
    lists = lists_of(prepared.structure, TEST.bytes)
    for name, wave, options in (("forward", 1, {}), ("deferred", 2, {"wave": "2", "lanes": str(lanes)})):
        counters = tracers.find(name)(prepared, TEST, options).count(rays)
        sequences = record_sequences(prepared, TEST, rays, wave)
        compare_counts(sequences, lists, counters, name)
    # Chunks are those of the deferred tracer, idle lanes included, but that it tests few rays a triangle a lane.
    trips = deferred_coherence(sequences, lists, lanes)[0].test_trips
    assert counters.tests <= counters.lane_tests <= lanes * trips
    assert lanes > 1 or counters.lane_tests == trips
    with pytest.raises(DefrayError, match="tests, but the tracer counts"):
        compare_counts(sequences, lists, counters.model_copy(update={"tests": counters.tests + 1}), "deferred")


def test_rays_of_one_cell_keep_all_lanes_at_work():
    """Sixteen rays, one step each into a cell of three triangles, 36 bytes from byte 0, 36 and 72 on."""
    sequences = Sequences(np.arange(17), np.zeros(16, np.int32), np.zeros(16, np.int32))
    lists = Lists(np.array([0, 3]), np.array([0, 1, 2], np.int32), 36)
    for found in (forward_coherence(sequences, lists, 8), *deferred_coherence(sequences, lists, 8)):
        assert (found.test_trips, found.tests, found.uneven_test_trips) == (6, 48, 0)
        assert (found.test_efficiency, found.walk_efficiency) == (1.0, 1.0)
        assert (found.lines_64, found.lines_128) == (2 * (1 + 2 + 1), 6)


def test_only_every_nth_group_is_asked_for_lines_where_there_are_too_many(monkeypatch):
    monkeypatch.setattr("harness.studies.lanes_and_lines.MOST_LOADS", 24)
    sequences = Sequences(np.arange(17), np.zeros(16, np.int32), np.zeros(16, np.int32))
    found = forward_coherence(sequences, Lists(np.array([0, 3]), np.array([0, 1, 2], np.int32), 36), 8)
    assert (found.test_trips, found.line_trips, found.lines_64) == (6, 3, 4)


def test_rays_without_steps_make_empty_counts():
    empty = Sequences(np.zeros(9, np.int64), np.empty(0, np.int32), np.empty(0, np.int32))
    lists = Lists(np.array([0, 3]), np.array([0, 1, 2], np.int32), 36)
    for found in (forward_coherence(empty, lists, 8), *deferred_coherence(empty, lists, 8)):
        assert found.test_trips == found.steps == found.lines_64 == 0
        assert found.test_efficiency == found.uneven_share == found.lines_a_trip(64) == 0.0


def test_predictions_are_quotients_of_trips_and_lines():
    forward = counts_of("forward", 32, 0, 0, 0, 900, 300, 300, 300, 900, 1200, 900)
    deferred = counts_of("deferred", 32, 0, 0, 0, 1000, 100, 50, 100, 1000, 150, 125)
    assert predicted_ratios([forward, deferred], 32) == {"deferred": {"trips": 3.0, "lines": 8.0}}
    assert predicted_ratios([forward, deferred], 8) == {}


def test_a_stored_row_reads_back_and_a_wrong_one_is_refused(tmp_path):
    mesh = icosphere()
    np.savez(tmp_path / "ball.npz", vertices=mesh.reshape(-1, 3), faces=np.arange(3 * len(mesh)).reshape(-1, 3))
    arguments = ["coherence", str(tmp_path / "ball.npz"), "--kind", "random", "--rays", "500", "--structure", "2/8"]
    done = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path)], catch_exceptions=False)
    assert done.exit_code == 0 and "forward over deferred-packed" in done.stdout
    (row,) = coherence_file(tmp_path).read()
    assert len(row.counts) == 6
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.studies.lanes_and_lines.measure_coherence", None)
        again = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path), "--resume", "--json"])
    assert again.exit_code == 0 and json.loads(again.stdout) == [row.as_json()], "and is not measured again"
    runs = Results([], tmp_path, "any device", read_published())
    numbers = table.select(runs)
    assert list(numbers["lanes"]) == [8] * 3 + [32] * 3 and numbers["forward_trips_over_these"].notna().sum() == 4
    assert "measured" not in table.caption(runs, numbers)
    damaged = row.as_json()
    damaged["counts"][0]["tests"] = 8 * damaged["counts"][0]["test_trips"] + 1
    with pytest.raises(DefrayError, match="a trip works on one lane at least and on all at most"):
        checked(CoherenceRow, damaged, "here")


def test_the_prediction_stands_beside_what_was_measured(tmp_path):
    """Scalar work-optimal over deferred intersection, of the same scene, grid and intersector."""
    for tracer, name, seconds in (
        ("deferred", "intersect_bins", [1.0, 1.0, 1.0]),
        ("work-optimal", "intersect_visited", [5.0, 6.0, 7.0]),
    ):
        row = roofline_row("sponza", tracer)
        (kernel,) = (one for one in row["kernels"] if one["name"] == name)
        roofline_file(tmp_path).append(as_row(RooflineRow, row | {"kernels": [kernel | {"seconds": seconds}]}))
    row = coherence_row("sponza")
    coherence_file(tmp_path).append(as_row(CoherenceRow, row))
    tests, trips = (row["counts"][place][key] for place, key in ((0, "tests"), (1, "test_trips")))
    runs = Results([], tmp_path, DEVICE, read_published())
    said = f"Sponza, 8/128 total: {tests / trips:.1f} predicted, 6 [5, 7] measured"
    assert table.measured_ratios(runs) == [said]
    other = roofline_row("sponza", "work-optimal")
    other["rays"] = other["rays"] | {"count": other["rays"]["count"] + 1}
    roofline_file(tmp_path).append(as_row(RooflineRow, other))  # in place of the one on the same rays
    assert table.measured_ratios(Results([], tmp_path, DEVICE, read_published())) == []
