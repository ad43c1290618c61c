"""Stand-ins: the right size, the same bytes every time, and something to see in every view."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from harness.data import Scene
from harness.inputs.rays import image_rays
from harness.reference.embree_scene import EmbreeScene
from harness.reference.exact import zero_area
from harness.studies.stand_ins.likeness import stored_digest
from scenes import elementary, recipes
from scenes.plants import branches, cloud, leaf, leaves
from scenes.shapes import areas, box, generator, on_lattice, quad, revolve, scatter, sphere, torus, tubes

STAND_INS = [recipe for recipe in recipes().values() if recipe.stand_in]
QUICK = {"sponza", "conference"}


def volume(triangles: np.ndarray) -> float:
    """Of a closed mesh seen from outside."""
    a, b, c = np.asarray(triangles, np.float64).transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


def test_the_papers_five_scenes_all_have_a_stand_in():
    papers = [recipe.name for recipe in recipes().values() if recipe.paper]
    assert sorted(papers) == ["conference", "crown", "hairball", "san-miguel", "sponza"]
    assert {recipe.name for recipe in STAND_INS} == set(papers)


@pytest.mark.parametrize(
    "recipe",
    [pytest.param(r, id=r.name, marks=[] if r.name in QUICK else [pytest.mark.slow]) for r in STAND_INS],
)
def test_a_stand_in_is_of_the_scenes_size_and_always_the_same(recipe):
    triangles = recipe.stand_in(1)
    assert triangles.dtype == np.float32 and triangles.shape[1:] == (3, 3)
    assert abs(len(triangles) / recipe.triangles - 1) < 0.05
    assert np.isfinite(triangles).all()
    assert zero_area(triangles).mean() < 0.03
    # Made on another machine; a generator that is changed goes with `python -m harness.studies.stand_ins.likeness`.
    assert hashlib.sha256(triangles.tobytes()).hexdigest() == stored_digest(recipe)
    embree = EmbreeScene(triangles)
    assert recipe.stand_in_views
    for view in recipe.stand_in_views:
        seen = embree.trace(image_rays(view, 64, 48)).primitive
        assert (seen >= 0).mean() > 0.2, view.name
        assert len(np.unique(seen)) > 300, view.name


def test_a_lesser_processor_makes_the_same_bytes():
    # Without fused multiply-add the C library's sine rounds differently; where these are unknown they do nothing.
    lesser = {
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3",
        "OPENBLAS_CORETYPE": "Nehalem",
    }
    program = (
        "import hashlib, warnings; warnings.simplefilter('ignore'); from scenes import recipes\n"
        "for name in ('sponza', 'conference'):\n"
        "    print(hashlib.sha256(recipes()[name].stand_in(1).tobytes()).hexdigest())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, **lesser}, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == [stored_digest(recipes()[name]) for name in ("sponza", "conference")]


def test_elementary_functions_are_those_of_the_library():
    x = np.linspace(-300, 300, 20_001)
    for own, library in ((elementary.sin, np.sin), (elementary.cos, np.cos)):
        assert np.abs(own(x) - library(x)).max() < 1e-15
    small = np.linspace(-40, 40, 8_001)
    assert elementary.exp(small) == pytest.approx(np.exp(small), rel=1e-14)
    assert elementary.log(np.exp(small)) == pytest.approx(small, abs=1e-14)
    assert elementary.power([0.0, 0.3, 2.0], 1.7) == pytest.approx([0.0, 0.3**1.7, 2**1.7], rel=1e-14)
    angle = np.linspace(-3.14, 3.14, 2_001)
    assert elementary.arctan2(3 * np.sin(angle), 3 * np.cos(angle)) == pytest.approx(angle, abs=1e-14)
    assert elementary.arctan2(0.0, 0.0) == 0
    assert elementary.steps(0.5, 2.0, 0.5).tolist() == [0.5, 1.0, 1.5]
    aim = elementary.directions(generator(3), 4_000)
    assert np.linalg.norm(aim, axis=1) == pytest.approx(1, rel=1e-12) and np.abs(aim.mean(axis=0)).max() < 0.03


def test_a_recipe_with_files_has_views_of_the_real_scene():
    for recipe in recipes().values():
        assert recipe.real_views or not recipe.files
        assert all(len(digest) == 64 for _, digest in recipe.files)
        assert Scene(recipe.name, np.zeros((0, 3, 3)), source="stand-in").title == f"{recipe.name} (stand-in)"


def test_closed_shapes_enclose_their_volume():
    assert volume(box((0, 0, 0), (1, 2, 3))) == pytest.approx(6)
    assert volume(sphere(2.0, 60, 120)) == pytest.approx(4 / 3 * np.pi * 8, rel=0.01)
    assert abs(volume(torus(3.0, 1.0, 120, 60))) == pytest.approx(2 * np.pi**2 * 3, rel=0.01)


def test_open_shapes_have_their_area():
    assert areas(quad((0, 0, 0), (2, 0, 0), (0, 3, 0), 4, 5)).sum() == pytest.approx(6)
    assert areas(revolve(np.array([(1, 0), (1, 2)]), 200)).sum() == pytest.approx(4 * np.pi, rel=0.001)
    line = np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0]], float)
    assert areas(tubes(line, 0.1, 64)).sum() == pytest.approx(2 * np.pi * 0.1 * 2, rel=0.01)


def test_copies_are_scaled_turned_and_moved():
    copies = scatter(box((0, 0, 0), (1, 1, 1)), [[10, 0, 0], [0, 5, 0]], np.array([1.0, 2.0]), np.array([np.pi, 0.0]))
    first, second = copies[:12], copies[12:]
    assert first.reshape(-1, 3).min(axis=0) == pytest.approx([9, 0, -1])
    assert second.reshape(-1, 3).max(axis=0) == pytest.approx([2, 7, 2])


def test_plants_stay_where_they_are_put():
    random = generator(5)
    points = cloud(random, 500, (1, 2, 3), (0.5, 0.5, 0.5))
    assert np.linalg.norm(points - [1, 2, 3], axis=1).max() <= 0.5
    foliage = leaves(random, points, 0.01)
    assert len(foliage) == 500 * len(leaf())
    assert np.abs(foliage - [1, 2, 3]).max() < 0.6
    wood, ends = branches(random, (0, 0, 0), 2.0, 5.0, 7)
    assert len(ends) == 7 and len(wood) > 0 and ends[:, 1].min() > 3


def test_rounding_to_the_lattice_is_exact_and_small():
    triangles = generator(1).normal(size=(100, 3, 3)) * 30
    rounded = on_lattice(triangles, 128.0, 20)
    step = 128.0 / 2**20
    assert (rounded / step == np.rint(rounded / step)).all()
    assert np.abs(rounded - triangles).max() <= step / 2
