"""Transfer functions from records and sweeps, against other solvers and known truths."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import chirp, lsim

from servo_models import UserError, model, simulate
from servo_models.actuators.torque_motor.variants import EQ_12, EQ_12_DELAY
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.data.schema import read_toml
from servo_models.identification.transfer.fit import fit
from servo_models.identification.transfer.functions import STRUCTURES, Structure, TransferFunction
from servo_models.identification.transfer.identify import (
    Candidate,
    TransferResult,
    choose,
    identify_transfer,
    pole_trouble,
)
from servo_models.identification.transfer.measurements import Record, Sweep
from servo_models.identification.transfer.sweeps import read_sweeps
from servo_models.report.style import figure
from servo_models.validation.solvers import LinearSystem, changes
from servo_models.validation.torque_motor.reference import TABLE_1
from tests.support.transfer_logs import DT, EQUATION_12, MOTOR, log

MODEL_1 = TransferFunction.of([686.9], [1.0, 3.434e-11, 2.255])
MODEL_2 = TransferFunction.of([633.3], [1.0, 1.307])


def record(times: Array, u: Array, y: Array) -> Record:
    return Record("record", times, u, y, np.zeros(len(times), dtype=bool))


def motor_logs(seed: int, noise: float, rate: float = 1.0 / DT) -> list[Log]:
    """Step, sweep, and a square wave to score on."""
    rng = np.random.default_rng(seed)
    step, sweep = np.arange(0.0, 0.2, 1.0 / rate), np.arange(0.0, 1.0, 1.0 / rate)
    signals = {
        "step": (step, np.where(step < 0.01, 0.0, 25.0)),
        "sweep": (sweep, 20.0 * chirp(sweep, 2.0, 1.0, 400.0, method="logarithmic")),
        "square": (step, np.where(np.floor(step / 0.03) % 2 == 0, 0.0, -20.0)),
    }
    return [
        log(
            name,
            times,
            u,
            simulate(MOTOR, times, {"voltage": u})["angle"]
            + noise * rng.standard_normal(len(times)),
            held_out=name == "square",
        )
        for name, (times, u) in signals.items()
    ]


def fitted(structure: Structure, data: Record | Sweep) -> TransferFunction:
    found = fit(structure, [data])
    assert found
    return found[0]


def deviations(candidate: Candidate, truth: list[float]) -> Array:
    """Of the coefficients, in standard errors."""
    return (candidate.function.coefficients - np.array(truth)) / candidate.standard_errors


poles = st.lists(st.floats(1.0, 30.0), min_size=1, max_size=5)


@pytest.mark.thorough
@settings(deadline=None, max_examples=40)
@given(poles, st.floats(0.0, 0.3), st.integers(0, 2**32 - 1), st.booleans())
def test_responses_are_exact_on_any_grid_with_any_delay(
    sizes: list[float], delay: float, seed: int, regular: bool
) -> None:
    """Against the reference's matrix exponential, which shares no code with the fit."""
    rng = np.random.default_rng(seed)
    times = np.arange(60) * 0.02
    if not regular:
        times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.005, 0.04, 59))])
    u = rng.choice([0.0, 1.0, -2.0], len(times))
    bottom = np.poly([-s for s in sizes])
    top = rng.uniform(-1.0, 1.0, rng.integers(1, len(sizes) + 1)) * bottom[-1]
    function = TransferFunction.of(top, bottom, delay)
    edges = changes(times, u, delay)
    expected = LinearSystem.transfer(top, bottom).response(times, [edges])[:, 0]
    error, _ = record(times, u, expected).errors(function)
    scale = np.polyval(np.abs(top), max(sizes)) / bottom[-1]
    assert np.max(np.abs(error)) < 1e-7 * scale


