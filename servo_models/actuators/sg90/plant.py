"""The SG90's loop: wires, the chain of blocks between them, and where every effect stands."""

from __future__ import annotations

import math

from servo_models.actuators.sg90 import physics as servo
from servo_models.actuators.shaft import (
    external_load,
    free_shaft,
    no_second_mass,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
)
from servo_models.actuators.wiring import (
    GYRO,
    LEARNT,
    LOADS,
    TRACKED,
    WEAK_SUPPLY,
    input_scale,
    outside_sensor,
    residual_curves,
)
from servo_models.core.block import Bench, Block
from servo_models.core.plant import Placement, Plant, State, Wire, internal_step, place
from servo_models.effects import effects_on
from servo_models.effects.gear_compliance import compliant_load, compliant_output, resonance_step
from servo_models.effects.residual_map import residual_drive, residual_reading, residual_torque

HALF_RANGE = math.radians(90.0)
RATE = 10.0  # rad/s, speed of a real SG90: 60 degrees in 0.1 s
PAPER_RATE = 0.5  # rad/s, speed of the servo with the printed values of the paper

COMPLIANCE = {"unit": "rad/(N.m)", "high": 1.0, "typical": 0.2}

WIPER = (Bench("solder a wire to the wiper of the potentiometer", 900.0, 0.005),)
TERMINALS_OF_MOTOR = (Bench("solder wires to the terminals of the motor", 900.0, 0.01),)
INPUTS = (
    Wire("pulse_width", "s", "command pulse", 1e-3, servo.REST_PULSE, 0.0, 5e-3, display="us"),
    Wire(
        "load_torque",
        "N.m",
        "load against positive motion",
        0.18,
        low=-10.0,
        high=10.0,
        bench=LOADS,
    ),
    Wire("supply_voltage", "V", "supply", 5.0, rest=5.0, low=0.0, high=30.0, bench=WEAK_SUPPLY),
)
WIRES = (
    Wire("angle", "rad", "angle of the output, 0 at 1.5 ms", scale=HALF_RANGE, display="deg"),
    Wire("rate", "rad/s", "rate of the output", scale=RATE, display="deg/s"),
    Wire("command_voltage", "V", "voltage of the command", scale=0.6, rest=0.375),
    Wire("command_angle", "rad", "angle that is asked for", scale=HALF_RANGE, display="deg"),
    Wire("feedback_voltage", "V", "voltage of the potentiometer", 6.0, rest=3.75, bench=WIPER),
    Wire("motor_voltage", "V", "voltage on the motor", scale=5.0, bench=TERMINALS_OF_MOTOR),
    Wire("loaded_voltage", "V", "motor voltage left after the load", scale=5.0),
    Wire("motor_speed", "rad/s", "speed of the motor", scale=670.0),
    Wire(
        "angle_reading",
        "rad",
        "angle as tracked from outside",
        scale=HALF_RANGE,
        display="deg",
        bench=TRACKED,
    ),
    Wire("rate_reading", "rad/s", "rate as read by a gyro", RATE, display="deg/s", bench=GYRO),
    Wire("saturated", "1", "amplifier at its supply or motor at its top speed", flag=True),
    Wire("supply", "V", "supply under load", scale=5.0, rest=5.0),
    Wire("friction", "N.m", "dry friction level", scale=0.18),
    Wire("load", "N.m", "load torque with all its parts", scale=0.18),
    Wire("load_rate", "rad/s", "rate behind the compliance", scale=RATE),
    Wire("load_acceleration", "rad/s2", "acceleration behind the compliance", scale=1e3),
    Wire("shaft_inertia", "kg.m2", "accelerated inertia", scale=5e-3),
    Wire("travel", "rad", "half range of the output", scale=HALF_RANGE, display="deg"),
    *LEARNT,
)

COMMAND: tuple[Block | Placement, ...] = (
    servo.equivalent_shaft,
    servo.rest_angle,
    servo.top_speed,
    free_shaft,
    no_second_mass,
    *effects_on("shaft_inertia", "load_inertia"),
    place("gear_compliance", resonance_step, "internal_step", params={"compliance": COMPLIANCE}),
    *effects_on("travel", "end_stops"),
    input_scale("load_gain", "load_torque"),
    *effects_on("pulse_width", "transport_delay", "command_lag", "sample_hold", "dead_band"),
    servo.pulse_detector,
    servo.command_voltage,
    *effects_on("command_voltage", "command_quantisation", "gain_error", "command_offset"),
    servo.commanded_angle,
    *effects_on("command_angle", "rate_limit"),
)
LOOP: tuple[Block | Placement, ...] = (
    *residual_curves("pulse_width"),
    servo.shaft_rate,
    shaft_output,
    place("gear_compliance", compliant_output, "angle", "rate", "load_rate"),
    *effects_on(("angle", "rate"), "backlash"),
    servo.feedback_voltage,
    *effects_on(
        "feedback_voltage",
        "sensor_lag",
        "sensor_nonlinearity",
        "sensor_offset",
        "sensor_quantisation",
    ),
    place("residual_map", residual_reading, "feedback_voltage"),
    servo.error,
    servo.amplifier,
    *effects_on(
        "motor_voltage",
        "direction_asymmetry",
        "hysteresis",
        "drive_dead_zone",
        "drive_saturation",
        limit={"typical": 0.3},
    ),
    place("residual_map", residual_drive, "motor_voltage"),
    servo.motor_shaft,
    servo.stiff_supply,
    servo.supply_load,
    *effects_on("supply", "supply_sag", resistance={"unit": "Ohm", "typical": 1.0, "high": 50.0}),
    *effects_on("motor_voltage", "supply_limit"),
    external_load,
    *effects_on("load", "constant_load", "gravity_load"),
    place("gear_compliance", compliant_load, "load", "load_acceleration"),
    *effects_on("friction", "load_friction"),
    *effects_on("load", "viscous_friction", "presliding_friction", "cogging"),
    place("residual_map", residual_torque, "load"),
    servo.load_voltage,
    *effects_on("loaded_voltage", "thermal_drift"),
    servo.motor_curve,
    servo.saturation_flag,
)
SHAFT: tuple[Block | Placement, ...] = (
    *effects_on("friction", "coulomb_friction", "stribeck_friction"),
    servo.motor_lag,
    shaft_acceleration,
)


READINGS: tuple[Block | Placement, ...] = (
    servo.readings,
    *outside_sensor("reading", "angle_reading"),
    *outside_sensor("gyro", "rate_reading"),
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
TERMINALS = {"shaft": ("load_torque", "angle", "rate"), "supply": ("supply_voltage",)}

PLANT = Plant(
    inputs=INPUTS,
    wires=WIRES,
    constants=internal_step(2e-3),
    chain=(*COMMAND, *LOOP, *SHAFT, *READINGS),
    states=(State(ANGLE, "shaft_rate"), State(SPEED, "acceleration"), *SECOND_MASS),
    projection=shaft_contact,
    outputs=OUTPUTS,
    terminals=TERMINALS,
)

PAPER_PLANT = PLANT.rated(scales=dict.fromkeys(("rate", "load_rate"), PAPER_RATE))

_SHAFT_ONLY = ("load_inertia", "end_stops", "load_friction")
OSCILLATORY_PLANT = Plant(
    inputs=INPUTS,
    wires=WIRES,
    constants=internal_step(2e-3),
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
    terminals=TERMINALS,
).rated(scales=dict.fromkeys(("rate", "load_rate"), PAPER_RATE))
