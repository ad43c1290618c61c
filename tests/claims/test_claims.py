"""Claims: each verdict can come out, intervals across a threshold decide nothing, reasons name what is missing."""

from __future__ import annotations

import json

import pytest
from made_up_claims import BASE, OURS, RATIO, SCENES, TRIANGLES, record, speedups, verdict

from harness.claims.judge import verdict_of
from harness.claims.outcome import Bound, Outcome, every, most, some
from harness.claims.rules.source_rule import Rule as SourceRule
from harness.claims.rules.source_rule import operations
from harness.errors import DefrayError
from harness.records.digest import sealed
from harness.records.schema import SCHEMA
from harness.records.stability_row import KernelRate
from harness.spec.intersectors import KERNELS, find
from harness.stats import Interval

TWICE = RATIO | {"full": {"at_least": 2, "on": "all"}, "shape": {"above": 1, "on": "all"}}
PEAK = RATIO | {"full": {"at_least": 20, "on": "any"}, "shape": {"at_least": 1, "on": "all"}}


@pytest.mark.parametrize(
    ("rule", "factors", "expected"),
    [
        (TWICE, (2.0, 3, 4, 5, 6), "reproduced"),
        (TWICE, (1.5, 3, 4, 5, 6), "shape only"),
        (TWICE, (0.9, 3, 4, 5, 6), "contradicted"),
        (TWICE, ((1.9, 2.0, 2.3), 3, 4, 5, 6), "inconclusive"),
        (TWICE, ((1.9, 2.0, 2.3), 0.5, 4, 5, 6), "contradicted"),
        (TWICE, ((0.9, 1.1, 1.2), 3, 4, 5, 6), "inconclusive"),
        (TWICE, (3, 4), "not attempted"),
        (PEAK, (2, 3, 21, 5, 6), "reproduced"),
        (PEAK, (2, 0.5, 21, 5, 6), "reproduced"),
        (PEAK, (2, 3, 4, 5, 6), "shape only"),
        (PEAK, (2, 3, 4, 0.5, 6), "contradicted"),
        (PEAK, (2, 3, (18.0, 20.0, 22.0), 5, 6), "inconclusive"),
    ],
)
def test_each_verdict_of_a_ratio(rule, factors, expected):
    judged = verdict(rule, speedups(factors))
    assert judged.verdict == expected
    if expected != "not attempted":
        finding = judged.outcomes[0].findings[0]
        assert finding.low <= finding.value <= finding.high
        assert set(finding.runs) == {f"{BASE} sponza 8/128 total 1000", f"{OURS} sponza 8/128 total 1000"}


def test_a_missing_scene_leaves_the_verdict_open_unless_the_others_decide_it():
    assert verdict(TWICE, speedups((3, 3, 3, 3))).verdict == "inconclusive"
    assert verdict(TWICE, speedups((3, 3, 3, 0.5))).verdict == "contradicted"
    assert verdict(PEAK, speedups((3, 3, 3, 30))).verdict == "reproduced"


def test_few_repetitions_tell_nothing_of_noise():
    judged = verdict(TWICE, speedups([(9.0, 9.0)] * 5))
    assert judged.verdict == "inconclusive" and "no interval" in judged.outcomes[0].findings[0].note


def test_no_records_is_not_attempted_with_the_reason():
    judged = verdict(TWICE, [])
    assert (judged.verdict, judged.reason) == ("not attempted", f"no run of {BASE} and {OURS}")
    some_scenes = verdict(TWICE, speedups((3, 3)))
    assert some_scenes.reason.startswith("2 of 5 scenes, 3 needed: no run of")
    assert "hairball, crown, san-miguel" in some_scenes.reason


def test_runs_that_failed_their_check_are_no_evidence_and_named():
    records = speedups((3, 3, 3, 3, 3))
    for one in records:
        if one["tracer"] == "deferred":
            one |= {"valid": False, "rate": dict.fromkeys(("traverse", "intersect", "total"))}
    judged = verdict(TWICE, records)
    assert judged.verdict == "not attempted" and f"{OURS} failed its check" in judged.reason


def test_exact_counts_need_no_repetitions():
    rule = {
        "type": "ratio",
        "of": {"variant": OURS, "count": "tests"},
        "to": {"variant": BASE, "count": "tests"},
        "full": {"above": 1, "on": "all"},
        "shape": {"above": 1, "on": "most"},
    }
    for counts, expected in (
        ((101,) * 5, "reproduced"),
        ((100, 101, 101, 101, 101), "shape only"),
        ((100, 100, 100, 101, 101), "contradicted"),
    ):
        records = [record(BASE, scene, [1.0]) for scene in SCENES]
        records += [record(OURS, scene, [1.0], tests=count) for scene, count in zip(SCENES, counts, strict=True)]
        assert verdict(rule, records).verdict == expected