@pytest.mark.parametrize("structure", [Structure(1), Structure(3, 1, True), Structure(5, 4, True)])
def test_slopes_are_the_derivatives_of_the_errors(structure: Structure) -> None:
    rng = np.random.default_rng(1)
    times = np.arange(300) * 0.01
    u = np.repeat(rng.standard_normal(30), 10)
    bottom = np.poly(-np.array([2.0, 3.0, 5.0, 7.0, 9.0][: structure.poles]))
    top = rng.uniform(0.5, 1.0, structure.zeros + 1) * bottom[-1]
    base = TransferFunction.of(top, bottom, 0.0234 if structure.delay else 0.0)
    w = np.geomspace(0.1, 50.0, 30)
    sweep = Sweep("s", "u", "y", w, np.exp(-1j * w / 9.0), np.zeros(30, bool))
    x = base.coefficients
    for data in (record(times, u, np.zeros(300)), sweep):
        _, slopes = data.errors(base)
        for k in range(len(x)):
            step = np.zeros(len(x))
            step[k] = 1e-6 * max(abs(x[k]), 1e-3)
            up, _ = data.errors(structure.function(x + step))
            down, _ = data.errors(structure.function(x - step))
            numeric = (up - down) / (2.0 * step[k])
            assert np.max(np.abs(numeric - slopes[:, k])) < 1e-4 * np.max(np.abs(slopes[:, k]))


CASES = {
    "first order": TransferFunction.of([3.0], [1.0, 2.0]),
    "second order": TransferFunction.of([50.0], [1.0, 2.0, 25.0]),
    "with a zero": TransferFunction.of([10.0, 50.0], [1.0, 2.0, 25.0]),
    "non-minimum phase": TransferFunction.of([-5.0, 50.0], [1.0, 2.0, 25.0]),
    "with a delay": TransferFunction.of([3.0], [1.0, 2.0], 0.137),
    "mostly delay": TransferFunction.of([30.0], [1.0, 20.0], 0.713),
    "third order": TransferFunction.of([75.0], np.polymul([1.0, 3.0], [1.0, 2.0, 25.0]), 0.043),
    "fourth order": TransferFunction.of(
        [40.0, 500.0], np.polymul([1.0, 1.0, 25.0], [1.0, 6.0, 100.0])
    ),
    "fifth order": TransferFunction.of(
        [5e3, 2.5e4], np.polymul(np.polymul([1.0, 1.0, 25.0], [1.0, 6.0, 100.0]), [1.0, 4.0])
    ),
}


def clean(true: TransferFunction, kind: str) -> Record | Sweep:
    """A record of steps and a chirp, by the reference's matrix exponential; or a sweep."""
    if kind == "sweep":
        w = np.geomspace(0.3, 40.0, 60)
        return Sweep("s", "u", "y", w, true.response(w), np.zeros(60, bool))
    times = np.arange(0.0, 20.0, 0.01)
    u = np.where(times < 1.0, 0.0, 1.0) + np.where(times > 6.0, chirp(times - 6.0, 0.1, 14, 5), 0.0)
    bottom = LinearSystem.transfer(true.numerator, true.denominator)
    return record(times, u, bottom.response(times, [changes(times, u, true.delay)])[:, 0] + 0.7)


@pytest.mark.parametrize("kind", [pytest.param("record", marks=pytest.mark.thorough), "sweep"])
@pytest.mark.parametrize("name", CASES)
def test_clean_data_give_the_function_back(name: str, kind: str) -> None:
    true = CASES[name]
    found = fitted(true.structure, clean(true, kind))
    assert found.denominator == pytest.approx(true.denominator, rel=1e-4)
    assert found.numerator == pytest.approx(true.numerator, rel=1e-4)
    assert found.delay == pytest.approx(true.delay, abs=1e-6)


