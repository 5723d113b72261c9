"""What logs can determine, against fits of many noisy logs and exact laws; and the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from servo_models.analysis.isolability import ambiguities, cause, experiment
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.effects import effects
from servo_models.errors import UserError
from servo_models.identification.check import check
from servo_models.identification.fit import fit
from servo_models.identification.identifiability import SHOWN, Identifiability, identifiability
from tests.conftest import Run
from tests.support.html_page import Page
from tests.support.logs import changed
from tests.support.noisy_motor import (
    DESCRIPTION,
    MOTOR,
    NOISE,
    TIMES,
    VOLTAGE,
    described,
    frame,
    motor_log,
)


def named(found: Identifiability, name: str) -> float:
    return next(r.moves for r in (*found.parameters, *found.effects) if r.name == name)


FREE = ("torque_constant", "friction_coefficient", "inductance")


def fitted(free: tuple[str, ...], count: int = 60) -> Array:
    return np.array([fit(MOTOR, [motor_log(seed)], free, jobs=1).values for seed in range(count)])


@pytest.mark.long
def test_errors_to_expect_are_those_of_many_fits() -> None:
    found = identifiability(MOTOR, [motor_log()], {"angle": NOISE}, FREE)
    reaches = {reach.name: reach for reach in found.parameters}
    together = np.array([reaches[name].together * reaches[name].scale for name in FREE])
    assert fitted(FREE).std(axis=0) == pytest.approx(together, rel=0.3)
    alone = reaches["friction_coefficient"]
    expected = alone.alone * alone.scale
    assert fitted(("friction_coefficient",)).std(ddof=1) == pytest.approx(expected, rel=0.3)
    assert np.all(together >= 0.999 * np.array([reaches[n].alone * reaches[n].scale for n in FREE]))


def test_a_prior_bounds_the_error_and_adds_as_information() -> None:
    prior = 0.02 * MOTOR.values["torque_constant"]
    plain = identifiability(MOTOR, [motor_log()], {"angle": NOISE}, ["torque_constant"])
    known = identifiability(
        MOTOR, [motor_log()], {"angle": NOISE}, priors={"torque_constant": prior}
    )

    def variance(found: Identifiability) -> float:
        reach = next(r for r in found.parameters if r.name == "torque_constant")
        return float((reach.together * reach.scale) ** 2)

    assert 1.0 / variance(known) == pytest.approx(1.0 / variance(plain) + 1.0 / prior**2, rel=1e-3)


def test_the_movement_is_in_noise_floors() -> None:
    logs = [motor_log(None)]
    near, far = (identifiability(MOTOR, logs, {"angle": f}) for f in (NOISE, 10.0 * NOISE))
    one, other = (
        MOTOR,
        changed(MOTOR, {"drive_dead_zone.half_width": 1.5}),
    )
    moved = [simulate(m, TIMES, {"voltage": VOLTAGE})["angle"] for m in (one, other)]
    rms = float(np.sqrt(np.mean((moved[1] - moved[0]) ** 2)))
    sizes = next(r.sizes for r in near.effects if r.name == "drive_dead_zone")
    assert sizes == {"drive_dead_zone.half_width": 1.5}
    assert named(near, "drive_dead_zone") == pytest.approx(rms / NOISE)
    assert named(far, "drive_dead_zone") == pytest.approx(rms / NOISE / 10.0)


def test_a_log_that_never_reaches_a_limit_cannot_show_it() -> None:
    found = identifiability(MOTOR, [motor_log(size=0.1)], {"angle": NOISE})
    assert named(found, "drive_saturation") == 0.0
    assert all(not r.shown for r in found.effects if r.moves < SHOWN)


def test_what_a_free_parameter_explains_is_not_shown() -> None:
    logs, floor = [motor_log()], {"angle": NOISE}
    fixed = next(r for r in identifiability(MOTOR, logs, floor).effects if r.name == "gain_error")
    free = identifiability(MOTOR, logs, floor, ["torque_constant", "back_emf_constant"])
    gain = next(r for r in free.effects if r.name == "gain_error")
    assert fixed.shown
    assert gain.absorbed


def test_parameters_that_only_count_as_a_product_are_named_together() -> None:
    linear = model("sg90", "linear", {"motor_time_constant": 0.05})
    times = 0.01 * np.arange(600)
    pulse = np.where(times > 1.0, 1.6e-3, 1.5e-3)
    angle = simulate(linear, times, {"pulse_width": pulse})["angle"]
    log = replace(motor_log(), times=times, inputs={"pulse_width": pulse}, outputs={"angle": angle})
    log = replace(log, held_out=np.zeros(600, dtype=bool))
    found = identifiability(linear, [log], {"angle": 1e-5}, ["amplifier_gain", "motor_gain"])
    assert [set(group.names) for group in found.groups if "motor_gain" in group.names] == [
        {"amplifier_gain", "motor_gain"}
    ]
    both = [r for r in found.parameters if r.name in ("amplifier_gain", "motor_gain")]
    assert all(r.alone < 0.1 and r.together > 1e3 * r.alone for r in both)


def test_all_held_out_is_refused() -> None:
    log = motor_log()
    with pytest.raises(UserError, match="held out"):
        identifiability(MOTOR, [replace(log, held_out=~log.held_out)], {"angle": NOISE})


def test_effects_are_confused_with_known_ones_and_in_no_two_ways() -> None:
    plant = MOTOR.plant
    declared = list(ambiguities(plant))
    for ambiguity in declared:
        assert {*ambiguity.group, *ambiguity.against} <= {*effects()}
        assert ambiguity.experiment
    for one in effects():
        for other in effects():
            texts = {it.experiment for it in declared if it.separates(one, other)}
            assert texts <= {experiment(one, other, plant)}
            assert experiment(one, other, plant) == experiment(other, one, plant)
    assert experiment("backlash", "dead_zone", plant)
    assert experiment("lag", "lag", plant) == ""


@pytest.mark.parametrize(
    ("name", "effect"),
    [
        ("rotor_inertia", "load_inertia"),
        ("friction_coefficient", "viscous_friction"),
        ("internal_step", "lag"),
        ("torque_constant", "gain_error"),
        ("gear_compliance.inertia", "gear_compliance"),
        ("drive_dead_zone", "dead_zone"),
    ],
)
def test_a_cause_is_an_effect_or_a_parameter_whose_error_looks_like_one(
    name: str, effect: str
) -> None:
    assert cause(name, MOTOR.plant) == effect


# The command


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    path = tmp_path / "bench log.csv"
    frame(motor_log()).write_csv(path)
    return path


def test_check_says_what_a_log_is_worth(run: Run, csv: Path) -> None:
    code, out, err = run("check", described(csv))
    assert (code, err) == (0, "")
    assert "500 samples in 0.499 s, 1 ms apart (1000 Hz), even" in out
    row = next(line for line in out.splitlines() if line.startswith("angle "))
    floor = float(row.split()[4])
    assert floor == pytest.approx(np.degrees(NOISE), rel=0.1)
    assert "fast residual" in row
    assert any(
        line.startswith("torque_constant") and line.endswith(" determined")
        for line in out.splitlines()
    )
    hidden = next(line for line in out.splitlines() if line.startswith("cannot be shown"))
    assert "noise floors" in hidden
    assert len(out.splitlines()) < 50


def test_check_warns_of_a_gap_and_of_what_is_asked_in_vain(run: Run, csv: Path) -> None:
    every = frame(motor_log())
    every.filter((pl.col("time_s") < 0.2) | (pl.col("time_s") > 0.25)).write_csv(csv)
    code, out, _ = run("check", described(csv, "load_inertia"))
    assert code == 1
    assert "Warning: log 'bench log': a gap of 0.052 s after row 201" in out
    code, out, _ = run("check", described(csv, "null_shift"))
    assert "null_shift.angle" in out
    still = DESCRIPTION.format(free="sensor_gain_that_is_not_there")
    csv.with_name("description.toml").write_text(still)
    assert run("check", csv.with_name("description.toml"))[0] == 2


def test_check_warns_where_no_input_moves(run: Run, csv: Path) -> None:
    table = frame(motor_log()).with_columns(pl.col("voltage_V") * 0.0)
    table.write_csv(csv)
    code, out, _ = run("check", described(csv))
    assert code == 1
    assert "something moves though no input ever changes" in out
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(table))
    table.with_columns(angle_deg=noise).write_csv(csv)
    code, out, _ = run("check", described(csv))
    assert code == 1
    assert "no input ever changes, and nothing moves" in out


def test_a_delay_that_is_to_be_estimated_is_judged(tmp_path: Path) -> None:
    """It is fixed during a run, as the internal step is, but it can be asked for."""
    times = 1e-4 * np.arange(2000)
    voltage = np.where(np.arange(2000) // 200 % 2 == 1, 20.0, 0.0)
    angle = simulate(model("torque_motor"), times, {"voltage": voltage})["angle"]
    noise = 1e-5 * np.random.default_rng(3).standard_normal(2000)
    rows = np.column_stack([times, voltage, angle + noise])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,u,a", comments="")
    description = tmp_path / "description.toml"
    description.write_text(
        'actuator = "torque_motor"\nfree = ["transport_delay.time"]\n[[logs]]\nfile = "log.csv"\n'
        'time = "t"\ninputs.voltage = "u"\noutputs.angle = "a"\n'
    )
    found = check(description)
    [reach] = found.identifiability.parameters
    assert reach.name == "transport_delay.time"
    assert 0.0 < reach.together * reach.scale < 1e-4


def test_a_check_offers_what_every_result_does(csv: Path, tmp_path: Path) -> None:
    found = check(described(csv))
    document = json.loads(found.to_json())
    assert document["noise_floors"] == found.floors
    table = next(frame for title, frame in found.tables().items() if title.startswith("Readings"))
    width = np.degrees(np.ptp(found.audits[0].log.outputs["angle"]))
    assert table["to [deg]"][0] - table["from [deg]"][0] == pytest.approx(width)
    axes = found.plot()
    assert axes.get_ylabel() == "angle\n[deg]"
    found.write_report(tmp_path / "check.html", "2026-01-31")
    page = Page((tmp_path / "check.html").read_text("utf-8"))
    page.assert_stands_alone()
    assert "The logs are usable" in " ".join(page.text)