def test_shares_of_one_run_and_sums_of_stages():
    rule = {
        "type": "ratio",
        "of": {"variant": OURS, "seconds": "arrange+compact"},
        "to": {"variant": OURS, "seconds": "total"},
        "full": {"at_most": 0.1},
    }
    records = [record(OURS, scene, 1.0) for scene in SCENES]
    for one in records:
        one["samples"] |= {"arrange": [0.04] * 3, "compact": [0.05] * 3}
    assert verdict(rule, records).verdict == "reproduced"
    records[2]["samples"]["compact"] = [0.07] * 3
    assert verdict(rule, records).verdict == "contradicted"
    assert verdict(rule, records).measured == "0.09 Sponza to 0.11 Hairball"


def test_sides_are_compared_on_the_same_rays_only_and_on_most_of_them():
    records = [record(BASE, scene, 4.0, rays=100) for scene in SCENES]
    records += [record(OURS, scene, 1.0, rays=1000) for scene in SCENES]
    assert verdict(TWICE, records).reason.endswith("its runs trace no rays in common")
    both = records + [record(OURS, scene, 1.0, rays=100) for scene in SCENES]
    assert verdict(TWICE, both).verdict == "reproduced"
    more = both + [record(BASE, scene, 1.5, rays=1000) for scene in SCENES]
    assert verdict(TWICE, more).verdict == "shape only"


def embree_beside(grid: str, scene: str, seconds) -> dict:
    """A run of Embree measured beside the runs on `grid`."""
    made = record("embree:", scene, seconds, grid=grid, stage="total")
    return made | {"spec": {"grid": made["grid"]}, "grid": None, "id": f"embree beside {grid} {scene}"}


def test_embree_is_compared_as_measured_beside_the_other_side():
    rule = {
        "type": "ratio",
        "of": {"variant": "embree", "seconds": "total"},
        "to": {"variant": OURS, "grid": "8/64 total", "seconds": "total"},
        "full": {"at_least": 2, "on": "all"},
    }
    noisy = (1.0, 2.0, 4.0)
    records = []
    for scene in SCENES:
        records += [record(OURS, scene, noisy, grid="8/64 total"), embree_beside("8/128 total", scene, 1.0)]
    judged = verdict(rule, records)
    finding = judged.outcomes[0].findings[0]
    assert judged.verdict == "contradicted" and finding.low < finding.high
    paired = [embree_beside("8/64 total", scene, tuple(3 * time for time in noisy)) for scene in SCENES]
    judged = verdict(rule, records + paired)
    finding = judged.outcomes[0].findings[0]
    assert judged.verdict == "reproduced" and (finding.low, finding.high) == pytest.approx((3, 3))
    assert "embree beside 8/64 total sponza" in finding.runs


def test_the_uniform_grid_is_the_fastest_one_measured():
    rule = {
        "type": "ratio",
        "of": {"variant": OURS, "grid": "uniform", "seconds": "total"},
        "to": {"variant": OURS, "grid": "adaptive", "seconds": "total"},
        "full": {"above": 1, "on": "any"},
    }
    records = []
    for scene in SCENES:
        records += [
            record(OURS, scene, 4.0),
            record(OURS, scene, 2.0, grid="8/64 total"),
            record(OURS, scene, 3.0, grid="40/16 adaptive"),
            record(OURS, scene, 1.0, grid="8/8 per-cell"),
        ]
    assert verdict(rule, records).verdict == "contradicted"
    records.append(record(OURS, "crown", 1.9, grid="41/16 adaptive"))
    judged = verdict(rule, records)
    assert judged.verdict == "reproduced"
    assert "8/64 total against 41/16 adaptive" in judged.outcomes[0].findings[3].note


TREND = {
    "type": "trend",
    "over": "scenes",
    "of": RATIO["of"],
    "to": RATIO["to"],
    "full": {"low": 0.75, "high": 1.25},
    "shape": {"low": 0},
}