def test_offset_and_held_out_samples_do_not_move_the_estimate() -> None:
    rng = np.random.default_rng(4)
    times = np.arange(0.0, 5.0, 0.01)
    u = np.sign(np.sin(times * (1.0 + times)))
    _, y, _ = lsim(([3.0], [1.0, 2.0]), u, times, interp=False)
    y += 0.01 * rng.standard_normal(len(times))
    hidden = times > 3.0
    spoilt = np.where(hidden, 100.0, y + 5.0)
    found = [fitted(Structure(1), Record("r", times, u, values, hidden)) for values in (y, spoilt)]
    assert found[0].numerator == pytest.approx(found[1].numerator, rel=1e-6)
    assert found[0].denominator == pytest.approx(found[1].denominator, rel=1e-6)


def test_residuals_are_judged_at_their_own_times_where_samples_are_held_out() -> None:
    """What is left is correlated over 20 samples, and stretches have 22 samples."""
    times = 0.01 * np.arange(8800.0)
    noise, u = np.random.default_rng(0).standard_normal((2, len(times)))
    y = lsim(([3.0], [1.0, 2.0]), u, times, interp=False)[1] + 0.05 * noise
    hidden = np.arange(len(times)) % 44 >= 22
    function = TransferFunction.of([3.0], [1.0, 2.0])
    for values, least, most in ((y, 1e-3, 1.0), (y + 0.05 * np.roll(noise, 20), 0.0, 1e-6)):
        data = [Record("r", times, u, values, hidden)]
        white = Candidate.of("", function, np.zeros((2, 2)), data).white
        assert white is not None
        assert least <= white <= most


def of_the_motor(structures: list[Structure]) -> TransferResult:
    return identify_transfer(motor_logs(11, noise=5e-4), model=MOTOR, structures=structures)


@pytest.fixture(scope="module")
def chosen_for_the_motor() -> TransferResult:
    return of_the_motor([Structure(2, 0, True), Structure(3, 0, False), Structure(3, 0, True)])


@pytest.mark.long
def test_third_order_with_delay_is_chosen_for_the_torque_motor() -> None:
    found = of_the_motor([s for s in STRUCTURES if s.poles <= 4 and s.zeros <= 1])
    assert found.chosen.name == "order 3 + delay"
    assert np.all(np.abs(deviations(found.chosen, [*EQ_12, EQ_12_DELAY])) < 3.5)
    assert found.chosen.standard_errors[-1] < 1e-5
    reasons = {c.name: c.reason for c in found.candidates}
    assert "held-out" in reasons["order 3"]
    assert "held-out" in reasons["order 2 + delay"]
    assert reasons["order 4 + delay"]


@pytest.mark.thorough
def test_report_and_picture_show_what_was_chosen(chosen_for_the_motor: TransferResult) -> None:
    text = str(chosen_for_the_motor.report())
    assert "order 3 + delay: G(s) = " in text
    assert text.count("chosen") == 1
    assert "torque_constant" in text
    document = json.loads(chosen_for_the_motor.to_json())
    [chosen] = [c for c in document["candidates"] if not c["reason"]]
    assert chosen["name"] == document["chosen"] == "order 3 + delay"
    assert chosen["delay"] == pytest.approx(EQ_12_DELAY, rel=1e-2)
    gain, phase = figure(chosen_for_the_motor.report().pictures[0]).axes
    line, data, _ = gain.lines
    at = np.interp(np.log(data.get_xdata()), np.log(line.get_xdata()), line.get_ydata())
    assert np.median(np.abs(data.get_ydata() - at)) < 1.0  # dB
    drawn = phase.lines[0].get_ydata()
    assert np.all(np.abs(np.diff(drawn)) < 90.0)  # without jumps of a turn
    assert -720.0 < drawn[-1] < -270.0 < drawn[0] <= 0.0


