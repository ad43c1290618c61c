"""The checks of grid walk and overlap test: what they find in order, and that they notice what is not."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from shapes import lattice_walls

from harness import structures
from harness.data import Rays, Scene
from harness.device.program import build
from harness.device.runtime import cl
from harness.errors import DefrayError
from harness.spec.intersectors import INTERSECTORS
from harness.spec.run_spec import Variant
from harness.spec.structure import OVERLAPS, Uniform
from harness.structures.device_scene import upload_scene
from harness.structures.uniform import pad_cells
from harness.studies.stability import walks
from harness.studies.stability import whole_grids as whole
from harness.studies.stability.walks import (
    FAMILIES,
    Lattice,
    case_rays,
    check_walk,
    coverage,
    generator,
    walk,
    walk_digest,
    walk_family,
)
from harness.studies.stability.whole_grids import grid_digest, grid_family
from harness.tracers import find
from harness.tracers.base import parse_options
from harness.tracers.batch import Batch
from harness.tracers.forward import EXITS
from harness.tracers.prepared import Prepared

SEED = 12111
DEFAULT = INTERSECTORS["ray-space"]


def case(device, family, name, count):
    """Grid and rays of one case."""
    return FAMILIES[family][name][0].grid(device, SEED), case_rays(family, name, count, SEED)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_walk_steps_over_no_part_of_a_path(device, family):
    found = walk_family(device, family, 4000, SEED)
    assert found["rays"] >= 3900 and found["leaks"] == found["steps_over"] == 0 and found["worst_chord"] == 0
    assert set(found["cases"]) == set(FAMILIES[family])


def test_an_accumulated_walk_of_a_fine_grid_is_caught(device, mutate):
    grid, rays = case(device, "G1", "1024", 150)
    assert check_walk(device, grid, rays)["leaks"] == 0
    mutate("planes-accumulated")
    found = check_walk(device, grid, rays)
    assert found["leaks"] > 0 and found["worst_chord"] > 1e-3


def test_a_negative_zero_that_counts_as_ahead_is_caught(device, mutate):
    grid, rays = case(device, "G2", "signed zeros along an axis, uneven cells", 300)
    assert check_walk(device, grid, rays)["leaks"] == 0
    mutate("negative-zero-ahead")
    found = check_walk(device, grid, rays)
    assert found["leaks"] > 100 and found["worst_chord"] > 50


def test_a_walk_that_takes_too_many_steps_is_counted(device, monkeypatch):
    grid, rays = case(device, "G1", "128", 50)
    monkeypatch.setattr(walks, "most_steps", lambda spec: spec.resolution)
    assert check_walk(device, grid, rays)["steps_over"] > 0


def test_a_skipped_top_cell_that_is_not_empty_is_caught(device):
    """The walk of a grid with empty top cells does not do for one without."""
    lattice, _ = FAMILIES["G1"]["128, half of the top cells empty"]
    rays = case_rays("G1", "128, half of the top cells empty", 300, SEED)
    sparse = lattice.grid(device, SEED)
    full = Lattice(lattice.spec, lattice.lower, lattice.cell_size).grid(device, SEED)
    visited, _ = walk(device, sparse, rays)
    assert coverage(sparse, rays, visited).stretches.sum() == 0
    assert (coverage(full, rays, visited).longest > 10).mean() > 0.5
    top = (visited[visited >= 0][:, None] // [1, 128, 128**2]) % 128 // 16
    assert (sparse.top_block.get()[top @ [1, 8, 64]] == 0).all()


@pytest.mark.parametrize("maker", [maker for _, maker in FAMILIES["G2"].values()][:5] + [walks.towards_edges])
@pytest.mark.parametrize("share", [None, 0.125], ids=["pad of the build", "large pad"])
def test_coverage_agrees_with_rationals(device, maker, share):
    """On full and on damaged lists of cells; `share` of a cell as pad."""
    lattice = Lattice(Uniform(2, 8), (-0.37, 0.11, -2.3), (0.0137, 0.0171, 0.0093))
    rays, grid = maker(lattice, generator(SEED, 99), 40), lattice.grid(device, SEED)
    pad = pad_cells(grid.spec, grid.cell_size)[:3] if share is None else np.full(3, share)
    visited, _ = walk(device, grid, rays)
    visited[::2, ::3] = -1
    found = coverage(grid, rays, visited, None if share is None else pad)
    exact = [exact_gap(grid, rays[i : i + 1], visited[i], pad) for i in range(len(rays))]
    assert np.abs(found.longest - exact).max() < 1e-9
    assert (found.longest <= np.array(exact) + 1e-12).all(), "a stretch is never made up"
    assert (np.array(exact)[::2] > 0.1).any() and (np.array(exact)[1::2] == 0).all()


def exact_gap(grid, ray: Rays, visited, pad) -> float:
    """Longest stretch of one ray's path, in cells, that no visited cell grown by the pad covers: in rationals."""
    inverse = [Fraction(float(v)) for v in 1 / grid.cell_size]
    lower, pad = ([Fraction(float(v)) for v in values] for values in (grid.lower, pad))
    o = [(Fraction(float(ray.origins[0, i])) - lower[i]) * inverse[i] for i in range(3)]
    d = [Fraction(float(ray.directions[0, i])) * inverse[i] for i in range(3)]

    def span(low, size, grow):
        first, last = Fraction(0), None
        for i in range(3):
            below, above = low[i] - grow * pad[i] - o[i], low[i] + size + grow * pad[i] - o[i]
            if d[i] == 0:
                if not below <= 0 <= above:
                    return None
                continue
            a, b = sorted((below / d[i], above / d[i]))
            first, last = max(first, a), b if last is None else min(last, b)
        return (first, last) if first <= last else None

    size = grid.spec.resolution
    whole_path = span((0, 0, 0), size, -1)
    if whole_path is None:
        return 0.0
    cells = [(int(c) % size, int(c) // size % size, int(c) // size**2) for c in visited if c >= 0]
    reach, longest = whole_path[0], Fraction(0)
    for first, last in [*sorted(s for c in cells if (s := span(c, 1, 1))), (whole_path[1], whole_path[1])]:
        longest = max(longest, min(first, whole_path[1]) - reach)
        reach = max(reach, last)
    return float(longest) * float(sum(v * v for v in d)) ** 0.5


@pytest.mark.parametrize("lanes", [4, 16])
def test_rays_that_walk_together_visit_the_same_cells(device, lanes):
    """The deferred tracer's recording walk, against the walk of single rays."""
    for family, name in [("G1", "128, half of the top cells empty"), *(("G2", name) for name in FAMILIES["G2"])]:
        grid, rays = case(device, family, name, 100)
        visited, _ = walk(device, grid, rays)
        batch, length = Batch(device, rays), visited.shape[1]
        inputs = (batch.count, batch.origins, batch.directions, batch.t_max, *grid.arguments)
        outputs = (batch.rays, batch.keys, batch.positions, batch.t_exit)
        build(device, "tracers/start.cl", structure=grid.header, defines=grid.defines).launch(
            "start_rays", batch.count, *inputs, *outputs
        )
        active = cl.array.arange(device.queue, batch.count, dtype=np.int32)
        room = batch.count + lanes  # the last lanes of a group may be idle and still write
        slots, counts = (cl.array.zeros(device.queue, n * room, np.int32) for n in (length + 1, 1))
        build(
            device, "tracers/deferred/walk.cl", structure=grid.header, defines=grid.defines | {"WALK_LANES": lanes}
        ).launch(
            "record_pairs",
            -(-batch.count // lanes),
            *(batch.count, active, batch.rays, batch.keys, *grid.arguments, length, lanes),
            *(batch.positions, batch.t_exit, slots, counts),
        )
        recorded = slots.get()[: batch.count * (length + 1)].reshape(batch.count, -1)[:, :length]
        used = np.arange(length) < counts.get()[: batch.count, None]
        x, y, z = visited % 128 % 16, visited // 128 % 128 % 16, visited // 128**2 % 16
        numbers = ((z // 2 * 4 + y // 4) * 4 + x // 4) * 32 + z % 2 * 16 + y % 4 * 4 + x % 4
        assert (np.where(used, recorded, -1) == np.where(visited < 0, -1, numbers)).all(), name


def test_tracing_a_padded_grid_loses_nothing(device):
    found = grid_family(device, DEFAULT, "off", 4000, SEED)
    assert found["rays"] == 4000 and found["leaks"] == 0
    assert all(entry["hits"] > 500 for entry in found["cases"].values())


def overlap_study(device, intersector, rays: int, seed: int, names=tuple(whole.SCENES)) -> list[dict]:
    """What every overlap test and exit rule stores and loses in every scene, `rays` rays each.

    One dictionary for each: {"scene", "overlap", "exit", "triangles", "references", "rays", "hits", "lost": hits
    that become misses, "leaks": rays whose hit is lost or changed, "leaks_per_million"}. Forward tracing, against
    brute force.
    """
    rows = []
    for name in names:
        triangles, aimed = whole.grid_inputs(name, rays, seed)
        bare = Prepared.on_device(Scene(name, triangles), device)
        expected = whole.trace(bare, aimed, "brute", intersector, {})
        for overlap in OVERLAPS:
            prepared = bare.with_structure(whole.SPEC, overlap)
            for rule in EXITS:
                hits = whole.trace(prepared, aimed, "forward", intersector, {"exit": rule})
                leaks, hit = int(whole.changed(hits, expected).sum()), expected.primitive >= 0
                rows.append(
                    {
                        "scene": name,
                        "overlap": overlap,
                        "exit": rule,
                        "triangles": len(triangles),
                        "references": prepared.structure.describe()["references"],
                        "rays": rays,
                        "hits": int(hit.sum()),
                        "lost": int((hit & (hits.primitive < 0)).sum()),
                        "leaks": leaks,
                        "leaks_per_million": 1e6 * leaks / rays,
                    }
                )
    return rows


def test_overlap_tests_and_exit_rules_that_lose_rays_are_caught(device):
    rows = overlap_study(device, DEFAULT, 2000, SEED)
    leaks = {(row["scene"], row["overlap"], row["exit"]): row["leaks"] for row in rows}
    stored = {(row["scene"], row["overlap"]): row["references"] for row in rows}
    assert len(leaks) == len(whole.SCENES) * 4 * 2
    for scene in whole.SCENES:
        assert leaks[scene, "padded", "keep"] == leaks[scene, "padded", "reject"] == 0
        assert stored[scene, "padded"] >= stored[scene, "closed"] >= stored[scene, "open"]
    for scene in ("walls", "box"):
        assert stored[scene, "open"] == 2 and leaks[scene, "open", "keep"] > 1900
        assert leaks[scene, "box", "reject"] > leaks[scene, "box", "keep"] > 0
    assert leaks["walls, one ulp off", "closed", "reject"] > leaks["walls, one ulp off", "closed", "keep"] > 0
    assert leaks["sphere", "open", "keep"] > 0


def test_a_damaged_grid_fails_the_family(device, monkeypatch):
    make = Prepared.with_structure
    monkeypatch.setattr(Prepared, "with_structure", lambda prepared, spec, overlap: make(prepared, spec, "open"))
    found = grid_family(device, DEFAULT, "off", 2000, SEED)
    assert found["leaks"] > 700
    assert found["cases"]["walls"]["deferred"] > 300 and found["cases"]["walls"]["forward"] > 300


def test_walls_lie_on_cell_planes_as_the_build_sees_them(device):
    triangles = whole.walls_triangles(None)
    grid = structures.build(upload_scene(device, triangles), whole.SPEC)
    cells = (triangles[:-2] - grid.lower) * (1 / grid.cell_size)
    assert cells.dtype == np.float32
    assert (cells == np.rint(cells)).all() and cells.min() == 2 and cells.max() == 30
    off = (whole.near_walls_triangles(None)[:-2] - grid.lower) * (1 / grid.cell_size)
    assert (np.abs(off - cells) > 0).all() and (np.abs(off - cells) < 8e-6).all()


def test_padded_is_the_default(device):
    scene = upload_scene(device, lattice_walls(4))
    default, padded = structures.build(scene, whole.SPEC), structures.build(scene, whole.SPEC, "padded")
    assert default.overlap == "padded" and set(default.describe()) == set(padded.describe())
    assert default.references.get().tobytes() == padded.references.get().tobytes()
    counts = {name: structures.build(scene, whole.SPEC, name).describe()["references"] for name in OVERLAPS}
    assert counts["box"] > counts["padded"] >= counts["closed"] >= counts["open"] > 0


def test_an_unknown_overlap_test_or_exit_rule_is_refused(device):
    with pytest.raises(DefrayError, match="unknown overlap test 'loose'; known: box, closed, open, padded"):
        structures.build(upload_scene(device, lattice_walls(2)), Uniform(2, 8), "loose")
    with pytest.raises(DefrayError, match="option exit=drop of forward"):
        parse_options(find("forward"), Variant.parse("forward:ray-space:exit=drop").options)
    with pytest.raises(DefrayError, match="unknown option of tracer deferred 'exit'"):
        parse_options(find("deferred"), {"exit": "keep"})


def test_rejecting_hits_beyond_the_exit_costs_tests(device):
    """Also in the instrumented build; a hit found early and forgotten is tested again."""
    triangles, rays = whole.grid_inputs("slivers", 500, SEED)
    prepared = Prepared.on_device(Scene("slivers", triangles), device).with_structure(whole.SPEC)
    kept, rejected = (find("forward")(prepared, DEFAULT, {"exit": rule}).count(rays) for rule in EXITS)
    assert rejected.tests >= kept.tests > 0 and rejected.steps >= kept.steps > 0


def test_inputs_are_the_same_bits_everywhere():
    digests = [grid_digest(1000, SEED), *(walk_digest(family, 1000, SEED) for family in FAMILIES)]
    assert [digest[:12] for digest in digests] == ["b15c5fb45c97", "d841d13c1e70", "986e14d4d42a"]