@pytest.mark.parametrize(
    ("power", "noise", "expected"),
    [
        (1.0, (1, 1, 1, 1, 1), "reproduced"),
        (0.4, (1, 1.01, 1, 1.01, 1), "shape only"),
        (-0.5, (1, 1.01, 1, 1.01, 1), "contradicted"),
        (1.0, (1, 3, 1, 0.3, 1), "inconclusive"),
        (0.3, (3, 1, 1, 5, 3), "inconclusive"),
    ],
)
def test_each_verdict_of_a_trend(power, noise, expected):
    factors = [1e-3 * TRIANGLES[scene] ** power * part for scene, part in zip(SCENES, noise, strict=True)]
    judged = verdict(TREND, speedups(factors))
    assert judged.verdict == expected and "power" in judged.measured
    assert len(judged.records) == 10


def test_a_trend_over_scenes_needs_four():
    judged = verdict(TREND, speedups((1, 2, 3)))
    assert judged.verdict == "not attempted" and "3 of 5 scenes, 4 needed" in judged.reason


def test_a_trend_over_sizes_has_a_factor_for_each_scene():
    rule = TREND | {"over": "sizes"}
    records = []
    for scene, factor in (("sponza", 1e-5), ("crown", 1e-7)):
        for size, parts in (("@1/64", 64), ("@1/16", 16), ("@1/4", 4), ("", 1)):
            count = TRIANGLES[scene] // parts
            records += [
                record(BASE, scene + size, factor * count, triangles=count),
                record(OURS, scene + size, 1.0, triangles=count),
            ]
    judged = verdict(rule, records)
    assert judged.verdict == "reproduced" and "over 8 points" in judged.measured
    assert verdict(rule, speedups((1, 2, 3, 4, 5))).reason.startswith("0 points, 4 needed")


def test_sizes_are_those_with_most_rays_whatever_their_view_is_called():
    records = []
    for view, rays, power in (("atrium", 9000, 1), ("front", 1000, -1)):
        for size, parts in (("@1/64", 64), ("@1/16", 16), ("@1/4", 4), ("", 1)):
            count = TRIANGLES["sponza"] // parts
            sides = (BASE, (1e-5 * count) ** power), (OURS, 1.0)
            records += [
                record(variant, "sponza" + size, seconds, triangles=count, rays=rays) | {"view": view}
                for variant, seconds in sides
            ]
    assert verdict(TREND | {"over": "sizes"}, records).verdict == "reproduced"


ORDER = {"type": "order", "of": {"variant": OURS, "seconds": "traverse"}, "order": list(SCENES), "shape_pairs": 8}


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [
        ((1, 2, 3, 4, 5), "reproduced"),
        ((2, 1, 3, 4, 5), "shape only"),
        ((5, 4, 3, 2, 1), "contradicted"),
        ((1, [1.0, 1.1, 0.9], 3, 4, 5), "inconclusive"),
    ],
)
def test_each_verdict_of_an_order(seconds, expected):
    records = [record(OURS, scene, time, stage="traverse") for scene, time in zip(SCENES, seconds, strict=True)]
    assert verdict(ORDER, records).verdict == expected


def test_an_order_compares_times_a_ray():
    records = [
        record(
            OURS,
            scene,
            time * (9 if scene == "sponza" else 1),
            stage="traverse",
            rays=9000 if scene == "sponza" else 1000,
        )
        for scene, time in zip(SCENES, (1, 2, 3, 4, 5), strict=True)
    ]
    assert verdict(ORDER, records).verdict == "reproduced"
    assert verdict(ORDER, records[:2]).verdict == "not attempted"


def test_an_order_without_intervals_still_names_stand_ins():
    records = [record(OURS, scene, [1.0], stage="traverse") for scene in SCENES]
    judged = verdict(ORDER, records)
    assert judged.verdict == "inconclusive" and judged.stand_ins
    findings = {finding.what: finding for finding in judged.outcomes[0].findings}
    assert findings["sponza before hairball"].stand_in and not findings["sponza before conference"].stand_in


def test_times_that_the_clock_could_not_tell_are_no_evidence():
    records = speedups((3, 3, 3, 3, 3))
    for one in records:
        if one["tracer"] == "deferred":
            one["samples"]["intersect"] = [1.0, 0.0, 1.0]
    assert verdict(TWICE, records).verdict == "not attempted"
    rate = {"type": "context", "of": RATIO["to"], "unit": "rays/s", "inverse": True, "paper": 1.0}
    assert verdict(rate, records).verdict == "not attempted"


