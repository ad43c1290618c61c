"""The adaptive grid: how it is asked for, refused and recorded."""

from __future__ import annotations

import dataclasses

import pytest
from adaptive_grids import SPECS
from shapes import soup

from harness import structures
from harness.errors import DefrayError
from harness.records.schema import GridFacts
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import Adaptive, Uniform, parse_structure
from harness.structures.device_scene import upload_scene


def test_the_text_of_a_grid_is_read_back():
    for text in ("adaptive", "adaptive density=0.25", "adaptive top=40 leaf=8 density=2"):
        assert str(parse_structure(text)) == text
    assert parse_structure("adaptive") == Adaptive()
    assert parse_structure("8/128") == Uniform() and str(Uniform()) == "8/128 total"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("adaptive leaf=12", "leaf of an adaptive grid must be one of 1, 2, 4, .*, not 12"),
        ("adaptive density=0", "density must be above 0"),
        ("adaptive density=nan", "density must be above 0"),
        ("adaptive depth=3", "'depth=3' in 'adaptive depth=3' is not of the form"),
        ("adaptive top=9999", "at most|0 .automatic. to"),
    ],
)
def test_a_bad_adaptive_grid_is_refused(text, message):
    with pytest.raises(DefrayError, match=message):
        parse_structure(text)


def test_a_density_is_for_adaptive_grids_alone():
    with pytest.raises(DefrayError, match="'8/128 density=2' is not a structure"):
        parse_structure("8/128 density=2")


def test_ids_and_texts_of_runs_on_other_grids_are_as_before_there_were_adaptive_ones():
    run = RunSpec(scene="sponza", variant=Variant.parse("deferred:ray-space:wave=4"), structure=Uniform())
    assert run.id == "c77aa873bb021d83"
    assert run.model_dump()["grid"] == {"top": 8, "leaf": 128, "reading": "total"}
    dense, default = (
        RunSpec(scene="sponza", variant=Variant.parse("deferred"), structure=Adaptive(density))
        for density in (0.3, None)
    )
    assert dense.id != default.id and dense.model_dump()["grid"]["density"] == 0.3
    assert RunSpec.model_validate(dense.model_dump()) == dense


def test_only_records_of_adaptive_grids_have_a_density(device):
    scene = upload_scene(device, soup(500))
    uniform, adaptive = (structures.build(scene, spec).describe() for spec in (Uniform(2, 8), SPECS[0]))
    assert GridFacts.model_validate(uniform).model_dump() == uniform
    assert GridFacts.model_validate(adaptive).model_dump() == adaptive
    assert set(adaptive) - set(uniform) == {"density", "resolution"}
    assert adaptive["density"] == 0.3 and len(adaptive["resolution"]) == 3


def test_a_grid_beyond_the_memory_is_refused_with_its_size(device):
    small = dataclasses.replace(device, memory_bytes=1 << 16)
    scene = dataclasses.replace(upload_scene(device, soup(5000)), device=small)
    with pytest.raises(DefrayError, match=r"needs [0-9.]+ GiB; the limit here .* a lower density"):
        structures.build(scene, Adaptive(900.0, leaf=128))
