"""Sweeps: plans, resuming, failures that must not stop the rest."""

import itertools
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console
from test_record_file import MACHINE, make_body

from harness.campaign import plan
from harness.campaign import runner as sweep
from harness.errors import DefrayError
from harness.records.record_file import RecordFile
from harness.records.run_row import RunBody
from harness.records.schema import Machine
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import GridSpec

ROOT = Path(__file__).resolve().parents[2]
TIER = """
[tiers.small]
about = "a test"
[[tiers.small.sweeps]]
name = "one"
scenes = ["sponza", "conference"]
grids = ["8/32", "8/64"]
rays = "64k"
variants = ["deferred:ray-space", "deferred:ray-space:wave=8", "embree"]
repetitions = 2
"""


# ---------------------------------------------------------------- a fake pipeline


def body_of(spec: RunSpec, valid: bool = True, reference: str = "embree") -> RunBody:
    """What the pipeline would yield for `spec`."""
    body, variant = make_body(), spec.variant
    body |= {"view": spec.view, "repetitions": spec.repetitions, "spec": spec.model_dump(mode="json")}
    body["agreement"] |= {"reference": reference}
    body |= {"tracer": variant.tracer, "intersector": variant.intersector, "options": variant.options}
    body["scene"]["name"] = spec.scene
    body["samples"]["total"] = [0.1] * spec.repetitions
    if not valid:
        body |= {"valid": False, "rate": {"traverse": None, "intersect": None, "total": None}}
        body["agreement"] |= {"missed": 3, "valid": False}
    return RunBody.model_validate(body)


def fake_run_group(specs, device, report=None):
    """Yield a body per spec, last one first."""
    for number, spec in enumerate(reversed(specs)):
        report(SimpleNamespace(spec=spec, stage="repetition 1 of 2", done=number / len(specs)))
        yield spec, body_of(spec)


def install_fakes(monkeypatch, run_group=fake_run_group) -> None:
    """Put fakes in place of the pipeline, the device and the scenes."""
    replaced = {
        "campaign.runner.run_group": run_group,
        "commands.measuring.run_group": run_group,
        "campaign.runner.open_device": lambda part: None,
        "commands.measuring.open_device": lambda part: None,
        "commands.views.open_device": lambda part: None,
        "campaign.runner.machine_description": lambda device: Machine(**MACHINE),
        "commands.measuring.machine_description": lambda device: Machine(**MACHINE),
        "campaign.runner.environment_description": lambda device: dict(MACHINE),
        "commands.scenes.list_scenes": list,
    }
    for name, value in replaced.items():
        monkeypatch.setattr(f"harness.{name}", value)


@pytest.fixture
def fakes(monkeypatch):
    install_fakes(monkeypatch)
    return lambda run_group: install_fakes(monkeypatch, run_group)


@pytest.fixture
def request_(tmp_path):
    file = tmp_path / "tiers.toml"
    file.write_text(TIER)
    return sweep.SweepRequest(file, "small", tmp_path / "out", seed=5)


def start(request, **changes) -> tuple[int, str]:
    """Run a sweep; exit code and what it printed."""
    for key, value in changes.items():
        setattr(request, key, value)
    with open(request.file.with_name("printed"), "w+") as printed:
        code = sweep.run_sweep(request, Console(file=printed))
        printed.seek(0)
        return code, printed.read()


def ids_on_file(request) -> list[str]:
    return [record.id for record in RecordFile(request.out / "records.jsonl").read()]


# ---------------------------------------------------------------- plans


@pytest.mark.parametrize(
    ("text", "count"), [("64k", 64_000), ("1M", 1_000_000), ("2.5m", 2_500_000), ("1_000", 1000), (7, 7)]
)
def test_counts(text, count):
    assert plan.parse_count(text) == count


@pytest.mark.parametrize("text", ["", "0", "-1", "1X", "M", "0k", "1e6", "0.1", 0])
def test_bad_counts(text):
    with pytest.raises(DefrayError, match="count"):
        plan.parse_count(text)


