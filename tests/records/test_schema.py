"""What rows share: agreement in words, machines told apart, values of the declared type alone."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from harness.data import Counters
from harness.records.accuracy_row import GridPlace
from harness.records.agreement import Agreement, why_failed
from harness.records.schema import GridFacts, Machine, MachineKey, RayFacts

MACHINE = {"cpu": "AMD EPYC", "cores": 2, "os": "an OS", "driver": "1", "versions": {}}


@pytest.mark.parametrize(
    ("found", "text"),
    [
        ({"reference": "embree", "missed": 3000, "reason": ""}, "3,000 missed (against embree)"),
        ({"reference": "exact", "wrong": 1, "t_off": 2, "reason": ""}, "1 wrong, 2 t-off (against exact)"),
        ({"reference": "embree", "wrong": 1, "reason": "a grid lost rays"}, "a grid lost rays (against embree)"),
        ({"reference": "embree", "reason": ""}, "hits differ (against embree)"),
        ({"reference": "none"}, "not checked against any reference"),
    ],
)
def test_why_a_check_failed_is_one_phrase(found, text):
    assert why_failed(Agreement(rays=64_000, **found)) == text


def test_machines_are_told_apart_by_what_they_are():
    here = Machine(**MACHINE, device="pthread-EPYC", platform="PoCL").key
    assert here == MachineKey.read({**MACHINE, "device": "pthread-EPYC", "platform": "PoCL"})
    assert here.title == "pthread-EPYC, AMD EPYC, 2 cores, PoCL"
    assert here.file_name.startswith("pthread-epyc-") and len(here.file_name) == len("pthread-epyc-") + 4
    hostless = Machine(**MACHINE, device=None, platform=None).key
    assert here.holds(here) and here.holds(hostless) and not hostless.holds(here)
    assert hostless.title == "no OpenCL device, AMD EPYC, 2 cores"


@pytest.mark.parametrize("value", ["3", 3.5, True, None])
def test_a_value_of_another_type_is_refused_and_never_converted(value):
    for make in (lambda: RayFacts(kind="diffuse", count=value, seed=1), lambda: Counters(tests=value)):
        with pytest.raises(ValidationError, match="valid integer"):
            make()


SIZE = {"cells": 1, "nonempty": 1, "references": 9, "bytes": 40, "build_seconds": 0.1}


def test_a_structure_that_is_no_grid_has_options_and_no_resolution():
    facts = GridFacts(reading="all-triangles", options={"width": "4"}, **SIZE)
    assert facts.as_json() == {"reading": "all-triangles", "options": {"width": "4"}} | SIZE
    place = {"reading": "all-triangles", "options": {}, "density": None}
    assert GridPlace(**place).as_json() == place


@pytest.mark.parametrize("reading", ["total", "per-cell", "adaptive"])
def test_a_grid_without_a_resolution_is_refused(reading):
    for kind, size in ((GridFacts, SIZE), (GridPlace, {})):
        with pytest.raises(ValidationError, match="missing key leaf"):
            kind(top=8, reading=reading, **size)
