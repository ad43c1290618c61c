"""Sweeps that are killed or stopped, in a process of their own: what is kept, what is said, and the lock."""

import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from made_up_sweep import ids_on_file, start

from harness.campaign import plan
from harness.errors import DefrayError

ROOT = Path(__file__).resolve().parents[2]
SLOW_SWEEP = """
    import sys, time
    sys.path[:0] = {paths!r}
    import pytest
    from made_up_sweep import fake_run_group, install_fakes
    from pathlib import Path
    from harness.campaign import sweeps as sweep
    from harness.errors import DefrayError

    def slow(specs, device, report):
        for result in fake_run_group(specs, device, report):
            time.sleep(0.1)
            yield result

    install_fakes(pytest.MonkeyPatch(), slow)
    try:
        sys.exit(sweep.run_sweep(sweep.SweepRequest(Path({file!r}), "small", Path({out!r}), {resume})).code)
    except DefrayError as error:
        sys.exit(f"error: {{error}}")
"""


def spawn(request, resume=False) -> subprocess.Popen:
    code = textwrap.dedent(SLOW_SWEEP).format(
        paths=sys.path, file=str(request.file), out=str(request.out), resume=resume
    )
    return subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)


def wait_for_records(request, count: int, process: subprocess.Popen) -> None:
    """Until `count` records are on file; fails when the process ends before."""
    deadline = time.monotonic() + 60
    file = request.out / "records.jsonl"
    while not (file.exists() and file.read_bytes().count(b"\n") >= count):
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_kill_then_resume_loses_and_repeats_nothing(fakes, request_):
    wanted = 0
    for attempt in range(3):
        wanted += 2
        with spawn(request_, resume=attempt > 0) as process:
            wait_for_records(request_, wanted, process)
            before = ids_on_file(request_)
            process.send_signal(signal.SIGKILL)
            process.wait()
        assert ids_on_file(request_)[: len(before)] == before
    with open(request_.out / "records.jsonl", "ab") as file:
        file.write(b'{"schema": 1, "id": "to')  # what a kill inside the write leaves
    with spawn(request_, resume=True) as process:
        assert process.wait(60) == 0, process.stderr.read()
    assert sorted(ids_on_file(request_)) == sorted(spec.id for spec in plan.expand(request_.file, "small"))


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_stopping_says_how_to_resume(fakes, request_, number, code):
    with spawn(request_) as process:
        wait_for_records(request_, 2, process)
        process.send_signal(number)
        assert process.wait(60) == code
        printed = process.stderr.read()
    stored = len(ids_on_file(request_))
    last = printed.splitlines()[-1]
    assert last.startswith(f"stopped after {stored} of 12 runs; go on with: defray sweep ")
    assert last.endswith("--resume") and "Traceback" not in printed


def test_a_second_start_at_the_same_time_is_refused(fakes, request_):
    with spawn(request_) as process:
        wait_for_records(request_, 1, process)
        with pytest.raises(DefrayError, match="another measurement is writing to"):
            start(request_, resume=True)
        process.kill()
    assert start(request_, resume=True, seed=None)[0] == 0, "a killed sweep must not keep its lock"