def test_grids():
    assert plan.parse_grid("8/128") == GridSpec(8, 128, "total")
    assert plan.parse_grid("8/128 per-cell") == plan.parse_grid(str(GridSpec(8, 128, "per-cell")))
    assert plan.parse_grid("8/12 per-cell").leaf == 12
    with pytest.raises(DefrayError, match=r"leaf 100 is not a multiple of top 8.*96 or 104 would do"):
        plan.parse_grid("8/100")
    with pytest.raises(DefrayError, match=r"needs; 8 would do"):
        plan.parse_grid("8/5")
    with pytest.raises(DefrayError, match="unknown reading 'each'; known: adaptive, per-cell"):
        plan.parse_grid("8/128 each")
    with pytest.raises(DefrayError, match="not a grid"):
        plan.parse_grid("128")
    with pytest.raises(DefrayError, match="at least one cell"):
        plan.parse_grid("0/8")


def test_the_product_is_expanded_and_gridless_tracers_run_beside_every_grid(fakes, request_):
    specs = plan.expand(request_.file, "small")
    assert len(specs) == 2 * 2 * 3
    assert {spec.grid.leaf for spec in specs if spec.variant.tracer == "embree"} == {32, 64}
    assert {spec.rays for spec in specs} == {64_000}
    groups = sweep.shuffled_groups(specs, 1)
    order = [group[0].scene for group in groups]
    assert order in ([a, a, b, b] for a, b in (("sponza", "conference"), ("conference", "sponza")))
    assert [len(group) for group in groups] == [3, 3, 3, 3]
    assert all(len({spec.group for spec in group}) == 1 for group in groups)


def test_sweeps_on_the_same_rays_each_have_an_embree_of_their_own(fakes, request_):
    second = (
        'name = "two"\nscenes = "sponza"\ngrids = "{}"\nrays = "64k"\nrepetitions = 2\n'
        'variants = ["deferred", "embree"]\n'
    )
    request_.file.write_text(TIER + "[[tiers.small.sweeps]]\n" + second.format("auto"))
    specs = plan.expand(request_.file, "small")
    groups = [group for group in sweep.shuffled_groups(specs, 1) if group[0].scene == "sponza"]
    assert len(groups) == 3
    for group in groups:
        assert [str(spec.variant) for spec in group].count("embree") == 1
    request_.file.write_text(TIER + "[[tiers.small.sweeps]]\n" + second.format("8/32"))
    assert plan.expand(request_.file, "small") == specs[:12], "the same grid is the same run"


def test_groups_with_the_same_rays_follow_each_other(fakes, request_):
    request_.file.write_text(TIER.replace('rays = "64k"', 'rays = ["64k", "1k", "2k"]'))
    specs = plan.expand(request_.file, "small")
    for seed in range(5):
        order = [group[0].workload for group in sweep.shuffled_groups(specs, seed)]
        assert sum(one != two for one, two in itertools.pairwise(order)) == 2 * 3 - 1


def test_without_a_tracer_that_walks_no_grid_is_built(fakes):
    embree = plan.interleaved("sponza", [Variant.parse("embree")], [GridSpec()])
    assert [spec.grid for spec in embree] == [None]


def test_the_order_is_that_of_the_seed(fakes, request_):
    specs = plan.expand(request_.file, "small")
    assert sweep.shuffled_groups(specs, 1) == sweep.shuffled_groups(specs, 1)
    assert len({str(sweep.shuffled_groups(specs, seed)) for seed in range(8)}) > 1


