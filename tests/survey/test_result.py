"""A survey as tables, documents, a parameter file and a page, of outcomes with a known answer."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

import servo_models as sm
from servo_models.diagnosis.verdict import OUTSIDE
from servo_models.survey.job import Outcome
from servo_models.survey.result import BETTER, GONE, NEW, OTHER, WORSE, Survey, told_apart
from servo_models.survey.sections import MOST_UNITS, SurveyDocument, grouped
from tests.support.made_outcomes import estimate, fleet, outcome
from tests.support.schemas import check_schema

DELAY = {"transport_delay": (0.03, 0.001)}
PLAY = {"backlash": (0.02, 0.001)}


def survey(*outcomes: Outcome, **others: object) -> Survey:
    return Survey("fleet", outcomes, **others)  # type: ignore[arg-type]


def test_a_row_a_job() -> None:
    found = survey(
        outcome("1", "elbow", {**PLAY, **DELAY}, firmware="2", seconds="slow"),
        outcome("1", "wrist", failure="no log"),
    ).table()
    assert found.columns[:4] == ["unit", "joint", "firmware", "condition seconds"]
    first, second = found.rows(named=True)
    assert first["causes"] == "backlash, transport_delay"
    assert (first["size"], first["standard_error"], first["measure"]) == (0.02, 0.001, "rad")
    assert (first["verdict"], first["condition seconds"], first["seconds"]) == (
        "effects",
        "slow",
        5,
    )
    assert (second["verdict"], second["failure"], second["gap_before"]) == (
        "failed",
        "no log",
        None,
    )


def test_a_row_a_value() -> None:
    inertia = estimate("inertia", 2.0, 0.1, 1.0, 0.5)
    found = survey(
        outcome("1", "elbow", PLAY, parameters=[inertia], episodes=[[inertia]])
    ).estimates()
    assert found["name"].to_list() == ["inertia", "backlash.half_width", "inertia"]
    assert found["episode"].to_list() == [None, None, "log_0.csv"]
    assert found["held_out"].to_list() == [False, False, True]
    assert found.row(0)[5:] == ("kg.m2", 1.0, 0.5, 2.0, 0.1)


def test_the_mean_of_the_units_is_a_parameter_file(tmp_path: Path) -> None:
    """Values 40, 42 and 44 with errors of 1 have a variance of 4: 3 between, 4 / 3 of the mean."""
    found = survey(
        *(
            outcome(
                f"{k}", "elbow", DELAY, parameters=[estimate("motor_gain", 40.0 + 2.0 * k, 1.0)]
            )
            for k in range(3)
        ),
        outcome("3", "elbow", PLAY),
    ).common("elbow")
    sm.write_parameters(found, tmp_path / "common.toml")
    read = sm.read_parameters(tmp_path / "common.toml")
    values = read.model().values
    assert values["motor_gain"] == pytest.approx(42.0)
    assert values["transport_delay.time"] == pytest.approx(0.03)
    assert "backlash.half_width" not in read.settings()
    assert read.estimates[0].standard_error == pytest.approx(np.sqrt(3.0 + 4.0 / 3.0))


def test_what_units_have_in_common_is_without_a_batch_and_what_was_stopped() -> None:
    """A delay of 30 ms that each model lacks, or has: 5 ms later on a batch, 1 ms where stopped."""
    for part in ("transport_delay", "transport_delay.time"):
        lacks, jobs = "." not in part, []
        for k, later in enumerate([5e-3] * 3 + [0.0] * 4 + [1e-3] * 2):
            size = (0.03 + later + 1e-5 * (-1) ** k, 1e-3)
            has = [] if lacks else [estimate(part, *size, nominal=0.025, prior=0.05)]
            effects = {part: size} if lacks else {}
            job = outcome(f"{k}", "elbow", effects, parameters=has, firmware=f"{k < 3}")
            jobs.append(msgspec.structs.replace(job, stopped="after 60 s" if k > 6 else ""))
        found = survey(*jobs)
        assert [(it.name, it.whose) for it in found.belongings if it.whose] == [
            (part, "firmware = True")
        ]
        assert "2 joints left out: the diagnosis was stopped" in str(found)
        (delay,) = found.common("elbow").estimates
        assert delay.name == "transport_delay.time"
        assert delay.value == pytest.approx(0.03 if lacks else 0.0303, abs=1e-4)
        assert found.estimates()["name"].to_list() == ["transport_delay.time"] * 9


def test_no_mean_is_taken_of_two_actuators() -> None:
    elbow, wrist = outcome("1", "elbow", DELAY), outcome("1", "wrist", DELAY)
    copies = [msgspec.structs.replace(elbow, actuator=f"{u}/mine.py", unit=u) for u in "ab"]
    assert survey(*copies).common().actuator == "a/mine.py"
    wrist = msgspec.structs.replace(wrist, actuator="torque_motor")
    with pytest.raises(sm.UserError, match=r"several actuators .* elbow, wrist"):
        survey(elbow, wrist).common()
    with pytest.raises(sm.UserError, match="no log tells"):
        survey(outcome("1", "elbow")).common()


def test_joints_of_one_name_and_other_actuators_are_told_apart() -> None:
    """A delay is on most of the 8 joints of that name, and on those of one actuator alone."""
    geared = [outcome(f"{k}", "elbow", DELAY) for k in range(5)]
    direct = [
        msgspec.structs.replace(outcome(f"x{k}", "elbow"), actuator="torque_motor")
        for k in range(3)
    ]
    lost = outcome("y", "elbow", failure="no log")
    found = survey(*told_apart([*geared, *direct, lost]))
    assert dict.fromkeys(it.joint for it in found.outcomes) == dict.fromkeys(
        ["elbow (sg90 measured)", "elbow (torque_motor measured)", "elbow"]
    )
    (delay,) = found.belongings
    assert (delay.owner, delay.asked, delay.joints) == ("model", 5, ["elbow (sg90 measured)"])
    assert told_apart(geared) == tuple(geared)


@pytest.mark.parametrize(
    ("before", "now", "kind", "why"),
    [
        (None, outcome("1", "elbow"), NEW, "no-gap"),
        (outcome("1", "elbow"), None, GONE, "no-gap"),
        (outcome("1", "elbow"), outcome("1", "elbow", failure="x"), WORSE, "no-gap → failed"),
        (outcome("1", "elbow", PLAY), outcome("1", "elbow"), BETTER, "effect → no-gap"),
        (
            outcome("1", "elbow", failure="x"),
            outcome("1", "elbow", PLAY),
            BETTER,
            "failed → effect",
        ),
        (
            *(outcome("1", "elbow", PLAY), outcome("1", "elbow", {**PLAY, **DELAY})),
            *(WORSE, "backlash → backlash, transport_delay"),
        ),
        (outcome("1", "elbow", PLAY), outcome("1", "elbow", PLAY, gap=13), WORSE, "gap 10 → 13"),
        (outcome("1", "elbow", PLAY, gap=13), outcome("1", "elbow", PLAY), BETTER, "gap 13 → 10"),
        (  # a cause that is no more named, since something larger hides it
            *(outcome("1", "elbow", {**PLAY, **DELAY}), outcome("1", "elbow", PLAY, gap=20)),
            *(WORSE, "gap 10 → 20"),
        ),
        (
            *(outcome("1", "elbow", PLAY), outcome("1", "elbow", DELAY, gap=11)),
            *(OTHER, "backlash → transport_delay"),
        ),
        (outcome("1", "elbow", PLAY), outcome("1", "elbow", PLAY, gap=11), None, ""),
        (outcome("1", "elbow", failure="x"), outcome("1", "elbow", failure="y"), None, ""),
    ],
)
def test_what_changed(before: Outcome | None, now: Outcome | None, kind: str, why: str) -> None:
    there = outcome("2", "elbow")  # else there is nothing to compare with
    found = survey(*filter(None, (now, there)), earlier=tuple(filter(None, (before, there))))
    assert [(it.kind, it.why) for it in found.differences] == ([(kind, why)] if kind else [])


def test_the_worst_tell_why_they_failed() -> None:
    (row,) = survey(outcome("1", "elbow", failure="no log")).tables()["The worst"].rows()
    assert row[:4] == ("1", "elbow", "failed", "no log")


@pytest.mark.parametrize(
    ("error", "said"),
    [(0.009, "1.72 ± 0.52 deg"), *((error, "of unknown size") for error in (0.011, None))],
)
def test_a_size_is_told_where_it_exceeds_three_standard_errors(
    error: float | None, said: str
) -> None:
    one = outcome("1", "elbow", {"backlash": (0.03, error)})
    (row,) = survey(one).tables()["The worst"].rows()
    assert row[3] == f"backlash {said}"


def test_a_search_that_was_stopped_is_told_beside_its_verdict() -> None:
    first, other = outcome("1", "elbow", PLAY), outcome("1", "wrist", PLAY, gap=20.0)
    found = survey(first, msgspec.structs.replace(other, stopped="after 60 s"))
    text = str(found)
    assert "2 of 2 lack something, 1 stopped early" in text
    assert text.count("effect 20, stopped") == 2  # in the matrix and among the worst
    assert "effect 10, stopped" not in text
    assert "a longer one may say something else" in found.report().sections[0].lead


def test_an_equal_survey_says_that_nothing_changed() -> None:
    jobs = tuple(fleet(2, 2))
    assert "nothing changed" in str(survey(*jobs, earlier=jobs))
    assert "Since before" not in str(survey(*jobs))


def test_each_diagnosis_is_read_from_its_file(tmp_path: Path) -> None:
    job = outcome("1", "elbow", PLAY)
    (tmp_path / "jobs").mkdir()
    (tmp_path / "jobs" / f"{job.key}.json").write_text('{"diagnosis": {"verdict": "effect"}}')
    found = survey(job, folder=tmp_path)
    assert found.diagnosis("1", "elbow") == {"verdict": "effect"}
    with pytest.raises(sm.UserError, match="no joint 'ellbow' of unit '1'"):
        found.diagnosis("1", "ellbow")


def test_the_document_keeps_to_its_schema() -> None:
    jobs = tuple(fleet(4, 2))
    found = survey(*jobs, outcome("x", "joint_1", failure="no log"), earlier=jobs[2:])
    document = json.loads(found.to_json())
    check_schema(document, SurveyDocument)
    assert document["verdicts"]["failed"] == 1
    assert {cause["owner"] for cause in document["causes"]} >= {"model", "unit"}


def test_the_page_leads_to_the_reports_that_are_there(tmp_path: Path) -> None:
    there, gone = outcome("1", "elbow", PLAY), outcome("2", "elbow", PLAY, gap=20.0)
    (tmp_path / "reports").mkdir()
    (tmp_path / "reports" / f"{there.key}.html").touch()
    survey(there, gone, folder=tmp_path).write_report(tmp_path / "index.html")
    text = (tmp_path / "index.html").read_text("utf-8")
    assert f'<a href="reports/{there.key}.html">effect 10</a>' in text
    assert gone.key not in text


def test_the_worst_units_are_shown_first_and_the_rest_is_counted() -> None:
    jobs = [outcome(f"{k}", "elbow", PLAY, gap=2.0 + k) for k in range(MOST_UNITS + 50)]
    matrix = survey(*jobs, outcome("bad", "elbow", failure="no log")).report().sections[0]
    rows = [row for table in matrix.tables for row in table.rows]
    assert [row[0] for row in rows[:2]] == ["249", "248"]
    assert len(rows) == MOST_UNITS
    assert f"The worst {MOST_UNITS} of {MOST_UNITS + 51}" in matrix.lead


def test_many_joints_of_few_units_are_rows() -> None:
    jobs = [outcome("robot", f"joint {k}", PLAY, gap=2.0 + k) for k in range(29)]
    table, _ = survey(*jobs).report().sections[0].tables
    assert table.columns == ("joint", "robot")
    assert table.rows[0][0] == "joint 28"


def test_one_reason_is_one_row() -> None:
    """However many files have it."""
    text = "'log_{0}.csv' is no log: row {0}, byte 0x{0:02x}"
    reasons = [(text.format(k), f"unit {k}") for k in range(10_000)]
    ((why, names), other) = grouped([*reasons, ("the disk is full", "unit x")])
    assert (why, len(names)) == (text.format(0), 10_000)
    assert other == ("the disk is full", ["unit x"])


def test_a_page_without_the_mixed_model_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "statsmodels", None)
    monkeypatch.setitem(sys.modules, "statsmodels.regression.mixed_linear_model", None)
    assert "pip install 'servo-models[survey]'" in str(survey(*fleet(3, 1)))


def test_a_unit_that_stands_out_is_told() -> None:
    jobs = [
        outcome(f"{k:02}", "elbow", parameters=[estimate("inertia", 1.0 + 0.01 * k, 0.01)])
        for k in range(12)
    ]
    odd = outcome("odd", "elbow", parameters=[estimate("inertia", 3.0, 0.01)])
    assert "inertia of elbow stands out on odd (3 kg.m2); the others have 1.05" in str(
        survey(*jobs, odd)
    )


def test_an_effect_that_is_only_the_nearest_belongs_to_nobody() -> None:
    known, unknown = outcome("1", "elbow", PLAY), outcome("1", "wrist", DELAY)
    text = str(survey(known, msgspec.structs.replace(unknown, verdict=OUTSIDE)))
    assert "backlash belongs to unit 1, elbow" in text
    assert "transport_delay belongs" not in text
    assert "1 joint left out: " in text
    assert "nearest: transport_delay 30.0 +- 1.0 ms" in text
