"""Every registered structure gives brute force's bits with every tracer that walks one, whatever the arrangement."""

from __future__ import annotations

import pytest
from shapes import icosphere, lattice_walls, random_rays, soup

from harness import structures, tracers
from harness.data import Scene, differing
from harness.spec.structure import parse_structure
from harness.tracers.prepared import Prepared

MESHES = {"soup": soup(300), "walls": lattice_walls(3), "sphere": icosphere(2)}
RAYS = random_rays(700)
WALKING = [name for name in tracers.names() if tracers.find(name).needs_structure]
VARIANTS = [*WALKING, *(f"deferred:arrange={arrange}:wave=2" for arrange in ("record", "sort")), "deferred:lanes=1"]


@pytest.fixture(scope="module")
def expected(device):
    """Brute force's hits of every mesh."""
    prepared = {name: Prepared.on_device(Scene(name, mesh), device) for name, mesh in MESHES.items()}
    return {name: (one, tracers.open_tracer(one, "brute").timed(RAYS)[0]) for name, one in prepared.items()}


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("structure", structures.names())
def test_every_structure_gives_brute_forces_bits_with_every_tracer(expected, structure, mesh):
    prepared, brute = expected[mesh]
    prepared = prepared.with_structure(parse_structure(structure))
    assert (brute.primitive >= 0).any()
    for variant in VARIANTS:
        hits, _ = tracers.open_tracer(prepared, variant).timed(RAYS)
        assert differing(hits, brute) == 0, variant


@pytest.mark.parametrize("structure", structures.names())
def test_every_structure_lists_each_triangle_that_has_an_area(expected, structure):
    prepared, _ = expected["soup"]
    made = structures.build(prepared.device_scene, parse_structure(structure))
    start, references = made.cell_start.get(), made.references.get()[: made.cell_start.get()[-1]]
    assert len(start) == made.nonempty + 1 and (start[1:] > start[:-1]).all()
    assert set(references) == set(prepared.device_scene.active.get())
    assert made.bytes >= made.references.nbytes and made.most_cells_met >= 1
    assert made.describe()["references"] == len(references)