def test_counts_must_be_equal_exactly():
    rule = {"type": "equal", "of": BASE, "to": "forward:ray-space", "counters": ["pairs", "tests"]}
    records = [record(name, scene, [1.0]) for scene in SCENES for name in (BASE, "forward:ray-space")]
    assert verdict(rule, records).verdict == "reproduced"
    records[0]["counters"]["tests"] += 1
    judged = verdict(rule, records)
    assert judged.verdict == "contradicted" and judged.measured == "1 of 10 counts differ"
    assert verdict(rule, records[:2]).verdict == "not attempted"


@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        ((2.1, 2.05, 2.2), "reproduced"),
        ((1.5, 1.4, 1.6), "shape only"),
        ((0.8, 0.7, 0.9), "contradicted"),
        ((2.0, 1.9, 2.1), "inconclusive"),
        (None, "not attempted"),
    ],
)
def test_each_verdict_of_two_kernels(rate, expected):
    rule = {
        "type": "kernels",
        "of": "ray-space",
        "to": "moller-trumbore",
        "contraction": "on",
        "full": {"at_least": 2},
        "shape": {"above": 1},
    }
    made = {"moller-trumbore": (1.0, 1.0, 1.0)} | ({"ray-space": rate} if rate else {})
    rates = [
        KernelRate(intersector=name, contraction="on", wrong=0, tests_per_second=Interval(*found))
        for name, found in made.items()
    ]
    judged = verdict(rule, [], kernel_rates=rates)
    assert judged.verdict == expected
    assert expected != "not attempted" or "defray stability" in judged.reason


def test_operations_are_counted_in_the_source():
    rule = {
        "type": "source",
        "intersector": "ray-space-plain",
        "differences": 9,
        "dot_products": 6,
        "cross_products": 1,
    }
    assert verdict(rule, []).verdict == "reproduced"
    assert verdict(rule | {"dot_products": 7}, []).verdict == "contradicted"
    refused = verdict(rule | {"intersector": "ray-space"}, [])
    assert refused.verdict == "not attempted" and "cannot be counted" in refused.reason


def test_an_operation_more_in_the_source_is_noticed():
    source = (KERNELS / "intersect" / "ray_space_plain.cl").read_text(encoding="utf-8")
    assert operations(source) == (24, 24)
    assert (
        sum(operations(source))
        == find("ray-space-plain").flops
        == SourceRule(
            type="source", intersector="ray-space-plain", differences=9, dot_products=6, cross_products=1
        ).flops
    )
    assert operations(source.replace("x1 * y2 - x2 * y1;", "x1 * y2 - x2 * y1 + x1 * x1;")) == (25, 25)
    with pytest.raises(DefrayError, match="calls fma"):
        operations(source.replace("x1 * y2 - x2 * y1", "fma(x1, y2, -x2 * y1)"))


def coherence_rows(folder, steps: dict[str, int]) -> None:
    """A coherence.jsonl in which lanes that walk take so many trips for 3200 steps in each model."""
    machine = {
        "cpu": "a CPU",
        "cores": 1,
        "os": "an OS",
        "device": "a device",
        "platform": None,
        "driver": None,
        "versions": {},
    }
    zeros = dict.fromkeys(
        ("uneven_step_trips", "uneven_test_trips", "line_trips", "line_tests", "lines_64", "lines_128"), 0
    )
    for scene in SCENES[:4]:
        counts = [
            {"model": model, "lanes": 32, "steps": 3200, "step_trips": trips, "tests": 32, "test_trips": 1, **zeros}
            for model, trips in steps.items()
        ]
        grid = dict.fromkeys(("cells", "nonempty", "references", "bytes"), 9)
        row = {
            "schema": SCHEMA,
            "id": f"coherence {scene}",
            "time_utc": "",
            "command": "",
            "commit": "",
            "dirty": False,
            "machine": machine,
            "scene": {"name": scene, "source": "real", "triangles": 9, "sha256": ""},
            "intersector": "ray-space",
            "wave": 4,
            "rays": {"kind": "diffuse", "count": 9, "seed": 1},
            "grid": grid | {"top": 8, "leaf": 128, "reading": "total", "build_seconds": 1.0},
            "counts": counts,
        }
        with open(folder / "coherence.jsonl", "a", encoding="utf-8") as file:
            file.write(json.dumps(sealed(row)) + "\n")


