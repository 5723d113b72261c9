"""The golden set: its inputs are those that are stored, and a comparison sees what it should."""

from __future__ import annotations

import json
import math
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from servo_models.errors import UserError
from servo_models.withheld.generator.cases import KINDS, TIERS
from servo_models.withheld.generator.faults import FAULTS
from servo_models.withheld.generator.rigs import RIGS
from studies.golden import (
    GOLDEN,
    QUICK,
    REPORTED,
    Job,
    answered,
    change,
    changed_verdict,
    check_inputs,
    differences,
    read_rows,
    right,
    sizes_apart,
    truths,
    verdict_table,
    withheld,
)

STORED: dict[str, str] = json.loads((GOLDEN / "inputs.json").read_text("utf-8"))


def test_inputs_are_those_whose_answers_are_stored() -> None:
    jobs = list(withheld(GOLDEN))
    assert check_inputs(jobs, STORED) == STORED
    answers = read_rows(GOLDEN / "answers.jsonl")
    assert {job.name for job in jobs} <= set(answers)
    reports = {path.name for path in (GOLDEN / "reports").iterdir()}
    kinds = ("check", "diagnose", "identify")
    assert reports == {f"{case}_{kind}.txt" for case in REPORTED for kind in kinds}


def test_cases_are_of_all_tiers_rigs_kinds_and_faults() -> None:
    truth = truths(GOLDEN)
    assert Counter(row["tier"] for row in truth.values()) == dict.fromkeys(TIERS, 15)
    for tier in TIERS:
        rows = [row for row in truth.values() if row["tier"] == tier]
        assert {row["actuator"] for row in rows} == {rig.actuator for rig in RIGS}
        assert {row["kind"] for row in rows} == set(KINDS)
    assert {fault for row in truth.values() for fault in row.get("faults", ())} == set(FAULTS)
    quick = Counter(truth[f"withheld/{case}"]["tier"] for case in QUICK)
    assert quick == dict.fromkeys(TIERS, 5)


def test_an_input_that_was_changed_is_refused_by_name(tmp_path: Path) -> None:
    shutil.copytree(GOLDEN / "cases" / "0000", tmp_path / "cases" / "0000")
    jobs = list(withheld(tmp_path))
    check_inputs(jobs, STORED)
    log = next(tmp_path.rglob("*.parquet"))
    log.write_bytes(log.read_bytes() + b"\n")
    with pytest.raises(UserError, match=f"{log.name}' is not the input"):
        check_inputs(jobs, STORED)


def refused(path: Path) -> Any:
    raise UserError(f"'{path}' is refused")


def test_a_diagnosis_that_is_refused_is_a_wrong_answer(tmp_path: Path) -> None:
    row = answered(Job("withheld/0007", refused, tmp_path, {}, reported=True))
    assert row["answer"] == {"verdict": "failed", "named": [], "set": []}
    assert not right(TRUTH, row["answer"])
    assert not right({**TRUTH, "kind": "nothing", "effects": [], "hidden": []}, row["answer"])


TRUTH = {
    "case": "0007",
    "tier": "hard",
    "actuator": "sg90",
    "kind": "one",
    "effects": [{"name": "backlash"}],
    "hidden": [{"name": "cogging"}],
}


def answer(verdict: str, *named: str, **values: list[float]) -> dict[str, Any]:
    return {"verdict": verdict, "named": list(named), "set": list(named), "values": values}


BACKLASH = answer("effect", "backlash")
BOTH = answer("effects", "backlash", "cogging")
WRONG = answer("effect", "dead_band")
OUTSIDE = answer("outside-catalogue", "backlash")


def test_an_answer_is_right_where_it_names_the_cause_and_at_most_the_hidden_one() -> None:
    assert right(TRUTH, BACKLASH)
    assert right(TRUTH, BOTH)
    assert not right(TRUTH, WRONG)
    assert not right(TRUTH, OUTSIDE)
    assert right({**TRUTH, "kind": "foreign"}, OUTSIDE)
    assert right({**TRUTH, "kind": "nothing", "effects": [], "hidden": []}, answer("no-gap"))


@pytest.mark.parametrize(
    ("before", "now", "expected"),
    [
        (WRONG, BACKLASH, "gained"),
        (BACKLASH, OUTSIDE, "lost"),
        (BACKLASH, BOTH, "neither"),
        (WRONG, OUTSIDE, "neither"),
    ],
)
def test_a_changed_verdict_is_listed_against_the_truth(
    before: dict[str, Any], now: dict[str, Any], expected: str
) -> None:
    assert changed_verdict(before, now)
    assert change(TRUTH, before, now) == expected
    assert change(None, before, now) == "neither"
    name = "withheld/0007"
    _, line = verdict_table({name: before}, {name: now}, {name: TRUTH})
    assert line.startswith(f"{name} | ")
    assert line.endswith(f" | one: backlash (hidden cogging) | {expected}")


def test_the_order_of_names_and_the_numbers_beside_them_are_no_changed_verdict() -> None:
    other = {**answer("effects", "cogging", "backlash"), "gap": {"after": 1.0}}
    assert not changed_verdict(BOTH, other)
    assert len(verdict_table({"a": BOTH}, {"a": other}, {})) == 1
    assert changed_verdict(BOTH, {**BOTH, "set": ["backlash"]})


@pytest.mark.parametrize(
    ("before", "now", "apart"),
    [
        ([1.0, 0.03], [1.049, 0.04], False),  # 0.05 together
        ([1.0, 0.03], [1.051, 0.04], True),
        ([1.0, math.nan], [1.0 + 1e-9, math.nan], False),  # on its bound
        ([1.0, math.nan], [1.1, math.nan], True),
        ([1.0, math.inf], [5.0, 0.1], False),  # the logs did not tell
    ],
)
def test_sizes_may_differ_by_their_combined_standard_errors(
    before: list[float], now: list[float], apart: bool
) -> None:
    pair = (answer("effect", play=value) for value in (before, now))
    assert len(list(sizes_apart("case", *pair))) == apart


def test_equal_is_to_the_last_digit_or_to_a_share() -> None:
    before, now = {"a": [1.0, {"b": 2.0}], "c": "x"}, {"a": [1.0, {"b": 2.0 + 1e-9}], "c": "x"}
    assert not list(differences("case", before, before, 0.0))
    assert list(differences("case", before, now, 0.0)) == [
        "case: a [1]: b: was 2.0, is 2.000000001"
    ]
    assert not list(differences("case", before, now, 1e-6))
    assert list(differences("case", before, {**now, "c": "y"}, 1e-6)) == ["case: c: was x, is y"]
    assert list(differences("case", {"a": [1.0]}, {"a": [1.0, 2.0]}, 1.0))
