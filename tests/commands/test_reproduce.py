"""`defray reproduce`: all parts resume, one's failure costs no other its result, then report and claims."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest
import typer
from made_up_campaign import STUDIES, FakeExecutor, fake_scenes  # noqa: F401  (a fixture)

from harness.campaign import reproduction
from harness.campaign.plan import expand
from harness.campaign.tasks import accuracy_scenes, coherence_tasks, roofline_tasks
from harness.commands import main as cli
from harness.commands import reproduce
from harness.errors import DefrayError
from harness.spec.stress_suite import size_of

TIER = """
[tiers.small]
sweep = { tier = "smoke" }
accuracy = { tier = "paper" }
stability = { intersector = "default", size = "smoke" }
coherence = { scenes = ["sponza", "conference"], rays = "8k" }
roofline = { scenes = ["sponza"], structure = "adaptive density=0.3", rays = "256k" }
"""
FILES = ("records.jsonl", "accuracy.jsonl", "precision.jsonl", "stability.json", "coherence.jsonl", "roofline.jsonl")
DRAWN = ["views", "report", "claims"]


@pytest.fixture
def here(tmp_path, monkeypatch, capsys):
    """Runs the command with fakes: `run(*arguments)` gives exit code and standard error; what was drawn is listed."""
    (tmp_path / "reproduce.toml").write_text(TIER)
    state = SimpleNamespace(executor=FakeExecutor(), drawn=[], out=tmp_path / "out", failing_to_draw=None)

    def load(name: str):
        def called(**arguments) -> None:
            assert arguments["folder"] == state.out
            state.drawn.append(name)
            if name == state.failing_to_draw:
                raise typer.Exit(1)

        return SimpleNamespace(callback=called)

    monkeypatch.setattr(reproduction, "TIERS", tmp_path / "reproduce.toml")
    monkeypatch.setattr("harness.campaign.tasks.contracts", lambda device: {"off": False, "on": True})
    monkeypatch.setattr(reproduce, "open_device", lambda part: SimpleNamespace(has_double=True))
    monkeypatch.setattr(reproduce, "Local", lambda device: state.executor)
    monkeypatch.setattr(reproduce, "load", load)

    def run(*arguments: str, tier: str = "small") -> tuple[int, str]:
        state.drawn.clear()
        monkeypatch.setattr(sys, "argv", ["defray", "reproduce", tier, "--out", str(state.out), *arguments])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        return stopped.value.code or 0, capsys.readouterr().err

    state.run = run
    return state


def test_every_part_is_measured_once_and_then_drawn_and_judged(here):
    code, printed = here.run()
    assert code == 0, printed
    assert all((here.out / name).stat().st_size for name in FILES) and here.drawn == DRAWN
    here.executor.asked.clear()
    assert here.run()[0] == 0 and here.executor.asked == [] and here.drawn == DRAWN


@pytest.mark.parametrize("lost", FILES)
def test_each_part_goes_on_by_itself(here, lost):
    here.run()
    (here.out / lost).unlink()
    here.executor.asked.clear()
    assert here.run()[0] == 0 and here.executor.asked and (here.out / lost).stat().st_size
    here.executor.asked.clear()
    here.run()
    assert here.executor.asked == []


@pytest.mark.parametrize("part", ["sweep", "accuracy", "precision", "stability", "coherence", "roofline"])
@pytest.mark.parametrize("error", [DefrayError("no such thing"), ZeroDivisionError("a\nfault")])
def test_a_part_that_cannot_run_costs_no_other_its_result(here, monkeypatch, part, error):
    def broken(*_):
        raise error

    with monkeypatch.context() as patch:
        patch.setitem(reproduction.PARTS, part, broken)
        code, printed = here.run()
    assert code == 2 and f"error: {part} failed (exit code 2); go on with: defray reproduce small" in printed
    assert printed.count("Traceback") == 0 and " ".join(str(error).split()) in printed
    missing = dict(zip(reproduction.PARTS, FILES, strict=False))[part]
    assert {name for name in FILES if not (here.out / name).exists()} == {missing}
    assert here.drawn == ([] if part == "sweep" else DRAWN), "a report needs records"
    assert here.run()[0] == 0 and (here.out / missing).exists()


def test_a_failed_run_is_reported_and_fails(here):
    here.executor = FakeExecutor("forward")
    code, printed = here.run()
    assert code == 1 and here.drawn == DRAWN
    assert [name for name in reproduction.PARTS if f"error: {name} failed (exit code 1)" in printed] == [
        "sweep",
        "accuracy",
        "roofline",
    ]


def test_what_is_stopped_is_not_followed_by_more(here, monkeypatch):
    def stopped(self, task, tell=lambda _: None):
        if task.study.name == "stability":
            raise KeyboardInterrupt
        return honest(self, task, tell)

    honest = FakeExecutor.submit
    monkeypatch.setattr(FakeExecutor, "submit", stopped)
    code, printed = here.run()
    assert code == 130 and here.drawn == [] and not (here.out / "coherence.jsonl").exists()
    last = printed.splitlines()[-1]
    assert last.startswith("stopped after 0 of ") and last.endswith(f"defray reproduce small --out {here.out}")


def test_a_machine_that_only_measures_neither_draws_nor_judges(here):
    assert here.run("--no-report")[0] == 0 and here.drawn == []


def test_a_report_that_fails_does_not_keep_the_claims(here):
    here.failing_to_draw = "report"
    code, printed = here.run()
    assert code == 1 and here.drawn == DRAWN and "error: report failed (exit code 1)" in printed


def test_an_unknown_tier_is_one_line(here):
    code, printed = here.run(tier="huge")
    assert code == 2 and printed == "error: unknown tier 'huge'; known: small\n" and not here.out.exists()


@pytest.mark.parametrize("tier", ["smoke", "paper", "full"])
def test_the_projects_own_tiers_can_be_measured(tier):
    parts = reproduction.read_tier(tier)
    assert expand(reproduction.SWEEPS, parts.sweep.tier)
    assert accuracy_scenes([], parts.accuracy.tier, None, None, None)
    assert size_of(parts.stability.size) == ("full" if tier == "full" else "smoke")
    counted = [parts.coherence, parts.roofline]
    assert all(counted) is (tier != "smoke")
    for settings, make in zip(counted, (coherence_tasks, roofline_tasks), strict=True):
        if settings:
            assert make(settings.scenes, rays=settings.rays, structure=settings.structure)


def test_fakes_stand_for_all_six_studies():
    assert {"sweep", "accuracy", "precision", "stability", "coherence", "roofline"} == set(STUDIES)
    assert set(reproduction.PARTS) == set(STUDIES)
