"""Elements of a servo from bench tables, against a bench whose truth is known."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from pathlib import Path

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.analysis.compare import overshoot, settling_time, time_to
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import (
    BENT,
    Figure,
    Interval,
    amplifier,
    potentiometer,
)
from servo_models.identification.elements.identify import identify_elements
from servo_models.identification.elements.loop import REACHED, Loop
from servo_models.identification.elements.motor import NAMES, motor, motor_step
from servo_models.report.style import figure
from servo_models.report.terminal import text
from tests.support.servo_bench import DESCRIPTION, K_EN, Bench, taken_apart, write

WIDTH = "hysteresis width at the edges"
SHIFT = "shift of the line, rising to falling"
TABLES = 200
LOW, HIGH = 0.885, 0.995
"""Coverage of 95 % intervals in 200 tables: binomial, each end missed once in 10 000 times."""


def inside(estimate: Interval | None, truth: float) -> bool:
    return estimate is not None and estimate.low <= truth <= estimate.high


def told(measured: tuple[list[Figure], list[str]]) -> dict[str, Interval]:
    """Figures of an element by name."""
    return {figure.name: figure.estimate for figure in measured[0]}


def near(estimate: Interval | None, truth: float, within: float) -> bool:
    return estimate is not None and abs(estimate.value - truth) <= within


def test_the_printed_points_give_the_printed_gains() -> None:
    line = told(potentiometer(np.array([0.6, 1.8]), np.array([106.76, 617.53])))
    assert round(line["gain k_FS"].value, 2) == 425.64
    assert line["gain k_FS"].standard_error == math.inf  # two points leave nothing to judge by
    for ends, printed in (((-0.1, 2.65), 5.79), ((-1.15, 2.4), 7.47)):
        line = told(potentiometer(np.array([0.125, 0.6]), np.array(ends)))
        assert round(line["gain k_FS"].value, 2) == printed


@pytest.mark.parametrize("flat", ["limits", "upper limit", "dead band", "none"])
def test_a_table_with_flats_is_said_to_be_bent(flat: str) -> None:
    for seed in range(20):
        draw = np.random.default_rng([2, seed])
        x = np.linspace(0.125, 0.6, int(draw.integers(24, 50)))
        low, high = draw.uniform(0.18, 0.24), draw.uniform(0.48, 0.54)
        dead = np.clip(x, 0.32, 0.32 + draw.uniform(0.05, 0.09))
        travel = {
            "limits": np.clip(x, low, high),
            "upper limit": np.minimum(x, high),
            "dead band": x - dead,
            "none": x,
        }[flat]
        output = draw.uniform(4.0, 9.0) * travel + draw.normal(0.0, 0.03, len(x))
        assert bool(amplifier(x, output)[1]) == (flat != "none")


def test_the_motor_of_the_paper_is_found_in_its_table() -> None:
    bench = Bench(half_width=0.03)
    measured = motor(*bench.table(0.02, 0.013, 2.5, noise=3.0)[:2])
    curve, doubts = told(measured), measured[1]
    gain = curve["gain K_EN"]
    assert gain.value == pytest.approx(K_EN, abs=4.0 * gain.standard_error)
    assert gain.standard_error < 1.0
    for name, sign, edge, zero, knee, top in zip(
        NAMES, (1.0, -1.0), bench.edge, bench.zero, bench.knee, bench.top
    ):
        line = curve[f"zero of the line, {name}"]
        assert near(curve[f"insensitivity edge, {name}"], sign * edge, 0.02)
        assert near(curve[f"edge, rising, {name}"], sign * (edge + 0.03), 0.02)
        assert near(curve[f"edge, falling, {name}"], sign * (edge - 0.03), 0.02)
        assert near(line, sign * zero, 4.0 * line.standard_error)
        assert near(curve[f"top speed, {name}"], sign * top, 2.0)
        assert near(curve[f"saturation edge, {name}"], sign * knee, 0.01)
    assert near(curve[WIDTH], 0.06, 0.02)
    assert near(curve[SHIFT], 0.0, 0.004)
    assert not any("gains of both sides" in doubt or doubt == BENT for doubt in doubts)


def test_a_speed_that_leaps_to_its_top_is_told_from_one_that_bends() -> None:
    """As the paper says in words: saturation beyond 1.8 V, where its line is at 617.5 rad/s."""
    curve = told(motor(*Bench(knee=(1.8, 1.5)).table(0.04, 0.018, 2.5, noise=3.0)[:2]))
    saturation = curve["saturation edge, positive"]
    assert inside(saturation, 1.8)
    assert saturation.standard_error == pytest.approx(0.0115, rel=0.1)  # 0.04 V / sqrt(12)
    assert inside(curve["saturation edge, negative"], -1.5)
    assert inside(curve["gain K_EN"], K_EN)


def test_without_noise_everything_between_rows_is_exact() -> None:
    """What rounding leaves has no standard error to be judged by, and is no bow."""
    for seed in range(10):
        draw = np.random.default_rng([7, seed])
        gain, zero = draw.uniform(300.0, 550.0), draw.uniform(0.2, 0.4, 2)
        knee, edge = draw.uniform(1.4, 1.9, 2), zero + 0.1
        top = gain * (knee - zero)
        bench = Bench(gain, tuple(zero), tuple(edge), tuple(knee), tuple(top), 0.03 * (seed % 2))
        measured = motor(*bench.table(0.07, 0.02, 2.4)[:2])
        curve, doubts = told(measured), measured[1]
        assert not any("gains of both sides" in doubt or doubt == BENT for doubt in doubts)
        assert curve["gain K_EN"].value == pytest.approx(gain, rel=1e-12)
        assert curve["zero of the line, positive"].value == pytest.approx(zero[0], rel=1e-12)
        assert curve["saturation edge, positive"].value == pytest.approx(knee[0], rel=1e-12)
        assert inside(curve["insensitivity edge, negative"], -edge[1])
        assert seed % 2 or near(curve[WIDTH], 0.0, 0.0)


@pytest.mark.parametrize("sides", [(1,), (-1,), (1, -1), ()])
def test_a_bow_of_either_side_is_told(sides: tuple[int, ...]) -> None:
    voltages, speeds, _ = Bench(half_width=0.0).table(0.05, 0.02, 1.2, noise=0.2)
    bowed = np.isin(np.sign(voltages), sides) & (np.abs(speeds) > 10.0)
    bow = np.where(bowed, np.sign(voltages) * 300.0 * (np.abs(voltages) - 0.9) ** 2, 0.0)
    assert (BENT in motor(voltages, speeds + bow)[1]) == bool(sides)


def test_a_branch_column_says_what_the_order_of_rows_says() -> None:
    voltages, speeds, rising = Bench(half_width=0.04).table(0.05, 0.01, 2.5, noise=3.0)
    mixed = np.random.default_rng(1).permutation(len(voltages))
    by_column = told(motor(voltages[mixed], speeds[mixed], 1.0 * rising[mixed]))
    ordered = told(motor(voltages, speeds))
    assert by_column["edge, rising, positive"] == ordered["edge, rising, positive"]
    assert by_column[WIDTH] == ordered[WIDTH]
    assert by_column["gain K_EN"].value == pytest.approx(ordered["gain K_EN"].value, rel=1e-9)


@pytest.mark.long
def test_intervals_of_the_motor_cover_the_truth() -> None:
    """Random motors, with and without jumps at both edges, on random grids."""
    hits: dict[str, list[bool]] = defaultdict(list)
    for seed in range(TABLES):
        draw = np.random.default_rng([1, seed])
        gain, half = draw.uniform(300.0, 550.0), draw.uniform(0.0, 0.08)
        zero, knee = draw.uniform(0.2, 0.4, 2), draw.uniform(1.4, 1.9, 2)
        leap = draw.choice([1.0, 1.1])
        edge = zero + draw.uniform(0.1, 0.3, 2)
        top = leap * gain * (knee - zero)
        bench = Bench(gain, tuple(zero), tuple(edge), tuple(knee), tuple(top), half)
        step = draw.uniform(0.03, 0.1)
        table = bench.table(step, draw.uniform(0.1, 1.0) * step, 2.4, draw.uniform(2.0, 6.0), seed)
        curve = told(motor(*table[:2]))
        truth = {"gain K_EN": gain, WIDTH: 2.0 * half, SHIFT: 0.0}
        for k, (name, sign) in enumerate(zip(NAMES, (1.0, -1.0))):
            truth[f"gain, {name}"] = gain
            truth[f"zero of the line, {name}"] = sign * zero[k]
            truth[f"insensitivity edge, {name}"] = sign * edge[k]
            truth[f"edge, rising, {name}"] = sign * (edge[k] + half)
            truth[f"edge, falling, {name}"] = sign * (edge[k] - half)
            truth[f"saturation edge, {name}"] = sign * knee[k]
            truth[f"top speed, {name}"] = sign * top[k]
        for name, value in truth.items():
            hits[name].append(inside(curve.get(name), value))
    for name, each in hits.items():
        assert LOW <= np.mean(each) <= HIGH, (name, np.mean(each))


def test_intervals_of_the_time_constant_cover_the_truth() -> None:
    """Records made by python-control, with the step somewhere in them."""
    hits: dict[str, list[bool]] = defaultdict(list)
    for seed in range(TABLES):
        draw = np.random.default_rng([3, seed])
        constant, gain, size = draw.uniform(0.2, 1.5), draw.uniform(200, 500), draw.uniform(0.5, 2)
        times = np.arange(0.0, 6.0 * constant, constant * draw.uniform(0.02, 0.05))
        before = int(draw.integers(0, 20))
        rest = times[: len(times) - before]
        _, moved = control.step_response(control.tf([gain * size], [constant, 1.0]), rest)
        speeds = np.concatenate([np.zeros(before), moved])
        speeds = speeds + draw.normal(0.0, 0.01 * gain * size, len(times))
        voltages = np.where(np.arange(len(times)) >= before, size, 0.0)
        step = told(motor_step(times, speeds, voltages))
        alone = told(motor_step(times[before:], speeds[before:]))
        hits["time constant"].append(inside(step["time constant T"], constant))
        hits["gain"].append(inside(step["gain of the step"], gain))
        hits["without voltage"].append(inside(alone["time constant T"], constant))
    for name, each in hits.items():
        assert LOW <= np.mean(each) <= HIGH, (name, np.mean(each))


PAPER_LOOP = Loop(633.3 * 7.47 / 24.0 * 0.025, 1.307)


def test_the_feedback_coefficient_of_the_paper() -> None:
    """K_f = 0.18 with 4.84 % overshoot for +-5 %; +-2 % would choose 0.1425 (SG90 paper sec. 6)."""
    five, two = (PAPER_LOOP.response(PAPER_LOOP.best(b, 0.05), (0.05, 0.02)) for b in (0.05, 0.02))
    assert five.k_f == pytest.approx(0.1815, abs=0.0005)
    assert five.settling[0.05] == pytest.approx(3.03, abs=0.02)
    assert two.k_f == pytest.approx(0.1425, abs=0.0001)
    assert two.settling[0.02] == pytest.approx(4.30, abs=0.005)
    printed = PAPER_LOOP.response(0.18, (0.05,))
    assert 100.0 * printed.overshoot == pytest.approx(4.84, abs=0.01)
    assert printed.time_constant == pytest.approx(2.6, abs=0.05)
    assert PAPER_LOOP.response(0.1, (0.05,)).time_constant == pytest.approx(4.6, abs=0.05)


@settings(max_examples=10, deadline=None)
@given(st.floats(0.2, 30.0), st.floats(0.3, 10.0), st.floats(0.15, 2.5), st.floats(0.005, 0.2))
def test_the_closed_forms_agree_with_python_control(
    gain: float, rate: float, damping: float, band: float
) -> None:
    loop = Loop(gain, rate)
    k_f = (rate / (2.0 * damping)) ** 2 / gain
    response = loop.response(k_f, (band,))
    closed = control.tf([gain * k_f], [1.0, rate, gain * k_f])
    slowest = min(-closed.poles().real)
    times = np.linspace(0.0, 12.0 / slowest, 20_001)
    _, values = control.step_response(closed, times)
    step = times[1]
    assert response.time_constant == pytest.approx(
        time_to(times, values, REACHED, final=1.0), abs=0.1 * step
    )
    assert response.overshoot == pytest.approx(overshoot(times, values, final=1.0), abs=1e-5)
    settled = settling_time(times, values, band, final=1.0)
    touches = (
        abs(math.log(band) / math.log(response.overshoot) % 1.0) if response.overshoot else 0.5
    )
    if 1e-3 < touches < 1.0 - 1e-3:  # where an extreme touches the band, a grid may miss it
        assert response.settling[band] == pytest.approx(settled, abs=step)
    assert abs(closed(1j * response.bandwidth)) == pytest.approx(math.sqrt(0.5), rel=1e-9)
    _, margin, *_ = control.margin(control.tf([gain * k_f], [1.0, rate, 0.0]))
    assert math.degrees(response.phase_margin) == pytest.approx(margin, rel=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.001, 0.2), st.floats(0.005, 0.5))
def test_no_feedback_coefficient_settles_faster_than_the_best(band: float, limit: float) -> None:
    others = np.linspace(0.2, 1.0, 400) * PAPER_LOOP.k_f(limit)
    best, *others = (
        PAPER_LOOP.response(float(k_f), [band]) for k_f in (PAPER_LOOP.best(band, limit), *others)
    )
    assert best.overshoot <= limit * (1.0 + 1e-9)
    fastest = min(other.settling[band] for other in others)
    assert best.settling[band] <= fastest * (1.0 + 1e-9)


TRUTH = {
    "potentiometer_gain": 0.025 * 180.0 / math.pi,
    "amplifier_gain": 7.4737,
    "motor_gain": K_EN,
    "edge_positive": 0.5,
    "edge_negative": 0.6,
    "zero_positive": 0.6 - 106.76 / K_EN,
    "zero_negative": 1.5 - 544.0 / K_EN,
    "top_positive": 670.0,
    "top_negative": 544.0,
    "hysteresis.half_width": 0.03,
    "motor_time_constant": 1.0 / 1.307,
}


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    return taken_apart(tmp_path)


def test_a_servo_taken_apart_becomes_the_actuator_that_it_was(bench: Path) -> None:
    result = identify_elements(bench)
    for name, truth in TRUTH.items():
        value, error = result.parameters[name]
        assert value == pytest.approx(truth, abs=3.5 * error), name
        assert error > 0.0
    assert result.parameters["gear_ratio"] == (24.0, 0.0)
    assert result.parameters["feedback_coefficient"][0] == 0.18
    assert set(result.files) == {"potentiometer.csv", "amplifier.csv", "motor.csv", "step.csv"}
    values = {name: value for name, (value, _) in result.parameters.items()}
    assert model("sg90", "printed", values).values["motor_gain"] == values["motor_gain"]
    chosen, other = result.synthesis.choices
    assert (chosen.band, other.band) == (0.05, 0.02)
    assert chosen.optimum.k_f == pytest.approx(0.18197, abs=3.5 * 0.182 * chosen.relative_error)
    assert other.optimum.k_f == pytest.approx(0.14255, abs=3.5 * 0.143 * other.relative_error)
    assert {0.05, 0.1, 0.18} <= {row.k_f for row in result.synthesis.rows}
    assert any("static line" in warning for warning in result.warnings)  # 484.5 against 425.6


def test_figures_have_the_signs_and_units_of_the_bench(bench: Path) -> None:
    result = identify_elements(bench)
    edge = result.figure("motor", "insensitivity edge, negative")
    assert edge.value == pytest.approx(-0.6, abs=0.02)
    assert result.figure("motor", "top speed, negative").value == pytest.approx(-544.0, abs=2.0)
    assert result.figure("amplifier", "gain K_AP").value == pytest.approx(5.79, abs=0.05)
    document = json.loads(result.to_json())
    assert document["parameters"]["edge_negative"]["value"] == pytest.approx(0.6, abs=0.02)
    assert result.tables()["Parameters"]["parameter"].to_list() == list(result.parameters)
    shown = text(result.report(), 200)
    for words in ("V/deg", "chosen", "time constant [s]", "settling +-5 % [s]", "+-2 %", "rad/s/V"):
        assert words in shown


def test_what_is_not_measured_is_that_of_the_variant(tmp_path: Path) -> None:
    path = tmp_path / "servo.toml"
    path.write_text(
        'actuator = "sg90"\nvariant = "linear"\n[elements.gears]\nteeth = [[8, 48], [8, 32]]\n'
    )
    result = identify_elements(path)
    chosen = result.synthesis.choices[0]
    assert (chosen.setting.k_f, chosen.relative_error) == (0.18, 0.0)
    assert 100.0 * chosen.setting.overshoot == pytest.approx(4.84, abs=0.01)
    tried = [row.k_f for row in result.synthesis.rows]
    assert (min(tried), max(tried)) == pytest.approx((0.18 / 4.0, 0.18 * 2.0))
    assert set(result.parameters) == {"gear_ratio", "feedback_coefficient"}
    assert any("amplifier_gain" in note for note in result.notes)


def test_the_picture_marks_the_choice_of_both_bands(bench: Path) -> None:
    result = identify_elements(bench)
    drawn = figure(result.report().pictures[0])
    marks = {
        round(float(np.asarray(line.get_xdata())[0]), 9)
        for axes in drawn.axes
        for line in axes.lines
        if line.get_marker() not in ("", "None", None)
    }
    assert marks == {round(choice.optimum.k_f, 9) for choice in result.synthesis.choices}
    assert len(drawn.axes) == 2


VOLTAGES, SPEEDS, _ = Bench().table(0.05, 0.02, 2.5)
UP, FAST = VOLTAGES > 0.0, np.abs(VOLTAGES) > 1.0


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ((VOLTAGES[UP], SPEEDS[UP]), ("voltage and speed", "no negative voltage", "directions")),
        ((VOLTAGES, FAST * np.sign(VOLTAGES)), ("no linear region at positive", "add 3 rows")),
        (([-1.0, 1.0], [-1.0, 1.0]), ("column 'U_mV' has 2 rows", "at least 8")),
        ((np.linspace(-1, 1, 20), np.zeros(20)), ("'n' is constant", "measure over a range")),
        ((VOLTAGES, -SPEEDS), ("never turns", "sign of the speed")),
        ("3,-1e308", ("row 11", "column 'n'", "more than any signal has", "correct the number")),
        ("3,stuck", ("row 11", "column 'n'", "'stuck' is not a number")),
    ],
)
def test_a_bad_table_is_one_line_with_its_cure(
    bench: Path, rows: str | tuple[Array, Array], words: tuple[str, ...]
) -> None:
    path = bench.parent / "motor.csv"
    if isinstance(rows, str):
        path.write_text("U_mV,n\n" + "1,2\n" * 9 + rows + "\n")
    else:
        write(path, U_mV=1e3 * np.array(rows[0]), n=np.array(rows[1]))
    with pytest.raises(UserError, match=r"^[^\n]*motor\.csv[^\n]*$") as caught:
        identify_elements(bench)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[elements.gears]", "[elements.gear]", "did you mean 'gears'?"),
        ("teeth = [[8, 48], [8, 32]]", "teeth = [8, 48]", "elements.gears.teeth"),
        ('unit = "rpm"', 'unit = "V"', "elements.motor.speed.unit"),
        ('column = "U_mV"', 'column = "U"', "has no column 'U'"),
        ("k_f = [0.05, 0.1]", 'band = "200 %"', "elements.synthesis.band"),
        ('column = "U", unit = "V"', 'column = "U", unit = "V", sign = -1', "potentiometer_gain"),
        ('actuator = "sg90"\nvariant = "printed"', 'actuator = "torque_motor"', "such as sg90"),
        ('file = "motor.csv"', "", "elements.motor.file: missing"),
    ],
)
def test_a_bad_description_is_one_line_with_its_cure(
    bench: Path, old: str, new: str, words: str
) -> None:
    assert old in DESCRIPTION
    bench.write_text(DESCRIPTION.replace(old, new))
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        identify_elements(bench)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("speeds", "voltages", "words"),
    [
        (np.linspace(0.0, 1.0, 50), None, "does not settle"),
        (np.ones(4) - np.exp(-np.arange(4.0)), None, "rows after the step"),
        (np.ones(50), np.tile([0.0, 1.0], 25), "more than once"),
    ],
)
def test_a_record_that_is_no_step_is_told(
    speeds: Array, voltages: Array | None, words: str
) -> None:
    with pytest.raises(UserError, match=words):
        motor_step(np.arange(len(speeds)) * 0.1, speeds, voltages)
