"""The adaptive grid: it references every triangle where it lies, its walk steps over nothing."""

from __future__ import annotations

import numpy as np
import pytest
from adaptive_grids import SPECS
from shapes import clumps, icosphere, sampled_cells, soup
from traced import MESHES, hits_of, setting_of, shared_scene_in

from harness import structures
from harness.data import differing
from harness.device.program import build
from harness.device.runtime import cl
from harness.spec.structure import Adaptive
from harness.structures.adaptive import levels_of, top_shape
from harness.structures.device_scene import upload_scene
from harness.studies.stability.walks import box_interval, uncovered_stretches


def leaf_cells(grid):
    """Every leaf cell of the grid, read back: its top cell's entry, place in its level, entry and level."""
    x, y = grid.shape[:2]
    leaves = grid.leaves.get()[::2].tolist()
    for top, entry in enumerate(grid.top_cells.get().tolist()):
        if entry < 0:
            continue
        level, first = entry & 7, entry >> 3
        base = np.array([top % x, top // x % y, top // x // y]) << level
        for i in range(8**level):
            inner = np.array([i, i >> level, i >> 2 * level]) & ((1 << level) - 1)
            yield base + inner, leaves[first + i], level


def leaf_boxes(grid) -> dict[int, tuple[int, int, int, int]]:
    """Low corner and size, in positions of the finest level, of every non-empty cell."""
    found = {}
    for place, entry, level in leaf_cells(grid):
        if entry >= 0:
            shift = grid.shape[3] - level
            found[entry] = (*(place << shift).tolist(), 1 << shift)
    return found


def edges_of(entry: int) -> list[int]:
    """Edge of the empty cube that an empty cell's entry states, for each octant."""
    return [EDGES[(entry + 2**32) >> 3 * octant & 7] for octant in range(8)]


EDGES = [1, 2, 3, 4, 5, 7, 9, 11]


def largest_cube(empty: np.ndarray, place, octant: int) -> int:
    """Edge of the largest cube of True cells of bool[x,y,z] that starts at a place and goes on along an octant."""
    for edge in range(2, 12):
        low = [p if octant >> axis & 1 else p - edge + 1 for axis, p in enumerate(place)]
        high = [a + edge for a in low]
        if min(low) < 0 or any(h > n for h, n in zip(high, empty.shape, strict=True)):
            return edge - 1
        if not empty[tuple(slice(a, b) for a, b in zip(low, high, strict=True))].all():
            return edge - 1
    return 11


def stated(edge: int) -> int:
    """The longest edge with a code that is not above `edge`."""
    return max(e for e in EDGES if e <= edge)


@pytest.mark.parametrize("spec", SPECS, ids=str)
@pytest.mark.parametrize("name", ["soup", "sphere", "walls", "clumps"])
def test_every_point_of_every_triangle_lies_in_a_cell_that_references_it(device, name, spec):
    mesh, grid = MESHES[name][0], shared_scene_in(device, name, spec).structure
    start, references = grid.cell_start.get(), grid.references.get()
    held = {}
    for cell, box in leaf_boxes(grid).items():
        listed = references[start[cell] : start[cell + 1]]
        assert len(listed) and (np.diff(listed) > 0).all(), "references of a cell ascend without repeats"
        held[box] = set(listed.tolist())
    assert len(held) == grid.nonempty == len(start) - 1
    sizes = [1 << level for level in range(grid.shape[3] + 1)]
    for *place, triangle in sampled_cells(mesh, grid, 20):
        boxes = ((*(p // size * size for p in place), size) for size in sizes)
        assert any(triangle in held.get(box, ()) for box in boxes)


def test_dense_top_cells_are_fine_and_sparse_ones_coarse(device):
    mesh = np.concatenate([soup(5000, size=0.002) * np.float32(0.01), icosphere(1, 4.0)])
    grid = structures.build(upload_scene(device, mesh), Adaptive(1.0, top=4, leaf=64))
    levels = {entry & 7 for entry in grid.top_cells.get().tolist() if entry >= 0}
    assert max(levels) >= 4 and min(levels) <= 2
    assert grid.describe()["cells"] < 0.2 * 4**3 * 16**3


@pytest.mark.parametrize("name", ["clumps", "sphere"])
def test_the_cube_ahead_of_an_empty_top_cell_is_empty_and_the_largest(device, name):
    grid = structures.build(upload_scene(device, MESHES[name][0]), Adaptive(top=9, leaf=4))
    x, y, z, _ = grid.shape
    entries = grid.top_cells.get().reshape(z, y, x).transpose(2, 1, 0)
    empty, seen = entries < 0, []
    for place in np.argwhere(empty):
        edges = edges_of(int(entries[tuple(place)]))
        assert edges == [stated(largest_cube(empty, place, octant)) for octant in range(8)]
        seen += edges
    assert len(seen) > 240 and max(seen) > 3


@pytest.mark.parametrize("name", ["clumps", "sphere"])
def test_the_cube_ahead_of_an_empty_leaf_cell_is_empty_and_the_largest_in_its_top_cell(device, name):
    grid = structures.build(upload_scene(device, MESHES[name][0]), Adaptive(20.0, top=2))
    blocks = {}
    for place, entry, level in leaf_cells(grid):
        top = (*(place >> level).tolist(), level)
        block = blocks.setdefault(top, np.zeros((1 << level,) * 3, np.int64))
        block[tuple(place & ((1 << level) - 1))] = entry
    seen = []
    for block in blocks.values():
        for place in np.argwhere(block < 0)[::7]:
            edges = edges_of(int(block[tuple(place)]))
            assert edges == [stated(largest_cube(block < 0, place, octant)) for octant in range(8)]
            seen += edges
    assert len(seen) > 1000 and max(seen) > 4


def test_the_same_scene_gives_the_same_bytes(device):
    scene = upload_scene(device, clumps(2000))
    first, second = (structures.build(scene, SPECS[1]) for _ in range(2))
    for name in ("top_cells", "leaves", "cell_start", "references"):
        assert getattr(first, name).get().tobytes() == getattr(second, name).get().tobytes()


def test_top_cells_are_nearly_cubic_and_follow_the_triangles():
    extent = np.array([4.0, 1.0, 2.0])
    assert top_shape(extent, 128_000).tolist() == [40, 10, 20]
    assert top_shape(extent, 1).tolist() == [1, 1, 1]
    assert top_shape(extent, 1, top=8).tolist() == [8, 2, 4]


def test_levels_follow_the_cube_root_of_the_triangles():
    assert levels_of(np.array([0, 1, 8, 64, 512, 10**9]), 1.0, 4).tolist() == [0, 0, 1, 2, 3, 4]
    assert levels_of(np.array([512]), 1 / 8, 4).tolist() == [2]


def boxes_walked(device, grid, rays, slots=400) -> np.ndarray:
    """Boxes that each ray walks through, as in studies/walk_boxes.cl, int32[n,slots,6]; size 0 beyond the last."""
    inputs = (
        cl.array.to_device(device.queue, np.ascontiguousarray(values, np.float32).ravel())
        for values in (rays.origins, rays.directions)
    )
    boxes = cl.array.zeros(device.queue, len(rays) * slots * 6, np.int32)
    found = cl.array.zeros(device.queue, len(rays), np.int32)
    program = build(device, "studies/walk_boxes.cl", structure=grid.header, defines=grid.defines)
    program.launch("walk_boxes", len(rays), len(rays), *inputs, *grid.arguments, slots, boxes, found)
    assert found.get().max() < slots
    return boxes.get().reshape(len(rays), slots, 6)


def uncovered(grid, rays, boxes) -> np.ndarray:
    """Stretches of each ray's path in the grid that no box, grown by the pad of the build, covers; int[n]."""
    resolution = np.array(grid.shape[:3]) << grid.shape[3]
    inverse = (1 / grid.cell_size).astype(np.float64)
    origin = (rays.origins.astype(np.float64) - grid.lower) * inverse
    direction = rays.directions.astype(np.float64) * inverse
    pad = np.broadcast_to(pad_in_cells(grid), origin.shape)
    # box_interval takes one size for all axes; the path in a box of three sizes is common to three such boxes.
    first, last = -np.inf, np.inf
    for axis in range(3):
        chosen, size = np.arange(3) == axis, resolution[axis]
        place, towards = np.where(chosen, origin, size / 2), np.where(chosen, direction, 0)
        near, far = box_interval([np.zeros((len(rays), 1))] * 3, size, place, towards, -pad)
        first, last = np.maximum(first, near[:, 0]), np.minimum(last, far[:, 0])
    low = [boxes[:, :, axis] for axis in range(3)]
    enter, leave = box_interval(low, boxes[:, :, 3], origin, direction, pad)
    enter[boxes[:, :, 3] == 0] = leave[boxes[:, :, 3] == 0] = -np.inf
    speed = np.sqrt((direction * direction).sum(axis=1))
    return uncovered_stretches(enter, leave, np.maximum(first, 0), last, speed).stretches


@pytest.mark.parametrize("spec", SPECS, ids=str)
@pytest.mark.parametrize("name", MESHES)
def test_the_walk_steps_over_no_part_of_a_path(device, name, spec):
    grid, rays = shared_scene_in(device, name, spec).structure, MESHES[name][1]
    rays = rays[:500]
    boxes = boxes_walked(device, grid, rays, 1500)
    assert uncovered(grid, rays, boxes).sum() == 0
    cells = leaf_boxes(grid)
    walked = boxes.reshape(-1, 6)[(boxes[:, :, 3] > 0).ravel()][:, :5]
    used = walked[walked[:, 4] >= 0]
    assert len(used) > 0 and all(cells[cell] == tuple(box) for *box, cell in used.tolist())
    leaves = set(cells.values())
    assert not any(tuple(box) in leaves for *box, cell in walked[walked[:, 4] < 0].tolist())


def test_a_box_left_out_of_a_path_is_caught(device):
    mesh, rays = MESHES["clumps"]
    grid = structures.build(upload_scene(device, mesh), SPECS[0])
    boxes = boxes_walked(device, grid, rays[:200])
    boxes[:, 1, 3] = 0
    assert (uncovered(grid, rays[:200], boxes) > 0).mean() > 0.9


def pad_in_cells(grid) -> np.ndarray:
    """By how many positions of the finest level the build grows a cell on every side, float64[3]."""
    extent = ((np.array(grid.shape[:3]) << grid.shape[3]) * grid.cell_size.astype(np.float64)).max()
    return 32 * 2.0**-24 * extent / grid.cell_size.astype(np.float64)


def content_boxes(grid) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Low and high corner of the box around what lies in each non-empty cell, in positions of the finest level."""
    numbers, words = grid.leaves.get().reshape(-1, 2).T
    boxes, found = dict(zip(numbers.tolist(), words.tolist(), strict=True)), {}
    for cell, (*low, size) in leaf_boxes(grid).items():
        places = boxes[cell] >> 5 * np.arange(6) & 31
        found[cell] = low + places[:3] * size / 32, low + (places[3:] + 1) * size / 32
    return found


@pytest.mark.parametrize("spec", SPECS, ids=str)
@pytest.mark.parametrize("name", ["soup", "sphere", "walls", "clumps", "slivers"])
def test_the_box_of_a_cell_holds_all_of_its_triangles_in_the_cell(device, name, spec):
    mesh, grid = MESHES[name][0], shared_scene_in(device, name, spec).structure
    generator = np.random.default_rng(1)
    weights = generator.dirichlet([0.5] * 3, (len(mesh), 40))
    points = np.einsum("tpc,tcx->tpx", weights, mesh.astype(np.float64))
    points = (points - grid.lower) / grid.cell_size.astype(np.float64)
    start, references, boxes, places = grid.cell_start.get(), grid.references.get(), content_boxes(grid), 0
    for cell, (*low, size) in leaf_boxes(grid).items():
        inside = points[references[start[cell] : start[cell + 1]]].reshape(-1, 3)
        inside = inside[((inside >= low) & (inside <= np.add(low, size))).all(axis=1)]
        assert ((inside >= boxes[cell][0]) & (inside <= boxes[cell][1])).all()
        places += len(inside)
    assert places > 20 * len(mesh)


@pytest.mark.parametrize("spec", SPECS, ids=str)
@pytest.mark.parametrize("name", MESHES)
def test_a_cell_is_passed_over_only_by_rays_that_miss_the_box_of_what_lies_in_it(device, name, spec):
    grid, rays = shared_scene_in(device, name, spec).structure, MESHES[name][1][:300]
    walked, boxes, pad = boxes_walked(device, grid, rays, 1500), content_boxes(grid), pad_in_cells(grid)
    passed = (walked[:, :, 4] >= 0) & (walked[:, :, 5] < 0) & (walked[:, :, 3] > 0)
    assert ((walked[:, :, 5] < 0) | (walked[:, :, 5] == walked[:, :, 4])).all()
    ray, step = np.nonzero(passed)
    low, high = (np.array([boxes[c][side] for c in walked[ray, step, 4]]).reshape(-1, 3) for side in (0, 1))
    inverse = (1 / grid.cell_size).astype(np.float64)
    origin = ((rays.origins.astype(np.float64) - grid.lower) * inverse)[ray]
    direction = (rays.directions.astype(np.float64) * inverse)[ray]
    with np.errstate(divide="ignore", invalid="ignore"):
        # Less the pad that was added for rounding's sake.
        near, far = (low + pad - origin) / direction, (high - pad - origin) / direction
    near, far = np.fmin(near, far).max(axis=1, initial=0), np.fmax(near, far).min(axis=1)
    assert not (near < far).any()


def test_boxes_too_small_lose_hits(device):
    mesh, rays = MESHES["soup"]
    prepared = setting_of(device, mesh, SPECS[0])
    expected = hits_of(prepared, rays, "forward")
    leaves = prepared.structure.leaves.get()
    leaves[1::2] = 0
    prepared.structure.leaves.set(leaves)
    assert differing(hits_of(prepared, rays, "forward"), expected) > 0.2 * len(rays)
