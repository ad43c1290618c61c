"""The paper's claims as a file, on a page, in the terminal and beside the history of their rules."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace

import pytest
from made_up_claims import SCENES, results, speedups

from harness.claims import history, judge_all, read_claims, write_claims
from harness.claims.judge import VERDICTS
from harness.claims.model import FILE
from harness.claims.rules import rule_types
from harness.commands.claims import claims_table
from harness.errors import DefrayError
from harness.report.claims_section import claims_html


def test_the_papers_claims_use_every_type_of_rule_and_all_get_a_verdict():
    scenes, claims = read_claims()
    assert scenes == SCENES and len(claims) >= 20
    used = {rule.type for claim in claims for rule in claim.rule}
    assert used == {kind.model_fields["type"].annotation.__args__[0] for kind in rule_types()}
    judged = judge_all(results(speedups((3, 4, 5, 6, 7))))
    assert all(one.verdict in VERDICTS for one in judged)
    assert all(one.reason for one in judged if one.verdict == "not attempted")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('kind = "ratio"', 'kind = "guess"'), "kind"),
        (("at_least = 20", "at_least = 20, at_most = 3"), "one of at_least"),
        (('seconds = "intersect"', 'seconds = "breakfast"'), "traverse"),
        (('id = "speedup-20x-whole"', 'id = "speedup-20x-intersection"'), "twice"),
        (("[[claim.rule]]", "[[claim.rules]]"), "rule"),
        (("[[claim]]", "[[claim"), "cannot read claims"),
    ],
)
def test_a_wrong_file_is_one_clear_line(tmp_path, change, message):
    file = tmp_path / "claims.toml"
    file.write_text(FILE.read_text(encoding="utf-8").replace(*change, 1), encoding="utf-8")
    with pytest.raises(DefrayError, match=message) as caught:
        read_claims(file)
    assert "\n" not in str(caught.value)


def test_verdicts_are_written_and_shown(tmp_path):
    made = speedups((3, 4, 5, 6, 7))
    made = [one | {"machine": one["machine"] | {"device": "a <device>"}} for one in made]
    runs = replace(results(made, tmp_path), device="a <device>")
    judged = judge_all(runs)
    write_claims(judged, runs, tmp_path / "claims.json")
    stored = json.loads((tmp_path / "claims.json").read_text(encoding="utf-8"))
    assert sum(stored["verdicts"].values()) == len(stored["claims"]) == len(judged)
    first = stored["claims"][0]
    assert first["verdict"] == "shape only" and first["rules"][0]["geometric_mean"]["median"] == pytest.approx(
        (3 * 4 * 5 * 6 * 7) ** 0.2
    )
    assert first["records"] and first["stand_ins"] and "≥ 20 on a scene" in first["threshold"]
    page = claims_html([("", judged)])
    assert page.count('class="verdict"') == len(judged) and "by up to 20X, in apples to apples" in page
    assert claims_table(judged, runs.device).row_count == len(judged)


def test_a_rule_that_is_younger_than_its_runs_is_told(tmp_path):
    def git(*arguments):
        subprocess.run(
            ["git", "-C", tmp_path, "-c", "user.name=a", "-c", "user.email=a@b", *arguments],
            check=True,
            capture_output=True,
        )
        return subprocess.run(
            ["git", "-C", tmp_path, "rev-parse", "HEAD"], capture_output=True, text=True, check=False
        ).stdout.strip()

    git("init", "--quiet")
    before = git("commit", "--allow-empty", "-m", "nothing")
    file = tmp_path / history.FILE
    file.parent.mkdir(parents=True)
    file.write_text(FILE.read_text(encoding="utf-8"), encoding="utf-8")
    git("add", ".")
    after = git("commit", "-m", "rules")
    claim = "speedup-20x-whole"
    assert history.rule_before_run(claim, {after}, file, tmp_path) is True
    assert history.rule_before_run(claim, {after, before}, file, tmp_path) is False
    assert history.rule_before_run(claim, {"f" * 40}, file, tmp_path) is None
    assert history.rule_before_run(claim, set(), file, tmp_path) is None
    changed = tmp_path / "changed.toml"
    changed.write_text(FILE.read_text(encoding="utf-8").replace("at_least = 20", "at_least = 2"), encoding="utf-8")
    assert history.rule_before_run(claim, {after}, changed, tmp_path) is False
    assert history.rule_before_run("sort-rate", {after}, changed, tmp_path) is True


def test_the_command_prints_a_table_or_json(tmp_path):
    from made_up_report import deferred, make_folder
    from typer.testing import CliRunner

    from harness.commands.main import app

    make_folder(tmp_path, [deferred("sponza")])
    table = CliRunner().invoke(app, ["claims", str(tmp_path)])
    assert table.exit_code == 0 and "The paper's claims on pthread-test" in table.stdout
    assert "not attempted" in table.stdout and "48 operations" in table.stdout
    shown = CliRunner().invoke(app, ["claims", str(tmp_path), "--json"])
    document = json.loads(shown.stdout)
    assert {one["id"] for one in document["claims"]} == {claim.id for claim in read_claims()[1]}
    empty = CliRunner().invoke(app, ["claims", str(tmp_path / "nothing")])
    assert empty.exit_code != 0
