"""Records: the schema is strict, and the file survives what a kill does to it."""

import copy
import json
import os
import subprocess
import sys

import pytest
from made_up_record import MACHINE, RATE, make_body, make_record, typed

from harness import files
from harness.errors import DefrayError
from harness.records.digest import digest_of, sealed
from harness.records.origin import finish
from harness.records.record_file import RecordFile
from harness.records.run_row import Record, RunBody
from harness.records.schema import SCHEMA, Machine, checked
from harness.spec.run_spec import RunSpec, Variant
from harness.spec.structure import Uniform


def leaves(value, path=()):
    """Paths of all keys of nested objects."""
    for key, inner in value.items():
        yield (*path, key)
        if isinstance(inner, dict) and key not in (
            "spec",
            "options",
            "versions",
            "environment",
        ):
            yield from leaves(inner, (*path, key))


def holder(record: dict, path: tuple) -> dict:
    """The object that holds the last key of `path`."""
    for key in path[:-1]:
        record = record[key]
    return record


@pytest.fixture
def file(tmp_path):
    warnings = []
    made = RecordFile(tmp_path / "records.jsonl", warn=warnings.append)
    made.warnings = warnings
    return made


def write(file, *records) -> None:
    """Put records on file as they are, each with the digest that its content has."""
    file.path.write_text("".join(json.dumps(sealed(record)) + "\n" for record in records))


@pytest.mark.parametrize("path", list(leaves(make_record())), ids=".".join)
def test_every_key_is_needed_and_no_other_allowed(path):
    missing = copy.deepcopy(make_record())
    del holder(missing, path)[path[-1]]
    with pytest.raises(DefrayError, match=r"here: .*(missing key|schema None)"):
        checked(Record, missing, "here")
    extra = copy.deepcopy(make_record())
    holder(extra, path)[path[-1] + "s_"] = 1
    if path[:1] not in (("spec",), ("options",)):
        with pytest.raises(DefrayError, match=f"{path[-1]}s_: unknown key"):
            checked(Record, extra, "here")


def test_an_invalid_run_must_not_have_a_rate():
    with pytest.raises(DefrayError, match="must not have a rate"):
        typed(valid=False)
    nothing = {"traverse": None, "intersect": None, "total": None}
    assert typed(valid=False, rate=nothing).valid is False


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_numbers_must_be_finite(file, number):
    rate = {"traverse": None, "intersect": None, "total": {**RATE, "low": number}}
    with pytest.raises(DefrayError, match="finite"):
        typed(rate=rate)
    record = typed()
    record.samples.total.append(number)  # after it was made
    with pytest.raises(DefrayError, match=r"new record: samples\.total\.1: .*finite"):
        file.append(record)
    with pytest.raises(DefrayError, match="not finite"):
        files.append_line(file.path, {"value": number})
    assert file.read() == []


def test_finish_adds_what_the_pipeline_does_not_know():
    spec = RunSpec(
        scene="sponza",
        variant=Variant.parse("deferred:ray-space"),
        structure=Uniform(),
        view="door",
    )
    asked = {"view": "door", "repetitions": 1, "spec": spec.model_dump(mode="json")}
    body = RunBody.model_validate(make_body() | asked)
    done = finish(Record, body, Machine(**MACHINE), id=spec.id)
    assert done.id == spec.id and done.schema_ == SCHEMA and done.view == "door"
    assert RunSpec.model_validate(done.spec).id == spec.id
    assert checked(Record, json.loads(json.dumps(done.as_json())), "here") == done
    body.samples.total.append(float("nan"))
    with pytest.raises(DefrayError, match=r"a row of sponza: samples\.total\.1: .*finite"):
        finish(Record, body, Machine(**MACHINE), id=spec.id)


def test_commit_is_unknown_outside_a_checkout(monkeypatch, tmp_path):
    files.commit_and_dirty.cache_clear()
    monkeypatch.setattr(files, "ROOT", tmp_path)
    assert files.commit_and_dirty() == ("unknown", False)
    files.commit_and_dirty.cache_clear()


def test_append_then_read(file):
    for identity in ("a", "b"):
        file.append(typed(identity))
    assert [record.id for record in file.read()] == ["a", "b"]
    assert file.read()[0] == typed("a")
    assert json.loads(file.path.read_text().splitlines()[0]) == sealed(typed("a").as_json())
    assert file.warnings == []


