"""Facts of tracers, read from their files without importing them; a tracer is one file."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys

import numpy as np
import pytest
from made_up_report import deferred, make_folder, numbers_of, one_record

from harness import tracers
from harness.data import Scene
from harness.errors import DefrayError
from harness.files import ROOT
from harness.inputs.rays import make_rays
from harness.report.figures import style
from harness.report.figures.kernel_rows import SHARED_KERNELS, kernel_title
from harness.report.page import redraw
from harness.spec.run_spec import Variant
from harness.spec.tracer_facts import TracerFacts, listed_tracers, read_tracer, tracer_facts, tracer_place
from harness.studies.roofline.kernel_work import KERNELS
from harness.studies.study import guessed_seconds
from harness.tracers.device_tracer import DeviceOptions
from harness.tracers.prepared import Prepared
from harness.tuning.cost_model import TimedRun
from harness.tuning.fit import fitted_settings
from harness.tuning.sampling import RayWork

ADDED = '''"""Brute force under another name."""

from harness.tracers.brute import Brute


class Added(Brute):
    """Nothing new."""

    name = "added"


TRACER = Added
'''
DRAWING = """
import sys
for heavy in ("pyopencl", "trimesh", "embreex"):
    sys.modules[heavy] = None
import harness.report.page, harness.claims, harness.analysis.results, harness.spec.tracer_facts
from harness.report.contents import contents
assert contents()
measuring = {"device", "inputs", "structures", "tracers", "tuning", "measure", "studies", "campaign", "commands"}
print(sorted(name for name in sys.modules if name.startswith("harness.") and name.split(".")[1] in measuring))
"""


@pytest.fixture
def added(tmp_path, monkeypatch):
    """A folder that DEFRAY_EXTRA names, with a tracer that states nothing but its name."""
    (tmp_path / "extra" / "tracers").mkdir(parents=True)
    (tmp_path / "extra" / "tracers" / "added.py").write_text(ADDED)
    monkeypatch.setenv("DEFRAY_EXTRA", str(tmp_path / "extra"))
    return tmp_path / "extra" / "tracers"


def test_the_drawing_side_imports_nothing_that_measures():
    done = subprocess.run(
        [sys.executable, "-c", DRAWING], cwd=ROOT, capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", tracers.names())
def test_what_is_read_is_what_the_file_says_when_imported(name):
    listed, tracer = listed_tracers()[name], tracers.find(name)
    module = importlib.import_module(tracer.__module__)
    assert listed.facts == module.FACTS and tracer is module.TRACER and tracer.name == name
    own = {
        option: field.default
        for option, field in tracer.Options.model_fields.items()
        if option not in DeviceOptions.model_fields
    }
    assert listed.defaults == {
        option: str(value).lower() if isinstance(value, bool) else str(value) for option, value in own.items()
    }


def test_terms_and_options_are_those_of_the_work_and_the_tracer():
    for name, listed in listed_tracers().items():
        assert {term for terms in listed.facts.terms.values() for term in terms} <= set(dir(RayWork)) | {
            *RayWork.__dataclass_fields__
        }
        assert "rest" in listed.facts.terms
        for options in fitted_settings(name):
            tracers.base.parse_options(tracers.find(name), options)


def test_every_kernel_with_stated_work_is_a_tracers_own_or_shared():
    own = {kernel for listed in listed_tracers().values() for kernel in listed.facts.kernels}
    parts = {"clear bins", "prefix sum", "compaction"}  # of stages, no kernels
    assert set(KERNELS) - parts <= own | set(SHARED_KERNELS)
    for listed in listed_tracers().values():
        assert set(listed.facts.test_kernels) <= set(listed.facts.kernels)


def test_looks_of_tracers_differ():
    looks = [style.tracer_look(name) for name in listed_tracers()]
    assert len(set(looks)) == len(looks)
    assert not {*style.TRACER_LOOKS} & set(looks)


def test_a_tracer_without_facts_has_usual_ones(added):
    assert list(listed_tracers())[-1] == "added" and tracer_place("added") == len(listed_tracers()) - 1
    assert tracer_facts("added") == TracerFacts() == tracer_facts("of an older version")
    assert tracer_place("of an older version") == len(listed_tracers())
    assert style.tracer_look("added") in style.TRACER_LOOKS
    assert style.tracer_look("of an older version") in style.TRACER_LOOKS
    assert kernel_title("walk_quickly") == "walk quickly"
    assert guessed_seconds("sponza", [(Variant(tracer="added"), 3000)], 1000) > 0
    assert fitted_settings("added") == [{}]
    work = RayWork(*(1.0 for _ in RayWork.__dataclass_fields__))
    assert TimedRun("added", "sponza", 10, {"total": 1.0}, work, 1.0, 1, 1).stages == {"rest": 0.1}


def test_a_tracer_is_one_file_that_runs(added, device):
    assert "added" in tracers.names()
    variant = tracers.check_variant(Variant.parse("added:ray-space"))
    triangles = np.random.default_rng(1).random((50, 3, 3), np.float32)
    scene = Scene("some", triangles)
    prepared, rays = Prepared.on_device(scene, device), make_rays(scene, "random", 500)
    hits = [tracers.open_tracer(prepared, name).timed(rays)[0] for name in (variant.tracer, "brute")]
    assert (hits[0].primitive == hits[1].primitive).all() and (hits[0].t == hits[1].t).all()
    assert (hits[0].primitive >= 0).any()


def test_an_added_tracer_is_drawn(added, tmp_path):
    alone = one_record("sponza", "added", "ray-space", {"total": 300}, grid=None)
    make_folder(tmp_path / "out", [deferred("sponza"), alone])
    (file,) = redraw(tmp_path / "out", "end_to_end")
    assert file.is_file()
    assert "added, fastest" in set(numbers_of(tmp_path / "out", "end_to_end")["series"])


def test_a_tracer_may_be_a_folder(added):
    (added / "added.py").rename(added / "kept.txt")
    (added / "added").mkdir()
    (added / "kept.txt").rename(added / "added" / "tracer.py")
    assert read_tracer(added / "added" / "tracer.py").name == "added"
    assert tracers.find("added").name == "added"


def test_facts_of_an_added_tracer_are_read(added):
    (added / "added.py").write_text(ADDED + 'FACTS = TracerFacts(order=2, colour="red", kernels={"k_one": "one"})\n')
    assert list(listed_tracers())[1] == "added"  # beside streamed, by name
    assert style.tracer_look("added")[0] == style.RED
    assert kernel_title("k_one") == "one"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ADDED + "FACTS = TracerFacts(colour=some())\n", "FACTS must be TracerFacts"),
        (ADDED + "FACTS = 3\n", "FACTS must be TracerFacts"),
        (ADDED + "FACTS = TracerFacts(colour='mauve')\n", "FACTS: colour: "),
        (ADDED + "FACTS = TracerFacts(speed=3)\n", "FACTS: speed: unknown key"),
        (ADDED + "def (:\n", "cannot read .*added.py: "),
        (ADDED.replace('"added"', '"brute"'), "tracer 'brute' is in .*brute.py too"),
        ("TRACER = 3\n", "TRACER must be a class of this file"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_clear_line(added, text, message):
    (added / "added.py").write_text(text)
    with pytest.raises(DefrayError, match=message) as caught:
        listed_tracers()
    assert "\n" not in str(caught.value)


def test_a_file_that_fails_to_load_is_one_clear_line(added):
    (added / "added.py").write_text("import no_such_module\n" + ADDED)
    with pytest.raises(DefrayError, match=r"cannot load .*added.py: ModuleNotFoundError: .*no_such_module"):
        tracers.find("added")


def test_an_extra_folder_that_is_none_is_one_clear_line(tmp_path, monkeypatch):
    monkeypatch.setenv("DEFRAY_EXTRA", os.pathsep.join([str(tmp_path), str(tmp_path / "none")]))
    with pytest.raises(DefrayError, match=r"DEFRAY_EXTRA names .*none, which is no folder"):
        listed_tracers()
