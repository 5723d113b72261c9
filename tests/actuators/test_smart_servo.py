"""The smart servo: a pendulum lifted and dropped, and the logs of a real one."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from fmu_src.variables import variables
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from tests.support.sliding import slide

TICK = 1e-3
GRAVITY = 0.49 * 9.81 * 0.1
ARM = 0.49 * 0.1 * 0.1  # inertia [kg m^2] of the pendulum of the real rig
ROTOR = model("smart_servo", "xl330").values["inertia"]
RPM = 2.0 * math.pi / 60.0
KG_CM = 0.0980665
SHEETS = {
    "xl330": (
        (5.0, 103.0 * RPM, 0.52),
        (3.7, 76.0 * RPM, 0.42),
        (6.0, 123.0 * RPM, 0.60),
    ),
    "sts3215": ((7.4, 52.0 * RPM, 19.5 * KG_CM), (6.0, 42.0 * RPM, 16.5 * KG_CM)),
}
"""Supply [V], no-load speed [rad/s] and stall torque [N m] of the data sheets, the supply at which
a variant rests first: ROBOTIS e-manual, XL330-M288; Feetech, STS3215."""
ROTORS = {"xl330": (0.00199, 0.00257), "sts3215": (0.0216, 0.0280)}
"""Least and largest inertia of the bare servo [kg m^2] that Duclusaud et al. publish."""
ELSEWHERE = 0.1  # a motor of two points meets a data sheet at other supplies to this share
PENDULUM = {
    "torque_constant": 0.6,
    "resistance": 4.0,
    "inertia": 6e-3,
    "gain": 400.0,
    "loop_factor": 0.0028773,
    "gravity_load.torque": 0.48,
    "coulomb_friction.level": 0.02,
    "stribeck_friction.excess": 0.02,
    "stribeck_friction.speed": 0.02,
    "load_friction.coefficient": 0.15,
}


def by_hand(goal: Array, enabled: Array) -> Array:
    """Angle of the pendulum at the ticks; between them ``solve_ivp`` from stop to stop."""
    count, supply, k_t, resistance, inertia = 2.0 * math.pi / 4096.0, 7.4, 0.6, 4.0, 6e-3
    angle = speed = 0.0
    out = []
    for wanted, on in zip(goal, enabled):
        reading = count * math.floor(angle / count + 0.5)
        duty = float(np.clip(400.0 * 0.0028773 * (wanted - reading), -1.0, 1.0))
        out.append(angle)

        def net(x: float, v: float, duty: float = duty, on: float = on) -> float:
            motor = k_t * (duty * supply - k_t * v) / resistance if on else 0.0
            return motor - 0.48 * math.sin(x)

        def friction(x: float, v: float) -> float:
            stribeck = 0.02 * math.exp(-((v / 0.2) ** 2))
            return 0.02 + stribeck + 0.15 * abs(0.48 * math.sin(x))

        angle, speed = slide(net, friction, inertia, angle, speed, TICK)
    return np.array(out)


def test_it_lifts_a_pendulum_and_drops_it() -> None:
    ticks = np.arange(1600)
    goal = np.where(ticks < 700, 0.8, -0.5)
    enabled = np.where(ticks < 1000, 1.0, 0.0)
    chosen = model("smart_servo", "xl330", {**PENDULUM, "internal_step": 5e-4})
    run = simulate(chosen, TICK * ticks, {"goal": goal, "enabled": enabled, "supply": 7.4})
    assert run["duty"].max() > 0.9
    assert np.all(run["rate"][680:700] == 0.0), "friction holds the arm before the goal is reached"
    assert abs(run["angle"][699] - 0.8) > 0.01
    np.testing.assert_allclose(run["angle"], by_hand(goal, enabled), atol=3e-7)


def full_drive(variant: str, **inputs: float) -> float:
    """Rate [rad/s] in the end with the goal far away, so that all of the supply drives."""
    goal = {"goal": 50.0, **inputs}
    return float(simulate(model("smart_servo", variant), [0.0, 2.0], goal)["rate"][-1])


def sheet_lines() -> list[tuple[str, float, float, float, float]]:
    """Variant, supply, speed, torque of each line, and how near the simulation has to be."""
    return [
        (variant, *line, 1e-3 if line is lines[0] else ELSEWHERE)
        for variant, lines in SHEETS.items()
        for line in lines
    ]


@pytest.mark.parametrize("variant", SHEETS)
def test_a_variant_rests_at_the_supply_of_its_data_sheet(variant: str) -> None:
    chosen = model("smart_servo", variant)
    (volts, speed, _), *_ = SHEETS[variant]
    assert chosen.plant.wire["supply"].rest == volts
    assert f"{volts:g} V" in chosen.actuator.variant(variant).about
    (start,) = [v.start for v in variables(chosen) if v.name == "supply"]
    assert start == volts
    assert full_drive(variant) == pytest.approx(speed, rel=1e-3)


@pytest.mark.parametrize(("variant", "volts", "speed", "torque", "near"), sheet_lines())
def test_speed_and_stall_torque_are_those_of_the_data_sheet(
    variant: str, volts: float, speed: float, torque: float, near: float
) -> None:
    assert full_drive(variant, supply=volts) == pytest.approx(speed, rel=near)
    held = {side: (1.0 + side * near) * torque for side in (-1.0, 1.0)}
    assert full_drive(variant, supply=volts, load_torque=held[-1.0]) > 0.0
    assert full_drive(variant, supply=volts, load_torque=held[1.0]) < 0.0


@pytest.mark.parametrize("variant", ROTORS)
def test_no_arm_hides_in_the_inertia(variant: str) -> None:
    least, most = ROTORS[variant]
    assert 0.95 * least < model("smart_servo", variant).values["inertia"] < 1.05 * most


def mean_error(folder: Path, friction: dict[str, float]) -> float:
    """Mean absolute error [rad] of the nominal servo over all logs of the pendulum."""
    errors = []
    for path in sorted(folder.glob("*.json")):
        log = json.loads(path.read_text())
        columns = {
            name: np.array([entry[name] for entry in log["entries"]], dtype=float)
            for name in ("timestamp", "goal_position", "position", "torque_enable")
        }
        rig = {"gravity_load.torque": GRAVITY, "inertia": ROTOR + ARM}
        values = {"gain": float(log["kp"]), **rig, **friction}
        inputs = {"goal": columns["goal_position"], "enabled": columns["torque_enable"]}
        inputs["supply"] = np.full(len(columns["timestamp"]), log["vin"])
        run = simulate(model("smart_servo", "xl330", values), columns["timestamp"], inputs)
        errors.append(float(np.mean(np.abs(run["angle"] - columns["position"]))))
    return float(np.mean(errors))


def test_friction_that_grows_with_the_load_brings_the_nominal_servo_near_a_real_one(
    logs_folder: Path,
) -> None:
    """Nothing is fitted: data sheet, and the published coefficient of load friction."""
    rig = logs_folder / "bam_xl330"
    dry = {"load_friction.coefficient": 0.26, "coulomb_friction.level": 0.02}
    assert mean_error(rig, dry) < 0.6 * mean_error(rig, {})


def test_the_source_drops_by_what_the_bridge_takes() -> None:
    """Kirchhoff: the current of the motor passes the source for the duty's share of the time."""
    servo = model("smart_servo", "xl330", {"supply_sag.resistance": 0.8})
    times = 0.02 * np.arange(40)
    found = simulate(servo, times, {"goal": np.where(times < 0.3, 0.2, -0.5)})
    drop = 5.0 - found["bridge_supply"]
    np.testing.assert_allclose(drop, 0.8 * found["duty"] * found["current"], atol=1e-12)
    assert drop.max() > 0.1
