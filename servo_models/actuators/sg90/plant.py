"""The SG90's loop: wires, the chain of blocks between them, and where every effect stands."""

from __future__ import annotations

import math
from dataclasses import replace

from servo_models.actuators.sg90 import physics as servo
from servo_models.actuators.shaft import (
    external_load,
    free_shaft,
    no_second_mass,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
)
from servo_models.core.block import Block, Param
from servo_models.core.plant import Placement, Plant, State, Wire, place
from servo_models.effects.backlash import backlash
from servo_models.effects.cogging import cogging
from servo_models.effects.constant_load import constant_load
from servo_models.effects.coulomb_friction import coulomb_friction
from servo_models.effects.dead_band import dead_band
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.direction_asymmetry import direction_asymmetry
from servo_models.effects.end_stops import end_stops
from servo_models.effects.gain_error import gain_error
from servo_models.effects.gear_compliance import (
    compliant_load,
    compliant_output,
    resonance_step,
)
from servo_models.effects.gravity_load import gravity_load
from servo_models.effects.hysteresis import hysteresis
from servo_models.effects.lag import lag
from servo_models.effects.load_friction import load_friction
from servo_models.effects.load_inertia import load_inertia
from servo_models.effects.nonlinearity import nonlinearity
from servo_models.effects.offset import offset
from servo_models.effects.quantisation import quantisation
from servo_models.effects.rate_limit import rate_limit
from servo_models.effects.sample_hold import sample_hold
from servo_models.effects.saturation import saturation
from servo_models.effects.stribeck_friction import stribeck_friction
from servo_models.effects.supply_limit import supply_limit
from servo_models.effects.supply_sag import supply_sag
from servo_models.effects.thermal_drift import thermal_drift
from servo_models.effects.transport_delay import transport_delay
from servo_models.effects.viscous_friction import viscous_friction

HALF_RANGE = math.radians(90.0)
RATE = 10.0  # rad/s, of a real SG90: 60 degrees in 0.1 s
PAPER_RATE = 0.5  # rad/s, of the servo that its paper prints

INPUTS = (
    Wire(
        "pulse_width",
        "s",
        "command pulse",
        scale=1e-3,
        rest=servo.REST_PULSE,
        low=0.0,
        high=5e-3,
        display="us",
    ),
    Wire("load_torque", "N.m", "load against positive motion", scale=0.18, low=-10.0, high=10.0),
    Wire("supply_voltage", "V", "supply", scale=5.0, rest=5.0, low=0.0, high=30.0),
)
WIRES = (
    Wire("angle", "rad", "angle of the output, 0 at 1.5 ms", scale=HALF_RANGE, display="deg"),
    Wire("rate", "rad/s", "rate of the output", scale=RATE, display="deg/s"),
    Wire("command_voltage", "V", "voltage of the command", scale=0.6, rest=0.375),
    Wire("feedback_voltage", "V", "voltage of the potentiometer", scale=6.0, rest=3.75),
    Wire("motor_voltage", "V", "voltage on the motor", scale=5.0),
    Wire("loaded_voltage", "V", "motor voltage left after the load", scale=5.0),
    Wire("motor_speed", "rad/s", "speed of the motor", scale=670.0),
    Wire("angle_reading", "rad", "angle as tracked from outside", scale=HALF_RANGE, display="deg"),
    Wire("rate_reading", "rad/s", "rate as read by a gyro", scale=RATE, display="deg/s"),
    Wire("saturated", "1", "amplifier at its supply or motor at its top speed", flag=True),
    Wire("supply", "V", "supply under load", scale=5.0, rest=5.0),
    Wire("friction", "N.m", "dry friction level", scale=0.18),
    Wire("load", "N.m", "load torque with all its parts", scale=0.18),
    Wire("load_rate", "rad/s", "rate behind the compliance", scale=RATE),
    Wire("load_acceleration", "rad/s2", "acceleration behind the compliance", scale=1e3),
    Wire("shaft_inertia", "kg.m2", "accelerated inertia", scale=5e-3),
    Wire("travel", "rad", "half range of the output", scale=HALF_RANGE, display="deg"),
)
STEP = {
    "internal_step": Param(
        "s", "longest internal step", default=2e-3, low=1e-5, high=5e-3, display="us", fixed=True
    )
}
_rate = replace(rate_limit.params["rate"], typical=2.0)
_drive = replace(saturation.params["limit"], typical=0.3)
_sag = replace(supply_sag.params["resistance"], typical=1.0, high=50.0)
_rest = {"resistance": _sag}