def test_tiers_include_others_and_runs_stand_once(fakes, tmp_path):
    file = tmp_path / "a.toml"
    file.write_text(TIER + TIER.replace("small", "large").replace('"a test"', '"a test"\ninclude = ["small"]'))
    assert len(plan.expand(file, "large")) == len(plan.expand(file, "small"))
    file.write_text(TIER.replace('"a test"', '"a test"\ninclude = ["small"]'))
    with pytest.raises(DefrayError, match="tier 'small' includes itself"):
        plan.expand(file, "small")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "variants =",
            "varients =",
            r"tiers.toml: tiers.small.sweeps.0.variants: missing key \(and 1 more\)",
        ),
        ("repetitions = 2", "repeat = 2", "tiers.toml: tiers.small.sweeps.0.repeat: unknown key"),
        ("repetitions = 2", "repetitions = 0", "sweeps.0.repetitions: input should be greater than 0"),
        ("repetitions = 2", 'check = "twice"', "sweeps.0.check: input should be 'embree'"),
        (
            "deferred:ray-space:wave=8",
            "deferd:ray-space",
            "sweep 'one': unknown tracer 'deferd'; known: brute",
        ),
        ("deferred:ray-space:wave=8", "deferred:ray", "unknown intersector 'ray'; known: baldwin-weber"),
        ("ray-space:wave=8", "ray-space:wav=8", "unknown option of tracer deferred 'wav'; known: arrange"),
        ("ray-space:wave=8", "ray-space:wave=0", "option wave=0 of deferred: "),
        ("deferred:ray-space:wave=8", "deferred:ray-space:wave", "'wave'.*not of the form option=value"),
        ('"embree"', '"embree:ray-space"', "tracer 'embree' has its own intersector"),
        ("8/32", "8/33", "leaf 33 is not a multiple of top 8"),
        ("64k", "many", "'many' is not a count"),
        ("repetitions = 2", 'kinds = "soft"', "unknown kind of rays 'soft'"),
        ('grids = ["8/32", "8/64"]', "", "tracer 'deferred' needs a grid"),
        ("[tiers.small]", "[tiers.small", "tiers.toml: not TOML"),
        ("small", "other", "unknown tier 'small'; known: other"),
    ],
)
def test_mistakes_in_a_sweep_file_name_file_and_field(fakes, request_, old, new, message):
    request_.file.write_text(TIER.replace(old, new))
    with pytest.raises(DefrayError, match=message) as caught:
        plan.expand(request_.file, "small")
    assert "tiers.toml" in str(caught.value) and "\n" not in str(caught.value)


def test_the_projects_own_tiers_expand(fakes):
    file = ROOT / "harness/paper/sweeps.toml"
    sizes = [len(plan.expand(file, tier)) for tier in ("smoke", "paper", "full")]
    assert sizes[0] < sizes[1] < sizes[2]
    smoke = plan.expand(file, "smoke")
    assert {spec.variant.tracer for spec in smoke} == {
        "brute",
        "deferred",
        "embree",
        "forward",
        "streamed",
        "work-optimal",
    }
    assert {spec.scene for spec in smoke} == {"sponza", "conference"}


def test_the_full_tier_has_both_readings_and_embree_beside_what_it_is_compared_with(fakes):
    scenes = {"sponza", "conference", "hairball", "crown", "san-miguel"}
    full = plan.expand(ROOT / "harness/paper/sweeps.toml", "full")
    for grid in ("8/128", "8/128 per-cell"):
        for variant in ("deferred:ray-space", "work-optimal:ray-space"):
            runs = [spec for spec in full if spec.grid == plan.parse_grid(grid) and str(spec.variant) == variant]
            assert {spec.scene for spec in runs if spec.kind == "diffuse" and spec.repetitions >= 3} >= scenes
    for group in sweep.shuffled_groups(full, 1):
        if any(spec.variant.tracer == "streamed" for spec in group):
            assert "embree" in {spec.variant.tracer for spec in group}, group[0]
    dense = [spec for spec in full if spec.scene == "crown" and spec.rays == 1_000_000 and spec.repetitions == 3]
    assert {"deferred", "forward", "work-optimal", "embree"} <= {spec.variant.tracer for spec in dense}


# ---------------------------------------------------------------- running and resuming


def test_a_whole_sweep(fakes, request_):
    code, printed = start(request_)
    assert code == 0
    assert sorted(ids_on_file(request_)) == sorted(spec.id for spec in plan.expand(request_.file, "small"))
    lines = printed.splitlines()
    assert len(lines) == 13 and lines[0].startswith("[ 1/12] ") and lines[0].endswith("1 Mrays/s valid")
    assert lines[-1].startswith("12 runs: 12 valid; records in ")
    header = json.loads((request_.out / "sweep.json").read_text())
    assert (header["seed"], header["tier"], header["runs"]) == (5, "small", 12)
    assert json.loads((request_.out / "env.json").read_text()) == MACHINE