@pytest.mark.thorough
def test_every_record_is_drawn_with_what_the_chosen_function_leaves(
    chosen_for_the_motor: TransferResult,
) -> None:
    """The error drawn is that of the exact response of the same function."""
    found = chosen_for_the_motor
    _, *pictures = found.report().pictures
    records = [one for one in found.measurements if isinstance(one, Record)]
    assert len(pictures) == len(records)
    function = found.chosen.function
    exact = LinearSystem.transfer(function.numerator, function.denominator)
    for record, picture in zip(records, pictures):
        assert record.name in picture.title
        assert ("held out" in picture.title) == bool(record.held_out.any())
        line = figure(picture).axes[1].lines[0]
        times, error = line.get_xdata(), np.radians(line.get_ydata())
        edges = [changes(record.times, record.given, function.delay)]
        off = exact.response(record.times, edges)[:, 0] - record.measured
        off -= np.mean(off[~record.held_out] if not record.held_out.all() else off)
        assert np.allclose(np.interp(times, record.times, off), error, atol=1e-6)


@pytest.mark.thorough
def test_records_and_sweep_together_know_more_than_either() -> None:
    rng = np.random.default_rng(7)
    w = 2.0 * np.pi * np.geomspace(1.0, 400.0, 30)
    error = 0.02 * (rng.standard_normal(30) + 1j * rng.standard_normal(30))
    response = EQUATION_12.response(w) * np.exp(error)
    sweep = Sweep("sweep", "voltage", "angle", w, response, np.zeros(30, bool))
    step = motor_logs(seed=5, noise=2e-3)[:1]
    only = [Structure(3, 0, True)]
    ways = ((step, [sweep]), (step, []), ([], [sweep]))
    both, *alone = (identify_transfer(a, b, model=MOTOR, structures=only).chosen for a, b in ways)
    assert np.all(np.abs(deviations(both, [*EQ_12, EQ_12_DELAY])) < 4.0)
    for single in alone:
        assert np.all(both.standard_errors < 1.2 * single.standard_errors)
        assert both.standard_errors[-1] < single.standard_errors[-1]


SERVO = model("sg90", "linear")
SPEED = ("pulse_width", "angle")


def servo_log(true: TransferFunction, noise: float) -> Log:
    """A step of 0.1 at 1 s, from lsim; the servo's signals lend their names."""
    times = np.arange(0.0, 30.0, 0.02)
    rest = float(SERVO.plant.inputs[0].rest)
    u = np.where(times < 1.0, 0.0, 1e-4)
    _, y, _ = lsim((true.numerator, true.denominator), u, times, interp=False)
    y += noise * np.random.default_rng(2).standard_normal(len(times))
    return log("step", times, rest + u, y, signals=SPEED)


SMALL = [Structure(1), Structure(2), Structure(2, 1), Structure(1, 0, True)]


def test_the_servo_papers_model_1_is_rejected_as_undamped_and_model_2_accepted() -> None:
    one = servo_log(MODEL_2, noise=2e-4)
    data = [Record.of(one, *SPEED, float(SERVO.plant.inputs[0].rest))]
    models = {"model 1": MODEL_1, "model 2": MODEL_2}
    every = [Candidate.of(n, f, np.zeros((f.structure.size,) * 2), data) for n, f in models.items()]
    first, second = choose(every, data, float(one.times[-1]))
    assert first.reason.startswith("undamped: poles at +-1.5017j rad/s")
    assert not second.reason


def chosen_for_the_servo(true: TransferFunction, noise: float) -> TransferResult:
    return identify_transfer(
        [servo_log(true, noise)], model=SERVO, source=SPEED[0], structures=SMALL
    )


def test_a_first_order_record_is_given_a_first_order_function() -> None:
    found = chosen_for_the_servo(MODEL_2, noise=2e-4)
    assert found.chosen.name == "order 1"
    assert np.all(np.abs(deviations(found.chosen, [633.3, 1.307])) < 4.0)
    assert found.constants is None
    reasons = {c.name: c.reason for c in found.candidates}
    assert reasons["order 2"] == "no better than 'order 1', with 1 coefficient more"