COMMAND: tuple[Block | Placement, ...] = (
    servo.equivalent_shaft,
    servo.rest_angle,
    servo.top_speed,
    free_shaft,
    no_second_mass,
    place("load_inertia", load_inertia, "shaft_inertia"),
    place("gear_compliance", resonance_step, "internal_step"),
    place("end_stops", end_stops, "travel"),
    place("transport_delay", transport_delay, "pulse_width"),
    place("sample_hold", sample_hold, "pulse_width"),
    place("dead_band", dead_band, "pulse_width"),
    servo.command_voltage,
    place("command_quantisation", quantisation, "command_voltage"),
    place("gain_error", gain_error, "command_voltage"),
    place("command_offset", offset, "command_voltage"),
    place("rate_limit", rate_limit, "command_voltage", params={"rate": _rate}),
)
LOOP: tuple[Block | Placement, ...] = (
    servo.shaft_rate,
    shaft_output,
    place("gear_compliance", compliant_output, "angle", "rate", "load_rate"),
    place("backlash", backlash, "angle", "rate"),
    servo.feedback_voltage,
    place("sensor_lag", lag, "feedback_voltage"),
    place("sensor_nonlinearity", nonlinearity, "feedback_voltage"),
    place("sensor_offset", offset, "feedback_voltage"),
    place("sensor_quantisation", quantisation, "feedback_voltage"),
    servo.error,
    servo.amplifier,
    place("direction_asymmetry", direction_asymmetry, "motor_voltage"),
    place("hysteresis", hysteresis, "motor_voltage"),
    place("drive_dead_zone", dead_zone, "motor_voltage"),
    place("drive_saturation", saturation, "motor_voltage", params={"limit": _drive}),
    servo.motor_shaft,
    servo.stiff_supply,
    servo.supply_load,
    place("supply_sag", supply_sag, "supply", params=_rest),
    place("supply_limit", supply_limit, "motor_voltage"),
    external_load,
    place("constant_load", constant_load, "load"),
    place("gravity_load", gravity_load, "load"),
    place("gear_compliance", compliant_load, "load", "load_acceleration"),
    place("load_friction", load_friction, "friction"),
    place("viscous_friction", viscous_friction, "load"),
    place("cogging", cogging, "load"),
    servo.load_voltage,
    place("thermal_drift", thermal_drift, "loaded_voltage"),
    servo.motor_curve,
    servo.saturation_flag,
)
SHAFT: tuple[Block | Placement, ...] = (
    place("coulomb_friction", coulomb_friction, "friction"),
    place("stribeck_friction", stribeck_friction, "friction"),
    servo.motor_lag,
    shaft_acceleration,
)


def _sensor(name: str, wire: str) -> tuple[Placement, ...]:
    """What a sensor outside the loop does to its reading."""
    return (
        place(f"{name}_lag", lag, wire),
        place(f"{name}_gain", gain_error, wire),
        place(f"{name}_offset", offset, wire),
        place(f"{name}_quantisation", quantisation, wire),
    )


READINGS: tuple[Block | Placement, ...] = (
    servo.readings,
    *_sensor("reading", "angle_reading"),
    *_sensor("gyro", "rate_reading"),
)
SECOND_MASS = (
    State(
        Wire("load_angle", "rad", "angle behind the compliance", scale=HALF_RANGE, display="deg"),
        "load_rate",
        owner="gear_compliance",
    ),
    State(
        Wire("load_speed", "rad/s", "shaft speed behind the compliance", scale=28.0),
        "load_acceleration",
        owner="gear_compliance",
    ),
)
ANGLE = Wire("shaft_angle", "rad", "angle of the gearbox output", scale=HALF_RANGE, display="deg")
SPEED = Wire("shaft_speed", "rad/s", "speed of the motor over the gear ratio", scale=28.0)
OUTPUTS = (
    "angle",
    "rate",
    "feedback_voltage",
    "motor_voltage",
    "motor_speed",
    "saturated",
    "angle_reading",
    "rate_reading",
)

PLANT = Plant(
    inputs=INPUTS,
    wires=WIRES,
    constants=STEP,
    chain=(*COMMAND, *LOOP, *SHAFT, *READINGS),
    states=(State(ANGLE, "shaft_rate"), State(SPEED, "acceleration"), *SECOND_MASS),
    projection=shaft_contact,
    outputs=OUTPUTS,
)

PAPER_PLANT = PLANT.rated(scales=dict.fromkeys(("rate", "load_rate"), PAPER_RATE))

_SHAFT_ONLY = ("load_inertia", "end_stops", "load_friction")
OSCILLATORY_PLANT = Plant(
    inputs=INPUTS,
    wires=WIRES,
    constants=STEP,
    chain=(
        *(
            link
            for link in (*COMMAND, *LOOP)
            if not (isinstance(link, Placement) and link.name in _SHAFT_ONLY)
        ),
        servo.oscillatory_speed,
        servo.jerk,
        *READINGS,
    ),
    states=(
        State(ANGLE, "shaft_rate"),
        State(SPEED, "acceleration"),
        State(Wire("shaft_acceleration", "rad/s2", "state of model 1", scale=40.0), "jerk"),
        *SECOND_MASS,
    ),
    outputs=OUTPUTS,
).rated(scales=dict.fromkeys(("rate", "load_rate"), PAPER_RATE))
