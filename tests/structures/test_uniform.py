"""The grid built on the device, checked on the host against its definition."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import icosphere, lattice_walls, sampled_cells, soup

from harness import structures
from harness.errors import DefrayError
from harness.spec.structure import Uniform, parse_structure
from harness.structures.device_scene import upload_scene
from harness.structures.uniform import BRICK, grid_box

SPECS = [Uniform(1, 1), Uniform(2, 6), Uniform(4, 20), Uniform(8, 32), Uniform(3, 5, per_cell=True)]


def cells_of(grid) -> dict[tuple[int, int, int], set[int]]:
    """The grid read back: triangles of every non-empty leaf cell by its position."""
    spec, size = grid.spec, grid.spec.leaf_per_top
    top_block, bricks = grid.top_block.get(), grid.leaves.get().reshape(-1, 2)
    start, references = grid.cell_start.get(), grid.references.get()
    across, deep = -(-size // BRICK[0]), -(-size // BRICK[2])
    found = {}
    for top, block in enumerate(top_block):
        if block < 0:
            continue
        base = np.array([top % spec.top, top // spec.top % spec.top, top // spec.top**2]) * size
        for brick in range(across * across * deep):
            bits, before = (int(v) for v in bricks[block * across * across * deep + brick])
            corner = np.array([brick % across * 4, brick // across % across * 4, brick // across**2 * 2])
            for bit in range(32):
                if bits >> bit & 1:
                    position = base + corner + [bit & 3, bit >> 2 & 3, bit >> 4]
                    cell = before + (bits & ((1 << bit) - 1)).bit_count()
                    listed = references[start[cell] : start[cell + 1]]
                    assert (np.diff(listed) > 0).all(), "references of a cell ascend without repeats"
                    found[tuple(int(v) for v in position)] = set(listed.tolist())
    return found


@pytest.mark.parametrize("spec", SPECS, ids=str)
@pytest.mark.parametrize("mesh", [soup(200), icosphere(2), lattice_walls(4)], ids=["soup", "sphere", "walls"])
def test_every_point_of_every_triangle_lies_in_a_cell_that_references_it(device, mesh, spec):
    grid = structures.build(upload_scene(device, mesh), spec)
    cells = cells_of(grid)
    missing = [entry for entry in sampled_cells(mesh, grid) if entry[3] not in cells.get(entry[:3], ())]
    assert not missing


def test_walls_on_cell_planes_are_referenced_on_both_sides(device):
    wall = np.array([[[1, 0, 0], [1, 1, 0], [1, 1, 1]], [[0, 0, 0], [2, 0, 0], [2, 2, 2]]], np.float32)
    scene = upload_scene(device, wall)
    lower, size = grid_box(scene, Uniform(1, 2))
    wall[0, :, 0] = lower[0] + size[0]
    cells = cells_of(structures.build(upload_scene(device, wall), Uniform(1, 2)))
    assert {position[0] for position, listed in cells.items() if 0 in listed} == {0, 1}


def test_a_small_triangle_is_referenced_only_near_itself(device):
    mesh = np.concatenate([icosphere(1, 10.0), soup(1, size=0.01)])
    grid = structures.build(upload_scene(device, mesh), Uniform(8, 64))
    holders = [position for position, listed in cells_of(grid).items() if len(mesh) - 1 in listed]
    assert 1 <= len(holders) <= 8


def test_the_same_scene_gives_the_same_bytes(device):
    scene = upload_scene(device, soup(2000))
    first, second = (structures.build(scene, Uniform(4, 32)) for _ in range(2))
    for name in ("top_block", "leaves", "cell_start", "references"):
        assert getattr(first, name).get().tobytes() == getattr(second, name).get().tobytes()


def test_zero_area_triangles_keep_their_number_but_are_not_referenced(device):
    mesh = soup(10)
    mesh[4, 2] = mesh[4, 1]
    mesh[7] = [[0, 0, 0], [0.5, 0.5, 0.5], [1, 1, 1]]
    cells = cells_of(structures.build(upload_scene(device, mesh), Uniform(2, 8)))
    assert set().union(*cells.values()) == set(range(10)) - {4, 7}


def test_readings_differ_in_resolution():
    assert Uniform(8, 128).resolution == 128
    assert Uniform(8, 128, per_cell=True).resolution == 1024


def test_empty_top_cells_hold_no_block(device):
    mesh = np.concatenate([soup(50, size=0.01) * 0.1, soup(50, size=0.01) * 0.1 + 10]).astype(np.float32)
    grid = structures.build(upload_scene(device, mesh), Uniform(8, 16, per_cell=True))
    assert grid.blocks < 20
    assert grid.describe()["cells"] == grid.blocks * 16**3


@pytest.mark.parametrize("offset", [0, 1e3, 1e6])
def test_flat_and_distant_scenes_build(device, offset):
    mesh = soup(50) + np.float32(offset)
    mesh[:, :, 1] = offset
    grid = structures.build(upload_scene(device, mesh.astype(np.float32)), Uniform(2, 8))
    assert grid.nonempty > 0
    assert np.isfinite(grid.cell_size).all() and (grid.cell_size > 0).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("8/100", "leaf 100 is not a multiple of top 8, as '8/100' needs; 96 or 104 would do"),
        ("0/8", "at least one cell"),
        ("8/64 each", "'8/64 each' is not a structure; write top/leaf"),
        ("512/512", "at most 256 top cells"),
        ("256/4096 per-cell", "at most 65536"),
    ],
)
def test_a_resolution_that_makes_no_grid_is_refused(text, message):
    with pytest.raises(DefrayError, match=message):
        parse_structure(text)


def test_a_grid_beyond_the_memory_is_refused_with_its_size(device):
    with pytest.raises(DefrayError, match=r"needs at least [0-9.]+ GiB; the limit here is .* a leaf of about \d+"):
        structures.build(upload_scene(device, soup(300)), Uniform(16, 1024, per_cell=True))


def test_a_scene_without_area_is_refused(device):
    with pytest.raises(DefrayError, match="no triangle with an area"):
        upload_scene(device, np.zeros((3, 3, 3), np.float32))
