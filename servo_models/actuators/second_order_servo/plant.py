"""Any PWM or bus servo: wires, the chain of blocks between them, and where every effect stands."""

from __future__ import annotations

import math

from servo_models.actuators.second_order_servo import physics as servo
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
    REPORTED,
    TRACKED,
    input_scale,
    outside_sensor,
    residual_curves,
    turning,
)
from servo_models.core.block import Block
from servo_models.core.plant import Placement, Plant, Wire, internal_step, place
from servo_models.effects import effects_on
from servo_models.effects.gear_compliance import compliant_load, compliant_output, resonance_step
from servo_models.effects.residual_map import residual_drive, residual_reading, residual_torque

HALF_RANGE = math.radians(90.0)
SPEED = 10.0  # rad/s: 60 degrees in 0.1 s
TORQUE = 0.2  # N m: 2 kg cm
ACCELERATION = 500.0  # rad/s2

INPUTS = (
    Wire("pulse_width", "s", "command pulse", 1e-3, servo.REST_PULSE, 0.0, 5e-3, display="us"),
    Wire(
        "goal",
        "rad",
        "goal angle, of a bus servo",
        HALF_RANGE,
        low=-50.0,
        high=50.0,
        display="deg",
        words=("action",),
    ),
    Wire(
        "load_torque",
        "N.m",
        "load against positive motion",
        TORQUE,
        low=-20.0,
        high=20.0,
        bench=LOADS,
    ),
)
WIRES = (
    Wire("angle", "rad", "angle of the output", HALF_RANGE, display="deg"),
    Wire("rate", "rad/s", "rate of the output", SPEED, display="deg/s"),
    Wire("reference", "rad", "angle that is asked for", HALF_RANGE, display="deg"),
    Wire(
        "feedback",
        "rad",
        "angle as the servo itself measures it",
        HALF_RANGE,
        display="deg",
        bench=REPORTED,
    ),
    Wire("error", "rad", "error of the position loop", HALF_RANGE, display="deg"),
    Wire("drive", "rad/s", "speed that the position loop asks for", SPEED, display="deg/s"),
    Wire(
        "angle_reading",
        "rad",
        "angle as read from outside",
        HALF_RANGE,
        display="deg",
        bench=TRACKED,
    ),
    Wire("rate_reading", "rad/s", "rate as read by a gyro", SPEED, display="deg/s", bench=GYRO),
    Wire("friction", "N.m", "dry friction level", TORQUE),
    Wire("load", "N.m", "load torque with all its parts", TORQUE),
    Wire("load_rate", "rad/s", "rate behind the compliance", SPEED),
    Wire("load_acceleration", "rad/s2", "acceleration behind the compliance", ACCELERATION),
    Wire("shaft_inertia", "kg.m2", "accelerated inertia", TORQUE / ACCELERATION),
    Wire("travel", "rad", "half range of the output", HALF_RANGE, display="deg"),
    *LEARNT,
)

COMMAND: tuple[Block | Placement, ...] = (
    servo.output_shaft,
    free_shaft,
    no_second_mass,
    *effects_on("shaft_inertia", "load_inertia"),
    place("gear_compliance", resonance_step, "internal_step"),
    *effects_on("travel", "end_stops"),
    servo.command_decoder,
    input_scale("command_gain", "reference"),
    input_scale("load_gain", "load_torque"),
    *effects_on(
        "reference",
        "transport_delay",
        "command_lag",
        "sample_hold",
        "dead_band",
        "command_quantisation",
        "command_offset",
        "rate_limit",
        "stiction",
    ),
)
LOOP: tuple[Block | Placement, ...] = (
    *residual_curves("reference"),
    servo.shaft_motion,
    shaft_output,
    place("gear_compliance", compliant_output, "angle", "rate", "load_rate"),
    *effects_on(("angle", "rate"), "backlash"),
    servo.position_sensor,
    *effects_on(
        "feedback", "sensor_lag", "sensor_nonlinearity", "sensor_offset", "sensor_quantisation"
    ),
    place("residual_map", residual_reading, "feedback"),
    servo.comparator,
    *effects_on("error", "error_dead_zone", half_width={"typical": 0.01}),
    servo.position_loop,
    *effects_on("drive", "direction_asymmetry", "hysteresis", "drive_lag", "thermal_drift"),
    place("residual_map", residual_drive, "drive"),
)
TORQUES: tuple[Block | Placement, ...] = (
    external_load,
    *effects_on("load", "constant_load", "gravity_load"),
    place("gear_compliance", compliant_load, "load", "load_acceleration"),
    *effects_on("friction", "load_friction"),
    *effects_on("load", "viscous_friction", "presliding_friction", "cogging"),
    place("residual_map", residual_torque, "load"),
    *effects_on("friction", "coulomb_friction", "stribeck_friction"),
    servo.net_torque,
    shaft_acceleration,
)


READINGS: tuple[Block | Placement, ...] = (
    servo.readings,
    *outside_sensor("reading", "angle_reading"),
    *outside_sensor("gyro", "rate_reading"),
)


PLANT = Plant(
    inputs=INPUTS,
    wires=WIRES,
    constants=internal_step(1e-3),
    chain=(*COMMAND, *LOOP, *TORQUES, *READINGS),
    states=(
        *turning("shaft", "shaft_rate", "acceleration", (HALF_RANGE, SPEED)),
        *turning(
            "load", "load_rate", "load_acceleration", (HALF_RANGE, SPEED), owner="gear_compliance"
        ),
    ),
    projection=shaft_contact,
    outputs=("angle", "rate", "feedback", "drive", "angle_reading", "rate_reading"),
    terminals={
        "command": ("pulse_width", "goal"),
        "shaft": ("load_torque", "angle", "rate"),
    },
)
BUS_TORQUE = 2.0  # N m: 20 kg cm
BUS_PLANT = PLANT.rated(
    scales={
        **dict.fromkeys(("load_torque", "friction", "load"), BUS_TORQUE),
        "shaft_inertia": BUS_TORQUE / ACCELERATION,
    }
)
