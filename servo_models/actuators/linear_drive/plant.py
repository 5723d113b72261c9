"""Electro-Mechanical Positioning System: a linear drive in its discrete position loop.

Source of all values: A. Janot, M. Gautier, M. Brunot, "Data set and reference models of
EMPS", Workshop on Nonlinear System Identification Benchmarks, 2019 (nonlinearbenchmark.org).
"""

from __future__ import annotations

import math

from servo_models.actuators.linear_drive import physics as drive
from servo_models.actuators.shaft import free_shaft, shaft_acceleration, shaft_contact
from servo_models.actuators.wiring import LEARNT, LOADS, input_scale, residual_curves
from servo_models.core.block import Block
from servo_models.core.plant import Placement, Plant, State, Wire, internal_step, place
from servo_models.effects import effects_on
from servo_models.effects.gain_error import gain_error
from servo_models.effects.load_inertia import load_inertia
from servo_models.effects.residual_map import residual_drive, residual_reading, residual_torque

STROKE = 0.25  # half range of the carriage [m]

INPUTS = (
    Wire("reference", "m", "commanded position", scale=0.02, low=-1.0, high=1.0, display="mm"),
    Wire("disturbance", "V", "voltage added to the drive", scale=5.0, low=-100.0, high=100.0),
    Wire(
        "load_force",
        "N",
        "force against positive motion",
        100.0,
        low=-1e4,
        high=1e4,
        bench=LOADS,
    ),
)
WIRES = (
    Wire("position", "m", "position of the carriage", scale=STROKE, display="mm"),
    Wire("speed", "m/s", "speed of the carriage", scale=0.1, display="mm/s"),
    Wire("controller_voltage", "V", "drive that the controller asks for", scale=10.0),
    Wire("drive", "V", "drive, disturbance included", scale=10.0),
    Wire("reading", "m", "position read by the controller", scale=STROKE, display="mm"),
    Wire("motor_voltage", "V", "voltage on the motor", scale=10.0),
    Wire("friction", "N", "dry friction level", scale=100.0),
    Wire("load", "N", "load force with all its parts", scale=100.0),
    Wire("shaft_inertia", "kg", "accelerated mass", scale=100.0),
    Wire("travel", "m", "half range of the carriage", scale=STROKE, display="mm"),
    *LEARNT,
)
RIPPLE = {
    "unit": "1/m",
    "about": "2 pi over the period",
    "default": 200.0 * math.pi,
    "low": 1.0,
    "high": 1e5,
}

BEFORE: tuple[Block | Placement, ...] = (
    drive.carriage,
    free_shaft,
    place("load_mass", load_inertia, "shaft_inertia"),
    *effects_on("travel", "end_stops", half_range={"typical": 0.1}),
    drive.carriage_motion,
    *effects_on(("position", "speed"), "backlash"),
)
LOOP: tuple[Block | Placement, ...] = (
    input_scale("command_gain", "reference"),
    input_scale("load_gain", "load_force"),
    *residual_curves("reference", "load_force"),
    drive.encoder,
    *effects_on("reading", "sensor_lag", "sensor_nonlinearity"),
    place("sensor_gain", gain_error, "reading"),
    *effects_on("reading", "sensor_offset", "sensor_quantisation"),
    place("residual_map", residual_reading, "reading"),
    drive.position_controller,
    *effects_on("controller_voltage", "transport_delay", time={"high": 0.02, "typical": 0.001}),
    drive.amplifier,
    drive.terminals,
    *effects_on(
        "motor_voltage",
        "gain_error",
        "direction_asymmetry",
        "hysteresis",
        "drive_dead_zone",
        "drive_saturation",
        "rate_limit",
        "drive_lag",
        "thermal_drift",
    ),
    place("residual_map", residual_drive, "motor_voltage"),
)
FORCES: tuple[Block | Placement, ...] = (
    drive.external_force,
    *effects_on("friction", "load_friction"),
    *effects_on("load", "presliding_friction", "cogging", count=RIPPLE),
    *effects_on("friction", "coulomb_friction", "stribeck_friction", excess={"typical": 0.3}),
    place("residual_map", residual_torque, "load"),
    drive.net_force,
    shaft_acceleration,
)

PLANT = Plant(
    inputs=INPUTS,
    wires=WIRES,
    constants=internal_step(2e-3),
    chain=(*BEFORE, *LOOP, *FORCES),
    states=(
        State(
            Wire("shaft_angle", "m", "position of the motor", scale=STROKE, display="mm"),
            "shaft_rate",
        ),
        State(
            Wire("shaft_speed", "m/s", "speed of the motor", scale=0.1, display="mm/s"),
            "acceleration",
        ),
    ),
    projection=shaft_contact,
    outputs=("position", "speed", "drive"),
    terminals={"shaft": ("load_force", "position", "speed")},
)
