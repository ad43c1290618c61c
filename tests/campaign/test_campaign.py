"""Every study resumes, keeps failures apart and loses nothing to a kill; whoever is handed in measures."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import made_up_accuracy
import pytest
from made_up_campaign import ELSEWHERE, MACHINE, STUDIES, FakeExecutor, fake_scenes, tasks_of  # noqa: F401  (a fixture)
from rich.console import Console

from harness.campaign import runner
from harness.campaign.executors import Local, TaskFailed
from harness.campaign.plan import interleaved
from harness.errors import DefrayError
from harness.records.stability_row import StressRow
from harness.spec.run_spec import Variant
from harness.studies.runs import RunStudy
from harness.studies.stability.suite import StabilityStudy
from harness.studies.study import Step


def carried_out(study: str, out: Path, executor=None, resume: bool = True):
    """Outcome of the study's tasks, and what was printed."""
    with open(out.with_name("printed"), "w+") as printed:
        found = runner.run(
            tasks_of(study), executor or FakeExecutor(), out, resume, "the same command", Console(file=printed)
        )
        printed.seek(0)
        return found, printed.read()


def stored(study: str, out: Path) -> list[str]:
    """Ids on file."""
    of = tasks_of(study)[0].study
    return [of.id_of(row) for row in of.file(out, MACHINE).read()]


def wanted(study: str) -> list[str]:
    """Ids of all parts."""
    return [part.id for task in tasks_of(study) for part in task.parts]


@pytest.mark.parametrize("study", STUDIES)
def test_every_study_is_stored_and_resumes(tmp_path, study):
    out = tmp_path / "out"
    found, _ = carried_out(study, out, resume=False)
    assert found.code == 0 and len(found.rows) == len(wanted(study)) >= 2
    assert sorted(stored(study, out)) == sorted(wanted(study))
    idle = FakeExecutor()
    again, printed = carried_out(study, out, idle)
    of = tasks_of(study)[0].study
    assert idle.asked == [] and [of.id_of(row) for row in again.rows] == wanted(study)
    assert printed.startswith(f"{len(wanted(study))} {of.unit}: ") and len(printed.splitlines()) == 1


@pytest.mark.parametrize("study", STUDIES)
def test_only_what_is_missing_is_measured(tmp_path, study):
    out, tasks = tmp_path / "out", tasks_of(study)
    first = tasks[0].only(tasks[0].parts[:1])
    runner.run([first], FakeExecutor(), out, console=Console(quiet=True))
    executor = FakeExecutor()
    carried_out(study, out, executor)
    missing = [task.only(part for part in task.parts if part not in first.parts) for task in tasks]
    assert executor.asked == [task.id for task in missing if task.parts]
    assert sorted(stored(study, out)) == sorted(wanted(study)), "and nothing twice"


@pytest.mark.parametrize("study", ["sweep", "accuracy", "roofline", "stability"])
def test_a_part_that_fails_costs_no_other_its_row(tmp_path, study):
    out, failing = tmp_path / "out", "moller-trumbore, contraction on" if study == "stability" else "forward"
    found, printed = carried_out(study, out, FakeExecutor(failing))
    names = {part.id: part.name for task in tasks_of(study) for part in task.parts}
    failed = [identity for identity in wanted(study) if failing in names[identity]]
    assert found.code == 1 and found.failed == len(failed) >= 2
    assert sorted(stored(study, out)) == sorted(set(wanted(study)) - set(failed))
    errors = [json.loads(line) for line in (out / "errors.jsonl").read_text().splitlines()]
    assert sorted(error["id"] for error in errors) == sorted(failed)
    assert {(error["error"], error["study"]) for error in errors} == {("made to fail", study)}
    assert printed.count("error: made to fail") == len(failed) and "could not run (see" in printed
    assert carried_out(study, out)[0].code == 0, "and resuming measures it"
    assert (out / "errors.jsonl").read_text() == "", "what was measured since is no error"
    assert sorted(stored(study, out)) == sorted(wanted(study))


@pytest.mark.parametrize("study", STUDIES)
def test_a_task_that_fails_as_a_whole_costs_no_other_task_its_rows(tmp_path, study):
    out, (first, *_, last) = tmp_path / "out", tasks_of(study)
    executor = FakeExecutor(first.parts[0].name, blind=True)
    found, _ = carried_out(study, out, executor)
    assert found.code == 1 and found.failed == len(first.parts)
    assert {part.id for part in last.parts} <= set(stored(study, out))


def test_an_executor_that_returns_too_few_rows_is_a_failure(tmp_path):
    class Silent(FakeExecutor):
        def submit(self, task, tell=lambda _: None):
            return []

    found, printed = carried_out("accuracy", tmp_path / "out", Silent())
    assert found.code == 1 and found.rows == [] and "the study returned no row" in printed


@pytest.mark.parametrize(("study", "adds"), [(name, name not in ("sweep", "accuracy")) for name in STUDIES])
def test_without_resume_rows_are_added_or_refused(tmp_path, study, adds):
    out = tmp_path / "out"
    carried_out(study, out, resume=False)
    if not adds:
        with pytest.raises(DefrayError, match="already has records; pass --resume to go on"):
            carried_out(study, out, resume=False)
        return
    executor = FakeExecutor()
    found, _ = carried_out(study, out, executor, resume=False)
    assert len(executor.asked) == len(tasks_of(study)) and len(found.rows) == len(wanted(study))


