"""The torque-causal form: against solved motors, and what it leaves to the engine."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from servo_models.actuators.torque_causal import torque_causal
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuator, actuators, model
from servo_models.core.types import Array
from servo_models.data.parameters import (
    Estimate,
    ParameterSet,
    read_parameters,
    write_parameters,
)
from servo_models.errors import UserError
from tests.support.document import ROOT

RESISTANCE, INDUCTANCE, BACK_EMF = 3630.0, 34.0, 0.08  # valve paper, Table 1
TORQUE_CONSTANT, STIFFNESS, DRAG, ROTOR = 6.432, 1.1, 2.7e-4, 7.246e-7
VOLTS, LINK = 20.0, 2e-6  # kg m2
NO_TRAVEL = {"end_stops.half_range": 0.0}


def motor(_: float, state: Array, voltage: float, inertia: float) -> list[float]:
    """Current, angle and speed of a torque motor on an inertia, eqs. 1 to 6 by hand."""
    current, angle, speed = state
    drop = voltage - RESISTANCE * current - BACK_EMF * speed
    torque = TORQUE_CONSTANT * current - STIFFNESS * angle - DRAG * speed
    return [drop / INDUCTANCE, speed, torque / inertia]


def in_an_engine(step: float, times: Array) -> Array:
    """Angles of the joint: an engine of one line, exact for the mean torque of a step."""
    chosen = model("torque_motor_torque", "measured", NO_TRAVEL)
    names = [wire.name for wire in chosen.plant.inputs]
    assert names == ["voltage", "joint_position", "joint_velocity", "joint_acceleration"]
    at = chosen.plant.outputs.index("impulse")
    state, (angle, speed, acceleration, impulse) = chosen.start(), np.zeros(4)
    angles = [angle]
    for now in times[:-1]:
        inputs = np.array([VOLTS, angle, speed, acceleration])
        out = chosen.run(np.array([now, now + step]), np.tile(inputs, (2, 1)), state)
        acceleration = (out[-1, at] - impulse) / step / (ROTOR + LINK)
        impulse = out[-1, at]
        angle += step * (speed + 0.5 * step * acceleration)
        speed += step * acceleration
        angles.append(angle)
    return np.array(angles)


def test_coupled_to_an_engine_it_is_the_whole_motor() -> None:
    values = model("torque_motor", "measured").values
    assert values["torque_constant"] == TORQUE_CONSTANT
    assert values["inductance"] == INDUCTANCE
    errors = []
    for step in (2e-4, 1e-4):
        times = step * np.arange(round(0.05 / step) + 1)
        exact = solve_ivp(
            motor, (0.0, 0.06), [0.0] * 3, t_eval=times, args=(VOLTS, ROTOR + LINK), rtol=1e-9,
            atol=1e-12,
        ).y[1]  # fmt: skip
        errors.append(np.max(np.abs(in_an_engine(step, times) - exact)) / np.ptp(exact))
    assert errors[1] < 1e-3
    assert errors[1] < 0.35 * errors[0]  # of second order


def test_the_torque_of_a_joint_that_is_moved_is_that_of_the_circuit() -> None:
    """The joint swings as told; velocity and acceleration fill the time between the points."""
    omega, size = 300.0, 0.01
    times = np.linspace(0.0, 0.05, 501)
    angle = size * (1.0 - np.cos(omega * times))
    speed = size * omega * np.sin(omega * times)
    inputs = {
        "voltage": VOLTS,
        "joint_position": angle,
        "joint_velocity": speed,
        "joint_acceleration": size * omega**2 * np.cos(omega * times),
    }
    found = simulate(model("torque_motor_torque", "measured", NO_TRAVEL), times, inputs)

    def circuit(time: float, current: Array) -> Array:
        turning = BACK_EMF * size * omega * math.sin(omega * time)
        return (VOLTS - RESISTANCE * current - turning) / INDUCTANCE

    (current,) = solve_ivp(
        circuit, (0.0, 0.06), [0.0], t_eval=times, rtol=1e-10, atol=1e-14
    ).y  # fmt: skip
    torque = TORQUE_CONSTANT * current - STIFFNESS * angle - DRAG * speed
    full = np.ptp(torque)
    np.testing.assert_allclose(found["torque"], torque, atol=1e-4 * full)
    trapezoids = np.cumsum(0.5 * (torque[1:] + torque[:-1]) * np.diff(times))
    np.testing.assert_allclose(found["impulse"][1:], trapezoids, atol=1e-4 * full * times[-1])


def test_rotor_friction_and_stops_are_told_for_the_joint() -> None:
    """Numbers of the variant's source: 0.0347 s, 1.8 kg cm, 51.1 * 4.8 rad/s over 24."""
    speed = 0.3
    full_speed = 51.1 * 4.8 / 24.0
    values = {
        "coulomb_friction.level": 0.03,
        "stribeck_friction.excess": 0.02,
        "stribeck_friction.speed": 0.05,
        "end_stops.half_range": 0.4,
    }
    found = simulate(model("sg90_torque", None, values), [0.0, 0.1], {"joint_velocity": speed})
    assert found["shaft_inertia"][-1] == pytest.approx(0.0347 * 0.1765 / full_speed)
    sliding = 0.03 + 0.02 * math.exp(-((speed / (0.05 * full_speed)) ** 2))
    assert found["friction"][-1] == pytest.approx(sliding)
    assert found["travel"][-1] == 0.4
    slower = simulate(model("sg90_torque"), [0.0, 0.1], {"joint_velocity": speed})
    assert np.array_equal(found["torque"], slower["torque"])  # friction is in none of it