def test_an_undamped_function_is_not_chosen_however_well_it_fits() -> None:
    found = chosen_for_the_servo(MODEL_1, noise=1e-4)
    perfect = next(c for c in found.candidates if c.name == "order 2")
    assert perfect.bic < found.chosen.bic - 100.0
    assert perfect.reason.startswith("undamped")
    assert f"'order 2' fits better than '{found.chosen.name}', but" in found.warnings[0]
    assert "not white" in found.warnings[1]
    white = dict(found.tables()["Candidates"].select("structure", "white").iter_rows())
    assert (white["order 1"], white["order 2"]) == ("no", "yes")  # the motion, and the noise


def test_poles_are_judged_by_damping_and_by_the_length_of_the_record() -> None:
    lightly = TransferFunction.of([1.0], [1.0, 0.04, 1.0])
    assert pole_trouble(lightly, None) == ""
    assert pole_trouble(lightly, 300.0) == ""
    assert "settle in 200 s, the longest record lasts 30 s" in pole_trouble(lightly, 30.0)
    assert pole_trouble(TransferFunction.of([1.0], [1.0, -1.0]), 30.0).startswith("unstable")
    assert pole_trouble(TransferFunction.of([1.0], [1.0, 1.0, 0.0]), 30.0) == ""


def test_a_transfer_function_reads_like_the_paper() -> None:
    shown = "241560 exp(-0.0011 s) / (s^3 + 492 s^2 + 1.58224e+06 s + 1.84512e+08)"
    assert str(EQUATION_12) == shown
    assert str(TransferFunction.of([-2.0, 1.0], [2.0, 4.0])) == "(-s + 0.5) / (s + 2)"


def test_what_cannot_be_identified_is_one_clear_line() -> None:
    times = np.arange(0.0, 1.0, 0.01)
    still = log("still", times, np.zeros(100), np.sin(times))
    moving = log("moving", times, np.sin(times), np.sin(times), held_out=True)
    resting = replace(log("rests", times, np.sin(times), times), skipped=times > 0.1)
    cases = {
        "input 'voltage' never leaves its rest": (still, {}),
        "did you mean 'voltage'": (moving, {"source": "voltages"}),
        "the log has no output 'rate'": (moving, {"output": "rate"}),
        "that is not held out": (moving, {}),
        "log 'rests': a transfer function is fitted to every sample, 'judged' leaves some out:"
        " remove it": (resting, {}),
    }
    for said, (one, names) in cases.items():
        with pytest.raises(UserError) as error:
            identify_transfer([one], model=MOTOR, **names)
        assert said in str(error.value)


SWEEP = """
[[sweeps]]
file = "sweep.csv"
input = "voltage"
output = "angle"
frequency = { column = "f", unit = "Hz" }
gain = { column = "gain", unit = "deg/V" }
phase = { column = "phase", unit = "deg" }
"""


@pytest.fixture
def sweep_file(tmp_path: Path) -> Path:
    """A description beside a table of eq. 12 in Hz, deg/V and dB, deg."""
    hertz = np.geomspace(1.0, 400.0, 12)
    g = EQUATION_12.response(2.0 * np.pi * hertz) * 180.0 / np.pi
    columns = {
        "f": hertz,
        "gain": np.abs(g),
        "dB": 20.0 * np.log10(np.abs(g) / 0.075),
        "phase": np.degrees(np.angle(g)),
    }
    pl.DataFrame(columns).write_csv(tmp_path / "sweep.csv")
    return tmp_path / "motor.toml"


@pytest.mark.parametrize(
    "edit",
    [
        ("", ""),
        ('"gain", unit = "deg/V"', '"dB", unit = "dB", reference = "0.075 deg/V"'),
    ],
    ids=["deg/V", "dB"],
)
def test_a_table_of_gain_and_phase_is_read_in_si(sweep_file: Path, edit: tuple[str, str]) -> None:
    sweep_file.write_text(SWEEP.replace(*edit))
    [sweep] = read_sweeps(read_toml(sweep_file), sweep_file.parent, MOTOR.plant)
    expected = EQUATION_12.response(2.0 * np.pi * np.geomspace(1.0, 400.0, 12))
    assert np.allclose(sweep.measured, expected, rtol=1e-9)
    found = identify_transfer([], [sweep], model=MOTOR, structures=[Structure(3, 0, True)])
    assert found.chosen.function.delay == pytest.approx(EQ_12_DELAY, rel=1e-4)
    assert found.constants