def test_a_folder_with_records_needs_resume(fakes, request_):
    start(request_)
    with pytest.raises(DefrayError, match="already has records; pass --resume"):
        start(request_)
    code, printed = start(request_, resume=True, seed=None)
    assert code == 0 and printed.startswith("12 runs: 12 valid") and len(ids_on_file(request_)) == 12


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"device": "other"}, "was started with device None, not other"),
        ({"seed": 6}, "was started with seed 5, not 6"),
        ({"text": TIER.replace("64k", "65k")}, "was started with a list of runs"),
        ({"text": TIER.replace("small", "large"), "tier": "large"}, "was started with tier small, not large"),
    ],
)
def test_resuming_another_sweep_is_refused(fakes, request_, changes, message):
    start(request_)
    request_.file.write_text(changes.pop("text", TIER))
    with pytest.raises(DefrayError, match=message):
        start(request_, resume=True, **changes)


def test_resuming_on_another_machine_is_refused(fakes, request_):
    start(request_)
    file = request_.out / "records.jsonl"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:4]))
    environment = {**MACHINE, "device": "another"}
    (request_.out / "env.json").write_text(json.dumps(environment))
    with pytest.raises(DefrayError, match="measured on device 'another', this is 'a device'"):
        start(request_, resume=True)


def test_a_torn_record_is_measured_again(fakes, request_):
    start(request_)
    file = request_.out / "records.jsonl"
    file.write_bytes(file.read_bytes()[:-100])
    code, printed = start(request_, resume=True)
    assert code == 0 and "warning:" in printed and "moved it to records.jsonl.broken" in printed
    assert len(ids_on_file(request_)) == len(set(ids_on_file(request_))) == 12


def test_a_failed_check_is_stored_and_the_sweep_goes_on(fakes, request_):
    def one_wrong(specs, device, report=None):
        for spec in specs:
            yield spec, body_of(spec, valid=not (spec.scene == "sponza" and spec.variant.tracer == "embree"))

    fakes(one_wrong)
    code, printed = start(request_)
    assert code == 1 and len(ids_on_file(request_)) == 12
    assert printed.count("check failed: 3 missed (against embree), no rate") == 2
    assert "12 runs: 10 valid, 2 failed the check and have no rate" in printed
    assert start(request_, resume=True)[0] == 1, "a resumed sweep must not forget the failure"


@pytest.mark.parametrize("error", [DefrayError("grid needs 20 GiB"), RuntimeError("out of\nresources")])
def test_an_error_in_one_run_costs_only_that_run(fakes, request_, error):
    def one_breaks(specs, device, report=None):
        for spec in specs:
            report(SimpleNamespace(spec=spec, stage="warm-up", done=0.0))
            if spec.scene == "sponza" and spec.variant.options:
                raise error
            yield spec, body_of(spec)

    fakes(one_breaks)
    code, printed = start(request_)
    assert code == 1 and len(ids_on_file(request_)) == len(set(ids_on_file(request_))) == 10
    assert "2 could not run" in printed and len(printed.splitlines()) == 13
    stored = [json.loads(line) for line in (request_.out / "errors.jsonl").read_text().splitlines()]
    assert {entry["spec"]["scene"] for entry in stored} == {"sponza"}
    assert all(str(error).split("\n")[0] in entry["error"] for entry in stored)
    fakes(fake_run_group)
    assert start(request_, resume=True)[0] == 0 and len(ids_on_file(request_)) == 12


def test_an_error_of_the_group_fails_all_its_runs(fakes, request_):
    def no_grid(specs, device, report=None):
        report(SimpleNamespace(spec=None, stage="building grid", done=0.0))
        if specs[0].grid.leaf == 64:
            raise DefrayError("grid needs 20 GiB")
        yield from fake_run_group(specs, device, report)

    fakes(no_grid)
    code, printed = start(request_)
    assert code == 1 and len(ids_on_file(request_)) == 6
    assert printed.count("error: grid needs 20 GiB") == 6


def test_an_unwritable_folder_is_one_line(fakes, request_):
    blocked = request_.out.with_name("a-file")
    blocked.write_text("")
    with pytest.raises(DefrayError, match=r"cannot write to .*a-file"):
        start(request_, out=blocked / "out")


def test_the_bar_shows_on_a_terminal(fakes, request_, tmp_path):
    with open(tmp_path / "terminal", "w+") as printed:
        console = Console(file=printed, force_terminal=True, width=120)
        assert sweep.run_sweep(request_, console) == 0
        printed.seek(0)
        text = printed.read()
    assert "left" in text and "12 runs: 12 valid" in text