def test_a_missing_file_has_no_records(file):
    assert file.read() == [] and file.repair() == [] and not file.path.exists()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"rate": {**make_body()["rate"], "total": {**RATE, "median": 2e6}}}, "edited after it was written"),
        ({"tracer": "forward"}, "edited after it was written"),
        ({"digest": "0" * 64}, "edited after it was written"),
        ({"digest": None}, "edited after it was written"),
    ],
)
def test_a_record_edited_after_it_was_written_is_refused_by_name(file, changes, reason):
    file.append(typed("a"))
    file.append(typed("b"))
    first, second = map(json.loads, file.path.read_text().splitlines())
    file.path.write_text("".join(json.dumps(row) + "\n" for row in (first, {**second, **changes})))
    with pytest.raises(DefrayError, match=rf"line 2 \(id b, sponza .*\): {reason}"):
        file.read()


def test_a_record_without_a_digest_is_refused_by_name(file):
    file.path.write_text(json.dumps(make_record("a")) + "\n")
    with pytest.raises(DefrayError, match=r"\(id a, sponza deferred:ray-space\): has no digest"):
        file.read()


def test_a_digest_does_not_depend_on_the_order_of_keys_nor_on_being_there(file):
    record = make_record("a")
    assert digest_of(dict(reversed(record.items()))) == digest_of(record) == digest_of(sealed(record))
    write(file, dict(reversed(record.items())))
    file.append(file.read()[0])
    digests = [json.loads(line)["digest"] for line in file.path.read_text().splitlines()]
    assert digests[0] == digest_of(record) and digests[1] == digest_of(typed("a").as_json())


def test_a_rate_without_a_check_is_refused_by_name(file):
    agreement = {**make_body()["agreement"], "reference": "none"}
    write(file, make_record("a", agreement=agreement))
    with pytest.raises(DefrayError, match=r"\(id a, .*\): a run that was not checked must not be valid"):
        file.read()


def test_a_record_of_another_schema_is_refused(file):
    write(file, make_record("a", schema=1))
    with pytest.raises(DefrayError, match=r"schema 1, but .* schema 2"):
        file.read()


@pytest.mark.parametrize("kept", [1, 10, -2])
def test_a_torn_last_line_is_set_aside(file, kept):
    file.append(typed("a"))
    whole = file.path.read_bytes()
    torn = whole[:-1][:kept]
    file.path.write_bytes(whole + torn)
    assert [record.id for record in file.read()] == ["a"]
    assert file.path.read_bytes() == whole + torn, "reading must not change the file"
    assert [record.id for record in file.repair()] == ["a"]
    assert file.path.read_bytes() == whole
    assert (file.path.parent / "records.jsonl.broken").read_bytes() == torn + b"\n"
    assert len(file.warnings) == 2 and all("\n" not in message for message in file.warnings)
    file.append(typed("b"))
    assert [record.id for record in file.read()] == ["a", "b"]


def test_a_lost_newline_is_put_back(file):
    file.append(typed("a"))
    whole = file.path.read_bytes()
    file.path.write_bytes(whole[:-1])
    assert len(file.repair()) == 1
    assert file.path.read_bytes() == whole
    assert file.warnings == []


def test_damage_elsewhere_names_file_and_line(file):
    for identity in ("a", "b", "c"):
        file.append(typed(identity))
    lines = file.path.read_text().splitlines()
    file.path.write_text("\n".join([lines[0], lines[1][:50], lines[2]]) + "\n")
    with pytest.raises(DefrayError, match=r"records\.jsonl, line 2: not JSON"):
        file.repair()
    write(file, make_record("a"), make_record("b", schema=9))
    with pytest.raises(DefrayError, match=r"line 2 \(id b, sponza .*\): schema 9, but this version reads schema 2$"):
        file.read()
    bad = make_record("c")
    del bad["dirty"]
    write(file, bad)
    with pytest.raises(DefrayError, match=r"line 1 \(id c, .*\): dirty: missing key"):
        file.read()
    file.path.write_text("[1]\n")
    with pytest.raises(DefrayError, match="line 1: not a JSON object"):
        file.read()


def test_unwritable_place_is_one_line(tmp_path):
    with pytest.raises(DefrayError, match=r"cannot write .*records\.jsonl") as caught:
        RecordFile(tmp_path / "absent" / "records.jsonl").append(typed())
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_is_one_line():
    with pytest.raises(DefrayError, match="cannot write /dev/full"):
        files.append_line("/dev/full", {"a": 1})


def test_command_line_hides_the_installation(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["/some/where/bin/defray", "trace", "my scene.obj"])
    assert files.command_line() == "defray trace 'my scene.obj'"


def test_importing_records_needs_no_opencl():
    code = "import sys, harness.records.record_file; sys.exit('pyopencl' in sys.modules or 'pandas' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