@pytest.mark.parametrize(
    ("trips", "expected"), [((100, 200), "inconclusive"), ((200, 200), "contradicted"), (None, "not attempted")]
)
def test_coherence_is_judged_by_exact_counts(tmp_path, trips, expected):
    rule = {
        "type": "coherence",
        "value": "walk_efficiency",
        "of": "deferred",
        "to": "forward",
        "lanes": 32,
        "full": {"above": 1, "on": "all"},
        "shape": {"above": 1, "on": "all"},
    }
    if trips:
        coherence_rows(tmp_path, dict(zip(("deferred", "forward"), trips, strict=True)))
    judged = verdict(rule, [], folder=tmp_path)
    assert judged.verdict == expected, "the fifth scene has no rows"
    weaker = rule | {"full": {"above": 1.5, "on": "most"}, "shape": {"above": 1, "on": "most"}}
    most = {"inconclusive": "reproduced", "contradicted": "contradicted", "not attempted": "not attempted"}[expected]
    again = verdict(weaker, [], folder=tmp_path)
    assert again.verdict == most
    assert (again.measured == "2 to 2") == (expected == "inconclusive")


def test_absolute_rates_are_shown_and_never_judged():
    rule = {
        "type": "context",
        "of": {"variant": OURS, "seconds": "traverse", "per": "rays"},
        "unit": "Mrays/s",
        "inverse": True,
        "scale": 1e-6,
        "paper": {"sponza": 70},
    }
    for seconds in (1e-9, 1e9):
        judged = verdict(rule, [record(OURS, "sponza", seconds, stage="traverse")])
        assert judged.verdict == "not attempted" and "neither pass nor fail" in judged.reason
        finding = judged.outcomes[0].findings[0]
        assert finding.value == pytest.approx(1000 / seconds * 1e-6) and finding.note == "paper: 70"
    assert f"no run of {OURS}" in verdict(rule, []).reason


@pytest.mark.parametrize(
    ("bound", "low", "high", "expected"),
    [
        ({"at_least": 2}, 2, 3, True),
        ({"at_least": 2}, 1, 1.9, False),
        ({"at_least": 2}, 1, 2, None),
        ({"above": 2}, 2, 3, None),
        ({"above": 2}, 1, 2, False),
        ({"at_most": 2}, 1, 2, True),
        ({"at_most": 2}, 2, 3, None),
        ({"below": 2}, 1, 2, None),
        ({"below": 2}, 2, 3, False),
        ({"below": 2}, None, None, None),
    ],
)
def test_an_interval_across_a_threshold_is_open(bound, low, high, expected):
    assert Bound(**bound).holds(low, high) is expected


def test_answers_of_scenes_make_one():
    assert [every(a) for a in ([True, True], [True, None], [None, False])] == [True, None, False]
    assert [some(a) for a in ([False, True], [False, None], [False, False])] == [True, None, False]
    assert [most(a) for a in ([True, True, None], [True, False, None], [True, False], [False, None, None])] == [
        True,
        None,
        False,
        None,
    ]


def test_rules_of_a_claim_must_all_hold():
    def outcome(full, shape, missing=""):
        return Outcome(full, shape, "", missing=missing)

    yes, weak, no = outcome(True, True), outcome(False, True), outcome(False, False)
    gone = outcome(None, None, "no records")
    assert verdict_of([yes, yes]) == "reproduced" and verdict_of([yes, weak]) == "shape only"
    assert verdict_of([yes, no]) == "contradicted" and verdict_of([gone, no]) == "contradicted"
    assert verdict_of([yes, gone]) == "not attempted" and verdict_of([yes, outcome(None, True)]) == "inconclusive"
    assert verdict_of([outcome(True, False)]) == "reproduced", "a shape is a weaker condition, never a further one"


def test_lines_are_counted_a_test_so_that_idle_lanes_share_nothing(tmp_path):
    rule = {
        "type": "coherence",
        "value": "lines_per_test",
        "of": "forward",
        "to": "deferred-packed",
        "lanes": 32,
        "full": {"above": 1, "on": "most"},
        "shape": {"above": 1, "on": "most"},
    }
    coherence_rows(tmp_path, {"forward": 200, "deferred-packed": 100})
    file = tmp_path / "coherence.jsonl"
    rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    for row in rows:
        few, many = row["counts"]
        few |= {"tests": 4, "line_trips": 1, "line_tests": 4, "lines_64": 6, "lines_128": 6}
        many |= {"line_trips": 1, "line_tests": 32, "lines_64": 12, "lines_128": 12}
    file.write_text("".join(json.dumps(sealed(row)) + "\n" for row in rows), encoding="utf-8")
    judged = verdict(rule, [], folder=tmp_path)
    assert judged.verdict == "reproduced" and judged.measured == "4 to 4"
