"""The command line: what it prints, its exit codes, and one line for every mistake."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from made_up_record import MACHINE, typed
from made_up_sweep import TIER, body_of, fake_run_group, install_fakes

from harness.commands import main as cli
from harness.commands import options
from harness.errors import DefrayError
from harness.records.record_file import RecordFile
from harness.records.schema import Machine

ROOT = Path(__file__).resolve().parents[2]
NO_DEVICE = ("device", "platform", "driver")  # of a machine without OpenCL


@pytest.fixture
def defray(monkeypatch, capsys):
    """Run the command with a fake pipeline; `defray(...)` returns exit code, stdout and stderr."""
    install_fakes(monkeypatch)

    def run(*arguments: str, pipeline=None) -> tuple[int, str, str]:
        if pipeline:
            monkeypatch.setattr("harness.commands.measuring.run_group", pipeline)
        monkeypatch.setattr(sys, "argv", ["defray", *arguments])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        printed = capsys.readouterr()
        return stopped.value.code or 0, printed.out, printed.err

    return run


def failing_run_group(specs, device, report=None):
    """All checks fail."""
    for spec in specs:
        yield spec, body_of(spec, valid=False)


def test_help_is_fast_and_light():
    heavy = "('pyopencl', 'pandas', 'trimesh', 'matplotlib', 'pydantic')"
    code = f"import sys, harness.commands.main; sys.exit(str([m for m in {heavy} if m in sys.modules] or ''))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


@pytest.mark.parametrize("command", ["", "doctor", "scenes", "trace", "compare", "sweep", "report"])
def test_every_command_has_help(defray, command):
    code, out, _ = defray(*command.split(), "--help")
    assert code == 0 and "Usage: defray" in out


def test_trace_prints_one_record_as_json(defray):
    code, out, _ = defray("trace", "sponza", "--rays", "64k", "--option", "wave=8", "--json")
    record = json.loads(out)
    assert code == 0 and out.count("\n") == 1
    assert record["spec"]["rays"] == 64_000
    assert record["spec"]["variant"] == {
        "tracer": "deferred",
        "intersector": "ray-space",
        "options": {"wave": "8"},
    }
    assert record["spec"]["grid"] == {"top": 8, "leaf": 128, "reading": "total"}


def test_trace_prints_a_table(defray):
    code, out, _ = defray("trace", "sponza")
    assert code == 0 and "Mrays/s" in out and "against embree" in out and "deferred:ray-space" in out


def test_trace_without_a_grid(defray):
    code, out, _ = defray("trace", "sponza", "--tracer", "embree", "--json")
    assert code == 0 and json.loads(out)["spec"]["grid"] is None


def test_trace_own_rays(defray, tmp_path):
    rays = tmp_path / "rays.npz"
    rays.write_bytes(b"")
    code, out, _ = defray("trace", "sponza", "--ray-file", str(rays), "--json")
    assert code == 0 and json.loads(out)["spec"]["kind"] == "file"


def test_a_failed_check_exits_1_and_still_prints_the_record(defray):
    code, out, error = defray("trace", "sponza", "--json", pipeline=failing_run_group)
    assert code == 1 and json.loads(out)["valid"] is False and json.loads(out)["rate"]["total"] is None
    assert error.startswith("error: check failed: sponza deferred:ray-space: 3 missed (against embree)")
    code, out, _ = defray("trace", "sponza")
    assert code == 1 and "no rate" in out and "Mrays/s" not in out


def test_compare(defray):
    arguments = ["compare", "deferred", "forward:moller-trumbore", "embree", "--scenes", "sponza,crown"]
    code, out, _ = defray(*arguments, "--json")
    results = json.loads(out)
    assert code == 0 and [result["scene"]["name"] for result in results] == ["sponza", "crown"]
    rows = results[0]["rows"]
    assert [row["variant"] for row in rows] == ["deferred:ray-space", "forward:moller-trumbore", "embree"]
    assert rows[0]["ratio"] is None and rows[1]["ratio"] == {"median": 1.0, "low": 1.0, "high": 1.0}
    code, out, _ = defray(*arguments)
    assert code == 0 and "1 (base)" in out and "1 (1–1)" in out and "crown" in out


def test_compare_ratio_is_of_rates_not_times(defray):
    def forward_is_slower(specs, device, report=None):
        for spec in specs:
            body = body_of(spec)
            slow = 4 if spec.variant.tracer == "forward" else 1
            body.samples.total = [slow * second for second in (0.1, 0.2, 0.15, 0.12, 0.11)]
            yield spec, body

    code, out, _ = defray("compare", "deferred", "forward", "--json", pipeline=forward_is_slower)
    row = json.loads(out)[0]["rows"][1]
    assert code == 0 and row["ratio"]["median"] == pytest.approx(0.25) and row["p_value"] < 0.05


def test_compare_without_a_valid_base(defray):
    def base_fails(specs, device, report=None):
        for spec in specs:
            yield spec, body_of(spec, valid=spec.variant.tracer != "deferred")

    code, out, _ = defray("compare", "deferred", "forward", "--json", pipeline=base_fails)
    assert code == 1 and json.loads(out)[0]["rows"][1]["ratio"] is None
    code, out, _ = defray("compare", "deferred", "forward")
    assert code == 1 and "check failed" in out


def test_scenes(defray, monkeypatch):
    status = SimpleNamespace(
        name="sponza", triangles=279_163, source="real", origin="a place", licence="CC BY", paper=True
    )
    monkeypatch.setattr("harness.commands.scenes.list_scenes", lambda: [status])
    code, out, _ = defray("scenes")
    assert code == 0 and "279,163" in out and "a place" in out


def test_scenes_fetch_asks_for_a_licence_unless_told_yes(defray, monkeypatch):
    asked = []
    monkeypatch.setattr("harness.commands.scenes.run_fetch", lambda name, yes: asked.append((name, yes)) or 1)
    assert defray("scenes", "fetch", "sponza")[0] == 1 and defray("scenes", "fetch", "all", "--yes")[0] == 1
    assert asked == [("sponza", False), ("all", True)]


def test_large_scenes_are_announced_before_they_are_loaded(defray, monkeypatch, tmp_path):
    monkeypatch.delenv("DEFRAY_SCENES", raising=False)  # real scenes are not enlarged
    monkeypatch.setenv("DEFRAY_CACHE", str(tmp_path))
    code, _, error = defray("trace", "san-miguel@1/4", "--rays", "1k")
    assert code == 0 and "main memory" not in error
    code, _, error = defray("compare", "deferred", "forward", "--scenes", "crown@4,sponza")
    assert "crown@4: about 14,131,784 triangles, 1.1 GiB on the device, 3.8 GiB of main memory" in error


def test_sweep_and_report(defray, tmp_path, monkeypatch):
    file, out_folder = tmp_path / "a.toml", tmp_path / "out"
    file.write_text(TIER)
    arguments = ["sweep", str(file), "--tier", "small", "--out", str(out_folder)]
    code, _, error = defray(*arguments)
    assert code == 0 and "12 runs: 12 valid" in error
    code, _, error = defray(*arguments)
    assert code == 2 and "pass --resume" in error
    assert defray(*arguments, "--resume")[0] == 0
    monkeypatch.setattr("harness.commands.report.write_report", lambda folder: folder / "report.html")
    code, out, _ = defray("report", str(out_folder))
    assert code == 0 and out.strip() == str(out_folder / "report.html")


def test_views_are_of_the_files_that_were_measured(defray, tmp_path, monkeypatch):
    record = typed(view="inside")
    record.scene.name, record.spec["scene"] = "bunny", "meshes/bunny.ply"
    RecordFile(tmp_path / "records.jsonl").append(record)
    drawn = {}
    monkeypatch.setattr(
        "harness.commands.views.write_views", lambda folder, scenes, device: drawn.update(scenes) or [folder]
    )
    code, out, _ = defray("views", str(tmp_path))
    assert code == 0 and out.strip() == str(tmp_path / "views")
    assert drawn == {"bunny": "meshes/bunny.ply"}


def test_doctor_passes_its_exit_code_on(defray, monkeypatch):
    monkeypatch.setattr("harness.commands.doctor.run_doctor", lambda json: 1 if json else 0)
    assert defray("doctor")[0] == 0
    assert defray("doctor", "--json")[0] == 1


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("trace sponza --rays 0", "a count must be above zero, not '0'"),
        ("trace sponza --rays many", "'many' is not a count; write 64k, 1M or 1000000"),
        ("trace sponza --structure 8/100", "96 or 104 would do"),
        ("trace sponza --grid adaptive=2", "'adaptive=2' is not a structure; write"),
        ("trace sponza --kind soft", "unknown kind of rays 'soft'; known: ambient-occlusion"),
        ("trace sponza --kind file", "need a ray file"),
        ("trace sponza --ray-file nowhere.npz", "ray file 'nowhere.npz' does not exist"),
        ("trace sponza --tracer deferd", "unknown tracer 'deferd'; known: brute, deferred"),
        ("trace sponza --intersector ray", "unknown intersector 'ray'; known: baldwin-weber"),
        ("trace sponza --option wave", "--option 'wave' is not of the form key=value"),
        ("trace sponza --option wav=8", "unknown option of tracer deferred 'wav'; known: arrange"),
        ("trace sponza --tracer embree --intersector ray-space", "has its own intersector"),
        ("trace sponza --check twice", "unknown check 'twice'; known: embree, exact, none"),
        ("compare deferred", "two variants or more"),
        ("compare deferred deferred:ray-space", "named twice"),
        ("compare deferred embree --scenes ,", "names no scene"),
        ("sweep nowhere.toml --out out", "cannot read nowhere.toml: No such file or directory"),
        ("report nowhere", "nowhere has no records.jsonl; run a sweep first"),
    ],
)
def test_each_mistake_is_one_line_and_exit_2(defray, command, message):
    code, out, error = defray(*command.split())
    assert code == 2 and out == "" and message in error
    assert error.startswith("error: ") and error.count("\n") == 1


def test_usage_errors_exit_2(defray):
    for command in (["trace"], ["trace", "sponza", "--repetitions", "0"], ["fly"]):
        code, _, error = defray(*command)
        assert code == 2 and "Traceback" not in error


def test_an_unwritable_folder(defray, tmp_path):
    file = tmp_path / "a.toml"
    file.write_text(TIER)
    code, _, error = defray("sweep", str(file), "--tier", "small", "--out", str(file / "out"))
    assert code == 2 and error.startswith("error: cannot write to ") and error.count("\n") == 1


@pytest.mark.parametrize(
    ("raised", "code", "message"),
    [
        (DefrayError("no working OpenCL device (none); install PoCL"), 2, "error: no working OpenCL device"),
        (ZeroDivisionError("a\nfault"), 2, "error: ZeroDivisionError: a fault (a fault in defray"),
        (
            PermissionError(13, "Permission denied", "out/report.html"),
            2,
            "error: cannot use out/report.html: Permission denied\n",
        ),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_no_exception_reaches_the_user(defray, raised, code, message):
    def broken(specs, device, report=None):
        raise raised
        yield

    found, out, error = defray("trace", "sponza", pipeline=broken)
    assert (found, out) == (code, "") and message in error and "Traceback" not in error


def test_progress_stays_off_standard_output(defray):
    _, out, _ = defray("trace", "sponza", "--json", pipeline=fake_run_group)
    json.loads(out)


def test_red_only_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.delenv("NO_COLOR", raising=False)
    options.print_error("wrong")
    assert capsys.readouterr().err == "\033[31merror:\033[0m wrong\n"


def unchecked_run_group(specs, device, report=None):
    """Runs that nobody asked to check."""
    for spec in specs:
        yield spec, body_of(spec, valid=False, reference="none")


def test_a_run_that_asked_for_no_check_has_no_rate_and_has_not_failed(defray):
    code, out, error = defray("trace", "sponza", "--check", "none", pipeline=unchecked_run_group)
    assert code == 0 and error == ""
    assert "not checked, hence no rate" in out and "failed" not in out


def test_embree_needs_no_device(defray, monkeypatch):
    def no_device(part):
        raise DefrayError("no working OpenCL device")

    monkeypatch.setattr("harness.commands.measuring.open_device", no_device)
    monkeypatch.setattr(
        "harness.commands.measuring.machine_description", lambda _: Machine(**MACHINE | dict.fromkeys(NO_DEVICE))
    )
    code, out, _ = defray("trace", "sponza", "--tracer", "embree")
    assert code == 0 and "a cpu" in out and "None" not in out
    code, _, error = defray("trace", "sponza")
    assert code == 2 and "no working OpenCL device" in error


@pytest.mark.parametrize("command", ["views", "report"])
def test_a_folder_without_records_is_refused_and_left_alone(defray, tmp_path, command):
    code, _, error = defray(command, str(tmp_path / "none"))
    assert code == 2 and "has no records.jsonl; run a sweep first" in error
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    "arguments", ["trace", "trace sponza --seed 3.5", "trace sponza --colour red", "trase sponza", "sweep x.toml"]
)
def test_a_mistyped_command_line_is_one_line(defray, arguments):
    code, out, error = defray(*arguments.split())
    assert code == 2 and out == ""
    assert error.startswith("error: ") and error.count("\n") == 1 and "--help' explains" in error


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("trace sponza --rays 1.5", "not a count"),
        ("trace sponza --rays 10G", "less than or equal to 1000000000"),
        ("trace sponza --seed 99999999999999999999999", "seed"),
        ("trace sponza --option wave=99999999999", "from 1 to 4096"),
        ("trace sponza --option batch=7", "batch"),
        ("trace sponza --structure 1000/1000", "at most 256 top cells"),
        ("compare deferred embree --scenes sponza,nope", "unknown scene 'nope'"),
    ],
)
def test_what_cannot_be_meant_is_refused_before_anything_runs(defray, arguments, message):
    code, _, error = defray(*arguments.split())
    assert code == 2 and message in error and error.count("\n") == 1
