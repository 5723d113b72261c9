"""The report: true to its validation, safe, self-contained, legible, the same every time."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.errors import UserError
from servo_models.report.numbers import number
from servo_models.report.result import report_of
from servo_models.report.style import PALETTE
from servo_models.validation.live import panel
from servo_models.validation.rows import (
    IMPLEMENTATION,
    MODEL,
    PAPER,
    CostCurve,
    CostPoint,
    Row,
    Validation,
    judged,
    tightest,
)
from servo_models.validation.sections import DIGITS, cards, remarks, sentence, share
from servo_models.validation.sg90 import pictures as sg90
from servo_models.validation.sg90.paper import PRINTED_TIMES, TIME_CONSTANT
from servo_models.validation.smart_servo import pictures as smart_servo
from servo_models.validation.torque_motor import pictures as torque_motor
from tests.support.html_page import Page

HOSTILE = "<script>alert('x')</script> & \"quoted\""

EQUAL = judged(IMPLEMENTATION, ("sg90", "linear", "0.7 ms"), "angle", 0.0, 1e-12)
CLOSE = judged(MODEL, ("torque_motor", "identified", "step"), "rate", 3.7e-6, 1e-5)
WRONG = judged(MODEL, ("torque_motor", "measured", "step"), "angle", 2e-6, 1e-6, note=HOSTILE)
PRINTED = Row(PAPER, "sg90", "linear_kf018", "step", "overshoot", 4.845, 0.01, "%", True, "", 4.84)
OPEN = Row(PAPER, "sg90", "linear_kf005", "step", "T_SA", 9.8, None, "s", None, "no reading", 7.5)
COST = CostCurve(
    "sg90",
    "linear",
    "step",
    1e-3,
    tuple(CostPoint(h, {"angle": h**4, "rate": 9 * h**4}, 1e-8 / h) for h in (1e-4, 1e-3, 5e-3)),
)
GOOD = Validation((EQUAL, CLOSE, PRINTED, OPEN), (COST,), {"Python": "3.11"})
BAD = Validation((EQUAL, WRONG, CLOSE), (), {"tool": HOSTILE})


@pytest.fixture(scope="module")
def text(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("report") / "good.html"
    GOOD.write_report(path, "2024-02-29")
    return path.read_text("utf-8")


@pytest.fixture(scope="module")
def bad(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("report") / "bad.html"
    BAD.write_report(path)
    return path.read_text("utf-8")


def test_page_is_whole_and_stands_alone(text: str) -> None:
    Page(text).assert_stands_alone()
    assert len(text.encode()) < 2_000_000


def test_every_picture_has_a_name_and_every_table_a_caption(text: str) -> None:
    page = Page(text)
    assert page.count("svg") == page.count("figcaption") == page.count("figure") == 11
    assert all(attrs.get("aria-label") for tag, attrs in page.tags if tag == "svg")
    assert page.count("caption") > 0


def test_no_heading_of_a_page_is_there_twice(text: str, bad: str) -> None:
    for page in (text, bad):
        headings = re.findall(r"<(?:h2|caption)>(.*?)</", page)
        assert len(headings) > 5
        assert sorted(set(headings)) == sorted(headings)


def test_a_notebook_names_a_table_by_its_section() -> None:
    assert "<caption>Figures that pass</caption>" in GOOD._repr_html_()


def test_its_title_names_what_was_examined() -> None:
    assert report_of(GOOD).title == "sg90, torque_motor against references"
    assert report_of(Validation((), (), {})).title == "nothing against references"


@pytest.mark.thorough
def test_same_validation_and_date_give_the_same_bytes(text: str, tmp_path: Path) -> None:
    GOOD.write_report(tmp_path / "again.html", "2024-02-29")
    assert (tmp_path / "again.html").read_text("utf-8") == text
    assert "2024-02-29" in text


def test_hostile_text_stays_text(bad: str) -> None:
    page = Page(bad)
    page.assert_stands_alone()
    assert page.text.count(HOSTILE) == 4  # three times as a note, once as a condition


def test_every_row_is_in_the_page(text: str) -> None:
    for row in GOOD.rows:
        assert row.quantity in text
        assert row.variant in text
        assert number(row.value) in text


def test_a_verdict_is_a_word_not_a_colour_alone(bad: str) -> None:
    verdicts = re.findall(r'class="verdict (\w+)">(.) (\w+)', bad)
    assert set(verdicts) == {("pass", "✓", "passed"), ("fail", "✗", "failed")}


@pytest.mark.parametrize(
    ("validation", "verdict"),
    [
        (GOOD, "PASSED: all 3 figures are within their limits."),
        (BAD, "FAILED: 1 of 3 figures are outside their limits."),
        (Validation(()), "Nothing was judged."),
        (Validation((OPEN,)), "Nothing was judged."),
    ],
)
def test_sentence(validation: Validation, verdict: str) -> None:
    assert sentence(validation) == verdict


def test_what_was_not_examined_is_said() -> None:
    assert remarks(Validation((CLOSE,))) == (
        "Not examined: FMU equals simulation.",
        "Not examined: Figures of the papers.",
    )
    assert [card.text for card in cards(Validation((CLOSE,)))] == [
        "not examined",
        "1 of 1 figures pass",
        "not examined",
    ]


def test_a_failure_comes_first(bad: str) -> None:
    assert bad.index('id="outside-their-limits"') < bad.index('id="implementation-')
    model_ = bad[bad.index('id="model-') :]
    assert model_.index("nearest to its limit") < model_.index("<details>")


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (4.845, "4.845"),
        (-1.03, "\N{MINUS SIGN}1.03"),
        (4.8e-7, "4.8\N{MULTIPLICATION SIGN}10⁻⁷"),
        (-1.5e-12, "\N{MINUS SIGN}1.5\N{MULTIPLICATION SIGN}10⁻¹²"),
        (9.999e-4, "1\N{MULTIPLICATION SIGN}10⁻³"),
        (184512000.0, "1.85\N{MULTIPLICATION SIGN}10⁸"),
        (None, "\N{EN DASH}"),
        (math.inf, "inf"),
    ],
)
def test_numbers(value: float | None, shown: str) -> None:
    assert number(value) == shown


def test_coefficients_of_the_papers_keep_their_digits() -> None:
    assert number(197.11, DIGITS) == "197.11"
    assert number(1582240.0, DIGITS) == "1.58224\N{MULTIPLICATION SIGN}10⁶"
    assert number(184512000.0, DIGITS) == "1.84512\N{MULTIPLICATION SIGN}10⁸"


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0 %"), (3.7e-9, "< 1 %"), (3.7e-6, "37 %"), (2e-5, "200 %"), (2e-4, "20 times")],
)
def test_share_of_the_limit(value: float, shown: str) -> None:
    assert share(judged(MODEL, ("a", "b", "c"), "q", value, 1e-5)) == shown


def test_tightest_is_what_failed_or_what_is_nearest_to_its_limit() -> None:
    absent = judged(MODEL, ("a", "b", "c"), "settling", None, 1e-5)
    assert tightest([EQUAL, CLOSE]) is CLOSE
    assert tightest([WRONG, EQUAL, CLOSE]) is WRONG
    assert tightest([CLOSE, absent, EQUAL]) is absent


def test_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="choose a folder"):
        Validation(()).write_report(tmp_path / "file" / "report.html")


@pytest.mark.parametrize(("hertz", "point"), torque_motor.EQ_12_POINTS.items())
def test_sine_runs_meet_the_transfer_function(hertz: float, point: tuple[float, float]) -> None:
    import control

    plant = control.tf([241560.0], [1.0, 492.0, 1582240.0, 184512000.0])
    s = 2j * math.pi * hertz
    exact = complex(plant(s)) * np.exp(-0.0011 * s)
    got = torque_motor._response(hertz)
    assert abs(got / exact - 1.0) < 1e-5
    assert 20.0 * math.log10(abs(exact) / plant.dcgain()) == pytest.approx(point[0], abs=0.005)
    assert math.degrees(np.angle(exact)) == pytest.approx(point[1], abs=0.05)


def test_rings_of_the_torque_motor_lie_on_its_curve() -> None:
    run = torque_motor._step(40.0, stops=False)
    for milliseconds, part in torque_motor.FRACTIONS.items():
        angle = math.degrees(np.interp(milliseconds * 1e-3, run.times, run["angle"]))
        assert angle / torque_motor.FINAL == pytest.approx(part, abs=1e-3)


def test_marks_of_the_sg90_tell_the_truth() -> None:
    reached = {}
    for ending, k_f in sg90.COEFFICIENTS.items():
        run = sg90._step(f"linear{ending}", stop=60.0)
        share_ = run["angle"] / run["angle"][-1]
        reached[k_f] = float(np.interp(PRINTED_TIMES[k_f], run.times, share_))
    assert reached[0.18] == pytest.approx(TIME_CONSTANT, abs=0.005)
    assert reached[0.1] == pytest.approx(TIME_CONSTANT, abs=0.005)
    assert reached[0.05] < TIME_CONSTANT - 0.05


def test_figures_of_both_servos_are_those_of_their_responses() -> None:
    """Against crossings of densely simulated steps and the fundamental of a simulated sine."""
    rows = {row.name: row for row in sg90.compare()}
    for kind, stop in (("measured", 1.0), ("printed", 20.0)):
        chosen = model("sg90", kind)
        times = np.linspace(0.0, stop, 20_001)
        angle = np.degrees(simulate(chosen, times, {"pulse_width": 2e-3})["angle"])
        final = angle[-1]
        low, high = (times[np.argmax(angle >= part * final)] for part in (0.1, 0.9))
        away = np.flatnonzero(np.abs(angle - final) > 0.05 * final)[-1]
        exact = {
            "slew time": 60.0 * (high - low) / (0.8 * final),
            "rise from 10 % to 90 %": high - low,
            "settling to ±5 %": times[away + 1],
            "overshoot": 100.0 * (angle.max() / final - 1.0),
            "angle after the step": final,
        }
        for name, value in exact.items():
            assert getattr(rows[name], kind) == pytest.approx(value, rel=3e-3, abs=0.03), name
        bandwidth = getattr(rows["bandwidth (-3 dB)"], kind)
        times = np.arange(12 * 400 + 1) / (400 * bandwidth)
        wave = np.exp(2j * np.pi * bandwidth * times)
        pulse = 1.5e-3 + 0.5e-3 * wave.imag
        settled = simulate(chosen, times, {"pulse_width": pulse})["angle"][-1601:-1]
        gain = 2.0 * abs(np.mean(settled / wave[-1601:-1])) / 0.5e-3
        static = math.radians(final) / 0.5e-3
        assert gain / static == pytest.approx(math.sqrt(0.5), rel=0.02), kind


def test_how_far_apart_the_servos_are_is_said_with_the_figures_of_the_table() -> None:
    rows = sg90.compare()
    said = sg90.SECTIONS[0].lead
    slow = [row.printed / row.measured for row in rows if row.unit in ("s", "s/60 deg")]
    assert f"{min(slow):.2g} to {max(slow):.2g} times slower" in said
    for name, digits in (("slew time", 2), ("angle after the step", 3)):
        row = next(row for row in rows if row.name == name)
        assert f"{row.printed:.{digits}g}" in said
        assert f"{row.measured:.{digits}g}" in said


def test_friction_of_the_smart_servo_holds_what_the_duty_cannot_move() -> None:
    run = smart_servo._run(smart_servo.FRICTION)
    chosen = model("smart_servo", "xl330")
    values, supply = chosen.values, float(chosen.plant.wire["supply"].rest)
    assert run["rate"][-1] == 0.0
    assert abs(run["angle"][-1] - smart_servo.GOAL) > math.radians(1.0)
    stalled = values["torque_constant"] * supply * abs(run["duty"][-1]) / values["resistance"]
    assert 0.0 < stalled < smart_servo.FRICTION


@pytest.mark.parametrize("page", [0, 1], ids=["light", "dark"])
@pytest.mark.parametrize("name", ["ink", "muted", "blue", "orange", "green", "purple"])
@pytest.mark.parametrize("ground", ["paper", "shade"])
def test_colours_are_legible(name: str, ground: str, page: int) -> None:
    """WCAG 2.1, success criterion 1.4.3: at least 4.5 to 1."""

    def luminance(colour: str) -> float:
        parts = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    light, dark = sorted(luminance(PALETTE[key][page]) for key in (name, ground))[::-1]
    assert (light + 0.05) / (dark + 0.05) >= 4.5


def test_the_panel_opens_on_the_sg90() -> None:
    shown = (("dc_motor", "direct"), ("sg90", "measured"))
    rows = tuple(replace(GOOD.rows[0], actuator=it, variant=variant) for it, variant in shown)
    opened = panel(replace(GOOD, rows=rows))
    assert opened
    assert [it.actuator for it in opened.models] == ["sg90", "dc_motor"]