@pytest.mark.parametrize("study", ["accuracy", "precision", "roofline", "coherence"])
def test_rows_of_another_device_or_geometry_do_not_stand(tmp_path, study, scenes):
    out = tmp_path / "out"
    carried_out(study, out)
    elsewhere = FakeExecutor()
    elsewhere.machine = ELSEWHERE
    carried_out(study, out, elsewhere)
    assert len(elsewhere.asked) == 2
    scenes["sha256"] = "cd" * 32
    changed = FakeExecutor()
    carried_out(study, out, changed)
    assert len(changed.asked) == 2


def test_results_of_another_device_are_no_suite_to_add_to(tmp_path):
    carried_out("stability", tmp_path / "out")
    elsewhere = FakeExecutor()
    elsewhere.machine = ELSEWHERE
    with pytest.raises(DefrayError, match="holds results of"):
        carried_out("stability", tmp_path / "out", elsewhere)


def test_nothing_is_stored_without_a_folder():
    tasks = tasks_of("stability")
    found = runner.run(tasks, FakeExecutor("W2"), None, console=Console(quiet=True))
    assert found.failed == 4 and len(found.rows) == sum(len(task.parts) for task in tasks) - 4


def test_a_fault_of_the_local_executor_names_part_and_place():
    class Broken(RunStudy):
        def measure(self, task, scenes, tell):
            tell(Step(task.parts[1].id, "measuring", 0.0))
            raise ZeroDivisionError("a\nfault")
            yield

    (task, *_) = Broken().tasks(list(interleaved("sponza", [Variant.parse("embree"), Variant.parse("brute")], [])), 1)
    with pytest.raises(TaskFailed) as caught:
        list(Local(None).submit(task))
    assert caught.value.part == task.parts[1].id and caught.value.message == "ZeroDivisionError: a fault"
    assert "ZeroDivisionError" in caught.value.traceback


# ---------------------------------------------------------------- killed and stopped

SLOW = """
    import sys
    sys.path[:0] = {paths!r}
    from pathlib import Path
    from types import SimpleNamespace
    from made_up_campaign import FakeExecutor, runner, tasks_of

    runner.load_scene = lambda name: SimpleNamespace(source="real", sha256="ab" * 32)
    sys.exit(runner.run(tasks_of({study!r}), FakeExecutor(wait=0.2), Path({out!r}), True, "the same command").code)
"""


def spawn(study: str, out: Path) -> subprocess.Popen:
    code = textwrap.dedent(SLOW).format(paths=sys.path, study=study, out=str(out))
    return subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)


def wait_for_rows(study: str, out: Path, count: int, process: subprocess.Popen) -> None:
    """Until `count` rows are on file; fails when the process ends before."""
    deadline = time.monotonic() + 60
    while not (out.exists() and len(stored(study, out)) >= count):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.parametrize("study", ["accuracy", "stability"])
def test_a_kill_between_rows_loses_nothing(tmp_path, study):
    out = tmp_path / "out"
    with spawn(study, out) as process:
        wait_for_rows(study, out, 2, process)
        process.send_signal(signal.SIGKILL)
        process.wait()
    before = stored(study, out)
    assert 2 <= len(before) < len(wanted(study))
    executor = FakeExecutor()
    assert carried_out(study, out, executor)[0].code == 0, "a killed campaign must not keep its lock"
    assert stored(study, out)[: len(before)] == before and sorted(stored(study, out)) == sorted(wanted(study))


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_stopping_says_how_to_go_on(tmp_path, number, code):
    out = tmp_path / "out"
    with spawn("accuracy", out) as process:
        wait_for_rows("accuracy", out, 2, process)
        process.send_signal(number)
        assert process.wait(60) == code
        last = process.stderr.read().splitlines()[-1]
    total, done = len(wanted("accuracy")), len(stored("accuracy", out))
    assert last == f"stopped after {done} of {total} variants; go on with: the same command"


# ---------------------------------------------------------------- what is a failure


@pytest.mark.parametrize(
    ("name", "family", "leaks", "kept"),
    [
        ("ray-space", "A1", None, False),  # the default promises to pass every family
        ("moller-trumbore", "W1", 900, True),  # which does not say that it is watertight
        ("woop-benthin-wald-kahan", "W1", 900, False),
        ("woop-benthin-wald-kahan", "A1", None, True),
    ],
)
def test_a_broken_promise_of_an_intersector_is_a_failure(name, family, leaks, kept):
    row = StressRow.model_validate(made_up_accuracy.stability((family,))["rows"][0] | {"intersector": name})
    study = StabilityStudy()
    assert study.passed(row)
    failed = row.model_copy(update={"passed": False, "leaks": leaks})
    assert study.passed(failed) is kept and (study.outcome(failed) is None) is kept


def test_a_row_that_is_not_valid_is_stored_and_fails(tmp_path):
    class Wrong(FakeExecutor):
        def submit(self, task, tell=lambda _: None):
            for row in super().submit(task, tell):
                yield row.model_copy(update={"valid": False, "seconds": [], "kernels": []})

    found, printed = carried_out("roofline", tmp_path / "out", Wrong())
    assert found.code == 1 and found.bad == len(found.rows) == len(wanted("roofline"))
    assert printed.count("check failed, no times") == found.bad and "0 valid, 4 failed the check" in printed
    assert carried_out("roofline", tmp_path / "out")[0].code == 1, "resuming does not forget it"