@pytest.mark.parametrize("name", actuators())
def test_what_is_the_engine_s_is_not_there(name: str) -> None:
    form = actuator(f"{name}_torque")
    assert not [it.name for it in form.plant.inputs if it.name.startswith("load")]
    owners = {parameter.owner for parameter in form.plant.parameters.values()}
    engine = {"load_inertia", "load_mass", "constant_load", "gravity_load", "load_friction"}
    assert not owners & (engine | {"gear_compliance"})
    kept = {"coulomb_friction", "stribeck_friction", "end_stops", "cogging"}
    assert kept <= owners
    assert {"torque", "impulse", "friction", "shaft_inertia", "travel"} < {*form.plant.outputs}
    assert form.plant.terminals["shaft"] == (
        "joint_position",
        "joint_velocity",
        "joint_acceleration",
        "torque",
    )


def test_a_load_that_only_the_engine_has_is_refused() -> None:
    with pytest.raises(UserError, match=r"unknown parameter 'gravity_load\.torque'"):
        model("sg90_torque", None, {"gravity_load.torque": 0.05})


def test_variants_whose_angle_is_not_that_of_the_shaft_or_that_are_loaded_are_left_out() -> None:
    """The SG90 paper counts radians of the shaft as degrees of the output."""
    servo = actuator("sg90")
    assert [variant.name for variant in actuator("sg90_torque").variants] == [
        "measured",
        "airframe",
    ]
    with pytest.raises(UserError, match="angle_unit"):
        model("sg90_torque", None, {"angle_unit": 0.5})
    measured = servo.variant("measured")
    loaded = replace(measured, values={**measured.values, "gravity_load.torque": 0.05})
    with pytest.raises(UserError, match="actuator 'sg90' has no torque-causal form"):
        torque_causal(replace(servo, variants=(loaded,)))


def test_an_actuator_without_a_shaft_has_no_such_form() -> None:
    with pytest.raises(UserError, match=r"needs the blocks of servo_models/actuators/shaft\.py"):
        torque_causal(actuator(str(ROOT / "examples" / "gimbal" / "gimbal.py")))


def test_an_identified_model_has_the_form_by_its_name(tmp_path: Path) -> None:
    """Another name of the actuator in its parameter file, and what it has not is refused."""
    file = tmp_path / "PARAMS.toml"
    identified = ParameterSet(
        actuator="sg90_torque", variant="measured", estimates=(Estimate("motor_gain", 50.0, 1.0),)
    )
    write_parameters(identified, file)
    assert read_parameters(file).model().values["motor_gain"] == 50.0
    loaded = replace(identified, estimates=(Estimate("constant_load.torque", 0.01),))
    with pytest.raises(UserError, match=r"unknown parameter 'constant_load\.torque'"):
        write_parameters(loaded, file)


def test_an_own_file_may_derive_the_form_from_another(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "import servo_models as sm\nfrom dataclasses import replace\n"
        'ACTUATOR = replace(sm.actuator("smart_servo"), name="mine")\n'
    )
    (tmp_path / "joint.py").write_text(
        "import servo_models as sm\nfrom pathlib import Path\n"
        'ACTUATOR = sm.torque_causal(sm.actuator(str(Path(__file__).with_name("mine.py"))))\n'
    )
    chosen = model(str(tmp_path / "joint.py"))
    assert chosen.actuator.name == "mine_torque"
    times, goal = [0.0, 0.001, 0.1], {"goal": 0.2}
    own, derived = (simulate(it, times, goal) for it in (chosen, model("smart_servo_torque")))
    assert np.array_equal(own["torque"], derived["torque"])


def test_each_variant_has_the_form_of_its_own_plant() -> None:
    """The STS3215 runs on another supply than the XL330, whichever comes first."""
    servo = actuator("smart_servo")
    for variants in (servo.variants, servo.variants[::-1]):
        form = torque_causal(replace(servo, variants=variants))
        rests = {it.name: form.plant_of(it.name).wire["supply"].rest for it in form.variants}
        assert rests == {"xl330": 5.0, "sts3215": 7.4, "sts3215_12v": 12.0}
