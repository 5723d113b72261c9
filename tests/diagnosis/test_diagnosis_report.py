"""The report of a diagnosis: it says what was found, and stands alone.

The rig is the torque motor with a delay; figures that are looked for on the page are worked
out here, from the rig or from the arrays of the diagnosis.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.data.description import Description
from servo_models.data.log import Channel
from servo_models.data.schema import Section
from servo_models.diagnosis.confirm import Confirmation
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.experiments.experiment import next_experiments
from servo_models.diagnosis.page import diagnosis_page
from servo_models.diagnosis.page.evidence import intervals
from servo_models.diagnosis.page.gap import unit_for
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling import words
from servo_models.diagnosis.verdict import EFFECT, NO_GAP, NOT_IDENTIFIABLE, OUTSIDE, PARAMETERS
from servo_models.diagnosis.where import where
from servo_models.identification.page.responses import draw_legend
from servo_models.identification.result import Accuracy
from servo_models.report.parts import MINUS
from servo_models.report.style import drawing
from tests.support.html_page import Page
from tests.support.logs import measured

STEP = 2.5e-4
DELAY = 1.1e-3
NOISE = math.radians(0.02)
DEGREE = math.radians(1.0)
FIXED = {"end_stops.half_range": 0.0}
HOSTILE = "<script>alert('x')</script> $x_"
NUMBER = r"(\d[\d.]*)"


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """A torque constant that is 10 % larger, and a delay of 1.1 ms."""
    nominal = model("torque_motor", "measured", FIXED)
    constant = 1.1 * nominal.values["torque_constant"]
    rig = model(
        "torque_motor",
        "measured",
        {**FIXED, "torque_constant": constant, "transport_delay.time": DELAY},
    )
    voltage = _voltage()
    n = len(voltage)
    times = np.arange(n, dtype=np.float64) * STEP
    log = measured(
        rig,
        times,
        {"voltage": voltage},
        {"angle": NOISE},
        seed=4,
        name="bench",
        path=Path("bench.csv"),
        sha256="0123456789abcdef" * 4,
        channels={"angle": Channel("angle", "angle_deg", "deg", DEGREE)},
    )
    relative = nominal.actuator.variant("measured").uncertainty
    known = {name: abs(part * nominal.values[name]) for name, part in relative.items()}
    path = Path("bench.toml")
    return diagnose(Description(path, Section(path, "", {}), nominal, {}, known, (log,)), jobs=1)


def _voltage() -> Array:
    """Steps of several sizes, then a slow triangle and a sweep."""
    steps = np.repeat([0.0, 10.0, 0.0, -20.0, 0.0, 28.0, -28.0, 0.0], 100)
    t = STEP * np.arange(600)
    triangle = 15.0 * np.interp(t / t[-1], [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])
    sweep = 15.0 * np.sin(2.0 * np.pi * (5.0 * t + 500.0 * t**2))
    return np.concatenate([steps, triangle, sweep])


@pytest.fixture(scope="module")
def unsure(found: Diagnosis) -> Diagnosis:
    """As if the two best effects could not be told apart."""
    rivals = tuple(found.causes.singles[:2])
    members = tuple(name for one in rivals for name in one.effects)
    claims = tuple(replace(one, in_set=one.name in members) for one in found.claims)
    verdict = replace(found.verdict, kind=EFFECT, members=members, rivals=rivals)
    return replace(found, verdict=verdict, claims=claims)


@pytest.fixture(scope="module")
def text(found: Diagnosis) -> str:
    return _page(found)


def _page(found: Diagnosis) -> str:
    return diagnosis_page(
        "Bench", found, where(found.causes), conditions={"Python": "3.11"}, date="2026-01-31"
    )


def _cells(page: Page, first: str) -> list[list[str]]:
    """Rows that begin with a cell."""
    return [row for row in page.rows if row[0] == first]


def _number(text: str) -> float:
    return float(text.replace(MINUS, "-"))


def _heading(text: str) -> str:
    heading = re.search(r"<h1>(.*?)</h1>", text, flags=re.S)
    assert heading
    return re.sub(r"<.*?>", "", heading[1])


def test_page_is_whole_and_stands_alone(found: Diagnosis, text: str) -> None:
    page = Page(text)
    page.assert_stands_alone()
    assert page.count("svg") == page.count("figcaption")
    assert page.count("table") == page.count("caption")
    assert "2026-01-31" in page.text
    assert len(text.encode()) < 500_000
    sections = ("gap", "where", "evidence", "ruled-out", "parameters", "provenance")
    assert [name for name in page.values("id") if name in sections] == list(sections)


def test_same_arguments_give_the_same_bytes(found: Diagnosis, text: str) -> None:
    assert _page(found) == text


def test_verdict_names_the_effect(text: str) -> None:
    assert _heading(text).startswith("Transport delay on")
    assert "explains the gap" in _heading(text)


def test_gap_is_that_of_the_arrays(found: Diagnosis, text: str) -> None:
    """Nominal error from a simulation of the model itself; the rest from held-out errors."""
    log = found.logs[0]
    nominal = simulate(found.model, log.times, log.inputs)["angle"]
    wanted = [
        np.degrees(np.sqrt(np.mean((nominal - log.outputs["angle"]) ** 2))),
        *(
            np.degrees(found.floors["angle"]) * np.sqrt(np.mean(one.evidence.unseen**2))
            for one in (found.causes.retuned, found.causes.taken)
        ),
    ]
    row = next(row for row in _cells(Page(text), "angle") if row[-1] == "deg")
    for cell, value, stage in zip(row[1:], wanted, ("before", "retuned", "after")):
        shown = re.fullmatch(rf"{NUMBER} \({NUMBER} to {NUMBER}\)", cell)
        assert shown
        error, low, high = map(float, shown.groups())
        assert error == pytest.approx(value, rel=6e-3)
        assert low <= error <= high
        assert low * DEGREE == pytest.approx(found.gaps[0].intervals[stage][0], rel=6e-3)
    assert float(row[4]) == pytest.approx(0.02, rel=0.1)  # the noise that was added


def test_every_dimension_that_divides_the_gap_has_one_picture(found: Diagnosis, text: str) -> None:
    """A single output makes one part of its kind: a table tells that, and no picture."""
    pictured = Counter(re.findall(r"<figcaption><strong>By (.*?)\.</strong>", text))
    tabled = Counter(re.findall(r"<caption><span>By (.*?)</span></caption>", text))
    parts = {one.dimension: len(one.bins) for one in where(found.causes)}
    assert parts["signal"] == 1
    assert pictured == Counter(name for name, count in parts.items() if count > 1)
    assert tabled == Counter(parts.keys())
    assert {"time", "frequency", "speed", "position"} <= pictured.keys()
    drawn = re.findall(r'<svg[^>]* aria-label="By (.*?)"', text)
    assert Counter(drawn) == pictured


def test_a_whole_is_100_percent(text: str) -> None:
    """To two digits, all of it would be a power of ten."""
    assert "100 %</td>" in text
    assert not re.search("\u00d710[^ ]* %", text)


def test_what_is_left_and_no_noise_is_told(found: Diagnosis) -> None:
    left = replace(found, verdict=replace(found.verdict, kind="effect", rest=27.3))
    assert "27.3 noise floors of what is left are no noise." in _page(left)


def test_every_effect_is_on_the_page_once_named_or_ruled_out(found: Diagnosis, text: str) -> None:
    page = Page(text)
    wire = {name: found.model.plant.main_wire(name) for name in found.causes.reach}
    reasons = words.ruled_out(found)
    for name in found.causes.reach:
        rows = [
            row
            for row in _cells(page, name.replace("_", " "))
            if row[1] == wire[name].replace("_", " ")
        ]
        assert [row[2] for row in rows] == ([reasons[name]] if name in reasons else [])
    named = {*found.verdict.members, *found.causes.taken.effects}
    assert named | set(reasons) == set(found.causes.reach)


def test_the_set_is_marked_in_the_evidence(unsure: Diagnosis) -> None:
    page = Page(_page(unsure))
    marked = {row[0].replace(" ", "_") for row in page.rows if "in the set" in row}
    assert len(marked) == 2
    assert marked == set(unsure.verdict.members)
    assert "cannot be told apart from" in _heading(page.source)


def test_probabilities_are_shown_for_the_kind_of_explanation_that_was_taken(
    found: Diagnosis, text: str
) -> None:
    """Among pairs of which none was taken they would mean nothing."""
    rows = {row[0]: row[3] for row in Page(text).rows if row[-1].endswith("converged")}
    alone = [one.effects[0].replace("_", " ") for one in found.causes.singles if one.converged]
    assert all("%" in rows[name] for name in alone)
    assert all("%" not in chance for name, chance in rows.items() if " and " in name)


def test_intervals_compare_with_the_best(found: Diagnosis) -> None:
    """One that is worse by the same factor in every block is so in every draw."""
    best = found.causes.singles[0]
    twice = replace(best, evidence=replace(best.evidence, unseen=2.0 * best.evidence.unseen))
    same, worse = intervals([best, twice])
    assert same == pytest.approx((best.evidence.rms, best.evidence.rms))
    assert worse == pytest.approx((2.0 * best.evidence.rms, 2.0 * best.evidence.rms))


def test_parameters_are_in_their_display_units(found: Diagnosis, text: str) -> None:
    page = Page(text)
    (size,) = [row for row in _cells(page, "transport delay") if row[1] == "time"]
    assert size[4] == "ms"
    assert abs(_number(size[2]) - 1.1) < 4.0 * _number(size[3])
    (moved,) = _cells(page, "torque_constant")
    nominal, _, _, _, value, error = map(_number, moved[1:7])
    assert nominal == pytest.approx(found.model.values["torque_constant"], rel=1e-4)
    assert abs(value - 1.1 * nominal) < 4.0 * error


def test_next_experiment_is_told_and_drawn(unsure: Diagnosis) -> None:
    planned = next_experiments(unsure.undecided)
    page = Page(diagnosis_page("Bench", unsure, experiments=planned))
    page.assert_stands_alone()
    assert planned
    for number, one in enumerate(planned, start=1):
        assert f"{number}: {one.text}" in page.text
    drawn = " ".join(page.values("aria-label"))
    assert " or ".join(one.effects[0] for one in unsure.verdict.rivals).replace("_", " ") in drawn
    assert "experiment" not in Page(_page(unsure)).values("id")


def test_what_the_fmu_leaves_is_told(found: Diagnosis) -> None:
    rows = (Accuracy("bench", "angle", "fit", 2000, 0.2 * DEGREE, 0.0301 * DEGREE, 99.9, DEGREE),)
    equal = Page(diagnosis_page("Bench", found, confirmed=Confirmation(rows, 0.0)))
    assert _cells(equal, "bench")[0][4:6] == ["0.2", "0.0301"]
    assert any("same bits" in piece for piece in equal.text)
    off = Page(diagnosis_page("Bench", found, confirmed=Confirmation(rows, 2e-9)))
    assert not any("same bits" in piece for piece in off.text)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("kind", "judged", "begins"),
    [
        (NO_GAP, "pass", "No gap"),
        (PARAMETERS, "open", "Re-tuned parameters"),
        (OUTSIDE, "fail", "Outside the catalogue"),
        (NOT_IDENTIFIABLE, "fail", "These logs cannot tell"),
    ],
)
def test_every_verdict_has_a_page(found: Diagnosis, kind: str, judged: str, begins: str) -> None:
    causes = found.causes
    if kind in (NO_GAP, PARAMETERS):
        causes = replace(causes, taken=causes.retuned, singles=[], pairs=[])
    other = replace(
        found,
        causes=causes,
        verdict=replace(found.verdict, kind=kind, chances={}),
        claims=tuple(replace(one, taken=False, in_set=False) for one in found.claims),
    )
    text = _page(other)
    Page(text).assert_stands_alone()
    assert f'<header class="{judged}">' in text
    assert begins in _heading(text)


def test_a_model_without_uncertainties_is_not_called_retuned(found: Diagnosis) -> None:
    bare = replace(found.causes.retuned.problem, free=())
    alone = replace(found.causes.retuned, problem=bare)
    alone = replace(alone, evidence=replace(alone.evidence, vector=np.empty(0)))
    before = replace(found.causes.before, vector=np.empty(0))
    causes = replace(found.causes, before=before, retuned=alone)
    text = _page(replace(found, causes=causes, moved=()))
    page = Page(text)
    page.assert_stands_alone()
    assert "re-tuned" not in page.text
    assert any("a wrong value looks like an effect" in piece for piece in page.text)


def test_small_errors_are_told_with_a_prefix(found: Diagnosis) -> None:
    """0.0000123 m reads 12.3 um; a log in degrees keeps its unit."""
    (gap,) = found.gaps
    metre = replace(found.logs[0], channels={"angle": Channel("angle", "x", "m", 1.0)})
    for rms, wanted in ((12.3e-6, ("um", 1e-6)), (4.7e-3, ("mm", 1e-3)), (0.54, ("m", 1.0))):
        small = replace(gap, rms={**gap.rms, "before": rms})
        assert unit_for(replace(found, logs=(metre,)), small) == wanted
    assert unit_for(found, gap) == ("deg", DEGREE)


def test_the_fmu_is_told_in_the_unit_of_the_gap(found: Diagnosis) -> None:
    (log,) = found.logs
    radian = replace(log, channels={"angle": Channel("angle", "angle", "rad")})
    told = replace(found, logs=(radian,))
    rows = (Accuracy("bench", "angle", "fit", 1400, 4e-3, 3e-3, 99.0, 1.0),)
    page = Page(diagnosis_page("Bench", told, confirmed=Confirmation(rows, 0.0)))
    (row,) = _cells(page, "bench")
    unit, scale = unit_for(told, told.gaps[0])
    assert unit == row[-1] == "mrad"
    assert row[4:6] == ["4", "3"]
    assert scale == 1e-3


def test_a_log_that_is_held_out_is_shown_where_it_is_worst(found: Diagnosis) -> None:
    """No fit has seen it; its worst sample is told all the same."""
    log = found.logs[0]
    checked = replace(log, name="later", held_out=np.ones(len(log.times), dtype=bool))
    problems = [
        replace(one.problem, logs=(log, checked))
        for one in (found.causes.retuned, found.causes.taken)
    ]
    causes = replace(
        found.causes,
        retuned=replace(found.causes.retuned, problem=problems[0]),
        taken=replace(found.causes.taken, problem=problems[1]),
    )
    text = _page(replace(found, logs=(log, checked), causes=causes))
    nominal = simulate(found.model, log.times, log.inputs)["angle"]
    worst = log.times[np.argmax(np.abs(nominal - log.outputs["angle"]))]
    assert len(re.findall(rf"is worst: \S+ deg at {worst:.5g} s", text)) == 2


def test_hostile_names_stay_text(found: Diagnosis) -> None:
    log = replace(
        found.logs[0],
        name=HOSTILE,
        channels={"angle": Channel("angle", "1", HOSTILE, DEGREE)},
    )
    audits = tuple(replace(one, log=log) for one in found.audits)
    gaps = tuple(replace(gap, worst=(HOSTILE, 0.1)) for gap in found.gaps)
    page = Page(_page(replace(found, logs=(log,), audits=audits, gaps=gaps)))
    page.assert_stands_alone()
    assert any(HOSTILE in piece for piece in page.text)


def test_logs_and_their_hashes_are_named(found: Diagnosis, text: str) -> None:
    assert found.logs[0].sha256 in text
    assert "bench.csv" in text
    assert "Python" in Page(text).text


@pytest.mark.parametrize(
    "names",
    [
        ("measured", "nominal", "re-tuned", "with effects"),
        ("constant load and sensor nonlinearity", "constant load and command offset"),
    ],
)
def test_names_of_curves_stay_inside_the_picture(names: tuple[str, ...]) -> None:
    with drawing("legend", rows=2, height=3.6) as (figure, (command, axes)):
        for name in names:
            axes.plot([0.0, 1.0], [0.0, 1.0], label=name)
        draw_legend(axes, len(names))
        figure.draw_without_rendering()
        legend = axes.get_legend()
        assert legend
        inside, whole = legend.get_window_extent(), figure.bbox
        assert whole.x0 <= inside.x0 < inside.x1 <= whole.x1
        assert inside.y1 <= command.get_window_extent().y0 + 3.0


def test_a_parameter_that_the_logs_do_not_determine_has_a_bar_of_the_whole_width(
    found: Diagnosis, recwarn: pytest.WarningsRecorder
) -> None:
    unknown = tuple(replace(one, standard_error=math.inf) for one in found.moved)
    text = diagnosis_page("Bench", replace(found, moved=unknown))
    assert "How far nominal parameters moved" in text
    assert not [it for it in recwarn if "overflow" in str(it.message)]
