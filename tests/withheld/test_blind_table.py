"""Cases that are kept as rows score as they did."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.report.interchange import finite_json
from servo_models.withheld.oracle import Diagnosed, Known
from servo_models.withheld.run import Check
from servo_models.withheld.score import (
    FIGURES,
    Case,
    Cases,
    Statistic,
    calibration,
    confusion,
    imitated_told,
)
from studies.blind import case_of, row_of
from tests.support.withheld_cases import MADE

NAMES = st.lists(st.sampled_from(["a", "b", "sensor_quantisation"]), unique=True, max_size=3)
SIZE = st.floats(0.0, 1e6)
KNOWN = st.builds(
    Known,
    case=st.just("0"),
    truth=SIZE,
    parameters=SIZE,
    rival=st.one_of(SIZE, st.just(float("inf"))),
    rival_effects=NAMES,
    separated=st.booleans(),
    absorbed=st.booleans(),
    after=st.one_of(st.none(), SIZE),
    without=st.sampled_from(["", "effect", "outside-catalogue"]),
)
SAID = st.builds(
    Diagnosed,
    case=st.just("0"),
    verdict=st.sampled_from(["no-gap", "parameters", "effect", "outside-catalogue", "failed"]),
    seconds=st.floats(0.0, 100.0),
    named=NAMES,
    members=NAMES,
    chances=st.dictionaries(st.sampled_from(["a", "b"]), st.floats(0.0, 1.0)),
    probabilities=st.dictionaries(st.sampled_from(["a", "b"]), st.floats(0.0, 1.0)),
    before=SIZE,
    after=SIZE,
    imitated=st.one_of(st.none(), NAMES),
)
TRUTHS = st.frozensets(st.sampled_from(["a", "b", "sensor_quantisation"]), min_size=1)
ONE = st.builds(
    Case,
    tier=st.just("easy"),
    actuator=st.just("sg90"),
    kind=st.sampled_from(["nothing", "one", "two", "foreign"]),
    truth=TRUTHS,
    hidden=st.frozensets(st.sampled_from(["c"])),
    said=SAID,
    known=st.one_of(st.none(), KNOWN),
)


def written(cases: Cases) -> dict[str, Any]:
    return Check(1, ("easy",), "0" * 64, cases).document()


def kept(cases: Cases) -> Cases:
    """The cases after a run's JSON and a table."""
    run = json.loads(finite_json(written(cases)))
    return [case_of(row_of(case)) for case in run["cases"]]


def same(one: Statistic, other: Statistic) -> bool:
    pairs = zip((one.value, one.low, one.high), (other.value, other.low, other.high))
    near = [a == b or (a is not None and a == pytest.approx(b, abs=1e-3)) for a, b in pairs]
    return one.n == other.n and all(near)


@pytest.mark.thorough
@given(st.one_of(st.just(MADE), st.lists(ONE, min_size=1, max_size=12)))
def test_every_figure_is_that_of_the_run(cases: Cases) -> None:
    """But for seconds, of which a table holds thousandths."""
    found = kept(cases)
    assert all(same(define(found), define(cases)) for define in FIGURES)
    assert confusion(found) == confusion(cases)
    assert calibration(found) == calibration(cases)


def test_a_table_of_an_earlier_run_does_not_say_what_parameters_imitate() -> None:
    rows = [row_of(case) for case in json.loads(finite_json(written(MADE)))["cases"]]
    for row in rows:
        del row["imitated"]
    assert imitated_told([case_of(row) for row in rows]).n == 0


def test_a_run_from_before_that_was_looked_for_can_be_kept() -> None:
    cases = json.loads(finite_json(written(MADE)))["cases"]
    for case in cases:
        del case["said"]["imitated"]
    assert imitated_told([case_of(row_of(case)) for case in cases]).n == 0


def test_what_was_told_before_probabilities_were_calibrated_was_the_weight() -> None:
    row = row_of(json.loads(finite_json(written(MADE)))["cases"][0])
    del row["probabilities"]
    said = case_of(row).said
    assert said.probabilities == said.chances == {"a": 0.95}