FAULTS = {
    "unknown key": ("phase =", "fase =", "did you mean 'phase'"),
    "missing key": ('input = "voltage"', "", "sweeps[1].input: missing"),
    "unknown signal": ('"voltage"', '"volts"', "did you mean 'voltage'"),
    "unit": ('"deg/V"', '"deg/A"', "sweeps[1].gain.unit"),
    "column": ('column = "f"', 'column = "g"', "no column 'g'"),
    "frequency unit": ('"Hz"', '"m"', "sweeps[1].frequency.unit"),
    "negative gain": ('column = "gain"', 'column = "phase"', "column 'phase' is not above 0"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_sweep_table_is_one_clear_line(sweep_file: Path, fault: str) -> None:
    old, new, said = FAULTS[fault]
    sweep_file.write_text(SWEEP.replace(old, new))
    with pytest.raises(UserError) as error:
        read_sweeps(read_toml(sweep_file), sweep_file.parent, MOTOR.plant)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_two_sweeps_of_one_file_count_each_for_itself(sweep_file: Path) -> None:
    sweep_file.write_text(SWEEP + SWEEP + "held_out = true\n")
    first, second = read_sweeps(read_toml(sweep_file), sweep_file.parent, MOTOR.plant)
    assert first.name != second.name
    shapes = [Structure(2, 0, True), Structure(3, 0, True)]
    found = identify_transfer([], [first, second], model=MOTOR, structures=shapes)
    assert found.chosen.name == str(shapes[1])
    chosen = found.chosen
    assert len(chosen.errors[first.name]) == len(chosen.held_out_errors[second.name]) > 0


def test_a_sweep_of_another_output_is_said_to_be_left_out(sweep_file: Path) -> None:
    sweep_file.write_text(SWEEP + SWEEP.replace('"angle"', '"current"').replace("deg/V", "A/V"))
    sweeps = read_sweeps(read_toml(sweep_file), sweep_file.parent, MOTOR.plant)
    found = identify_transfer([], sweeps, model=MOTOR, structures=[Structure(3, 0, True)])
    assert any("'voltage' to 'current', and is left out" in text for text in found.warnings)


def swept(gain: float, s2: float, s1: float, s0: float) -> Sweep:
    """A clean sweep of gain / (s^3 + s2 s^2 + s1 s + s0), without delay."""
    w = 2.0 * np.pi * np.geomspace(1.0, 400.0, 30)
    response = TransferFunction.of([gain], [1.0, s2, s1, s0]).response(w)
    return Sweep("s", "voltage", "angle", w, response, np.zeros(30, dtype=bool))


def test_constants_of_a_function_without_delay_have_none() -> None:
    """The default variant has one of 1.1 ms, which would come back with its parameter file."""
    assert MOTOR.values["transport_delay.time"] > 0.0
    found = identify_transfer([], [swept(*EQ_12)], model=MOTOR, structures=[Structure(3, 0, False)])
    assert found.constants
    assert found.constants.estimates["transport_delay.time"] == (0.0, None)


def test_a_constant_out_of_its_bounds_is_taken_on_the_bound_and_told() -> None:
    """A spring that is stiffer than the one that is known: friction would have to be negative."""
    true = replace(TABLE_1, k_s=1.3**2 * TABLE_1.k_s, k_f=4e-5)
    gain, (_, *rest) = true.equation_9()
    measured, shapes = model("torque_motor", "measured"), [Structure(3, 0, False)]
    found = identify_transfer([], [swept(gain, *rest)], model=measured, structures=shapes)
    assert found.constants
    assert found.constants.estimates["friction_coefficient"] == (0.0, None)
    assert any(
        text.startswith("'friction_coefficient' was found at -1") and "taken as 0" in text
        for text in found.warnings
    )
