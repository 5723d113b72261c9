"""Sweeps of gain and phase in a description: a table, or raw records, and every fault named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from servo_models import UserError, model, simulate
from servo_models.actuators.torque_motor.variants import EQ_12, EQ_12_DELAY
from servo_models.data.schema import read_toml
from servo_models.identification.transfer.functions import Structure, TransferFunction
from servo_models.identification.transfer.identify import identify_transfer
from servo_models.identification.transfer.measurements import Sweep
from servo_models.identification.transfer.sweeps import raw_records, read_sweeps, sweep_of_sines
from servo_models.validation.torque_motor.reference import TABLE_1
from tests.support.transfer_logs import DT, EQUATION_12, MOTOR, log

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
    assert np.allclose(sweep.response, expected, rtol=1e-9)
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


def test_raw_records_of_a_sweep_are_named_in_the_description(tmp_path: Path) -> None:
    hertz = np.geomspace(5.0, 80.0, 4)
    times = DT * np.arange(12000)
    logs = []
    for f in hertz:
        u = 10.0 * np.sin(2.0 * np.pi * f * times)
        logs.append(log(f"{f:.0f} Hz", times, u, 0.5 * u))
    names = [one.name for one in logs]
    path = tmp_path / "raw.toml"
    path.write_text(f'[[sweeps]]\nlogs = {names}\ninput = "voltage"\noutput = "angle"\n')
    document = read_toml(path)
    [sweep] = read_sweeps(document, tmp_path, MOTOR.plant, logs)
    assert sweep.frequencies == pytest.approx(2.0 * np.pi * hertz, rel=1e-6)
    assert raw_records(document) == set(names)
    with pytest.raises(UserError, match="logs: unknown log '5 Hz'"):
        read_sweeps(document, tmp_path, MOTOR.plant, logs[1:])


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


def test_a_sine_record_without_the_signal_is_one_clear_line() -> None:
    times = DT * np.arange(4000)
    u = np.sin(200.0 * times)
    other = log("rates", times, u, u, signals=("voltage", "rate"))
    with pytest.raises(UserError, match=r"log 'rates': the log has no output 'angle'"):
        sweep_of_sines([other] * 4, "voltage", "angle")
    other = log("loads", times, u, u, signals=("load_torque", "angle"))
    with pytest.raises(UserError, match=r"log 'loads': the log has no input 'voltage'"):
        sweep_of_sines([other] * 4, "voltage", "angle")


def swept(gain: float, s2: float, s1: float, s0: float) -> Sweep:
    """A clean sweep of gain / (s^3 + s2 s^2 + s1 s + s0), without delay."""
    w = 2.0 * np.pi * np.geomspace(1.0, 400.0, 30)
    response = TransferFunction.of([gain], [1.0, s2, s1, s0]).response(w)
    return Sweep("s", "voltage", "angle", w, response, np.ones(30), np.zeros(30, dtype=bool))


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


def test_gain_and_phase_of_sine_records_are_those_of_the_function() -> None:
    rng = np.random.default_rng(9)
    hertz = np.array([5.0, 20.0, 60.0, 150.0, 188.0, 300.0])
    logs = []
    for f in hertz:
        times = np.arange(0.0, max(0.3, 8.0 / f), DT)
        u = 20.0 * np.sin(2.0 * np.pi * f * times)
        angle = simulate(MOTOR, times, {"voltage": u})["angle"]
        logs.append(log(f"{f:g} Hz", times, u, angle + 1e-4 * rng.standard_normal(len(times))))
    sweep = sweep_of_sines(logs, "voltage", "angle")
    assert sweep.frequencies == pytest.approx(2.0 * np.pi * hertz, rel=1e-6)
    error = np.abs(sweep.response / EQUATION_12.response(sweep.frequencies) - 1.0)
    assert np.all(error < 4.0 * sweep.spread + 1e-3)
