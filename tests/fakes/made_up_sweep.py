"""A small sweep whose runs are made up: no scene is loaded, no device is opened."""

from __future__ import annotations

from types import SimpleNamespace

from made_up_record import MACHINE, make_body
from rich.console import Console

from harness.campaign import sweeps as sweep
from harness.records.record_file import RecordFile
from harness.records.run_row import RunBody
from harness.records.schema import Machine
from harness.spec.run_spec import RunSpec

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


def fake_run_group(specs, scenes, report=None):
    """Yield a body per spec, last one first."""
    for number, spec in enumerate(reversed(specs)):
        report(SimpleNamespace(spec=spec, stage="repetition 1 of 2", done=number / len(specs)))
        yield spec, body_of(spec)


def install_fakes(monkeypatch, run_group=fake_run_group) -> None:
    """Put fakes in place of the pipeline, the device and the scenes."""
    replaced = {
        "studies.runs.run_group": run_group,
        "commands.measuring.run_group": run_group,
        "campaign.sweeps.open_device": lambda part: None,
        "commands.reproduce.open_device": lambda part: None,
        "commands.measuring.open_device": lambda part: None,
        "commands.views.open_device": lambda part: None,
        "campaign.executors.machine_description": lambda device: Machine(**MACHINE),
        "studies.runs.machine_description": lambda device: Machine(**MACHINE),
        "commands.measuring.machine_description": lambda device: Machine(**MACHINE),
        "campaign.executors.environment_description": lambda device: dict(MACHINE),
        "commands.scenes.list_scenes": list,
    }
    for name, value in replaced.items():
        monkeypatch.setattr(f"harness.{name}", value)


def start(request, **changes) -> tuple[int, str]:
    """Run a sweep; exit code and what it printed."""
    for key, value in changes.items():
        setattr(request, key, value)
    with open(request.file.with_name("printed"), "w+") as printed:
        code = sweep.run_sweep(request, Console(file=printed)).code
        printed.seek(0)
        return code, printed.read()


def ids_on_file(request) -> list[str]:
    return [record.id for record in RecordFile(request.out / "records.jsonl").read()]
