"""Electro-Mechanical Positioning System: a linear drive in its discrete position loop.

Source of all values: A. Janot, M. Gautier, M. Brunot, "Data set and reference models of
EMPS", Workshop on Nonlinear System Identification Benchmarks, 2019 (nonlinearbenchmark.org).
"""

from __future__ import annotations

import math
from dataclasses import replace

from servo_models.actuators.linear_drive import physics as drive
from servo_models.actuators.shaft import free_shaft, shaft_acceleration, shaft_contact
from servo_models.core.block import Block, Param
from servo_models.core.plant import Placement, Plant, State, Wire, place
from servo_models.effects.backlash import backlash
from servo_models.effects.cogging import cogging
from servo_models.effects.coulomb_friction import coulomb_friction
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.direction_asymmetry import direction_asymmetry
from servo_models.effects.end_stops import end_stops
from servo_models.effects.gain_error import gain_error
from servo_models.effects.hysteresis import hysteresis
from servo_models.effects.lag import lag
from servo_models.effects.load_friction import load_friction
from servo_models.effects.load_inertia import load_inertia
from servo_models.effects.nonlinearity import nonlinearity
from servo_models.effects.offset import offset
from servo_models.effects.quantisation import quantisation
from servo_models.effects.rate_limit import rate_limit
from servo_models.effects.saturation import saturation
from servo_models.effects.stribeck_friction import stribeck_friction
from servo_models.effects.thermal_drift import thermal_drift
from servo_models.effects.transport_delay import transport_delay

STROKE = 0.25

INPUTS = (
    Wire("reference", "m", "commanded position", scale=0.02, low=-1.0, high=1.0, display="mm"),
    Wire("disturbance", "V", "voltage added to the drive", scale=5.0, low=-100.0, high=100.0),
    Wire("load_force", "N", "force against positive motion", scale=100.0, low=-1e4, high=1e4),
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
)
STEP = Param(
    "s", "longest internal step", default=2e-3, low=1e-5, high=5e-3, display="us", fixed=True
)
_delay = replace(transport_delay.params["time"], high=0.02, typical=0.001)
_stop = replace(end_stops.params["half_range"], typical=0.1)
_sticky = replace(stribeck_friction.params["excess"], typical=0.3)
_ripple = Param("1/m", "2 pi over the period", default=200.0 * math.pi, low=1.0, high=1e5)

BEFORE: tuple[Block | Placement, ...] = (
    drive.carriage,
    free_shaft,
    place("load_mass", load_inertia, "shaft_inertia"),
    place("end_stops", end_stops, "travel", params={"half_range": _stop}),
    drive.carriage_motion,
    place("backlash", backlash, "position", "speed"),
)
LOOP: tuple[Block | Placement, ...] = (
    drive.encoder,
    place("sensor_lag", lag, "reading"),
    place("sensor_nonlinearity", nonlinearity, "reading"),
    place("sensor_gain", gain_error, "reading"),
    place("sensor_offset", offset, "reading"),
    place("sensor_quantisation", quantisation, "reading"),
    drive.position_controller,
    place("transport_delay", transport_delay, "controller_voltage", params={"time": _delay}),
    drive.amplifier,
    drive.terminals,
    place("gain_error", gain_error, "motor_voltage"),
    place("direction_asymmetry", direction_asymmetry, "motor_voltage"),
    place("hysteresis", hysteresis, "motor_voltage"),
    place("drive_dead_zone", dead_zone, "motor_voltage"),
    place("drive_saturation", saturation, "motor_voltage"),
    place("rate_limit", rate_limit, "motor_voltage"),
    place("drive_lag", lag, "motor_voltage"),
    place("thermal_drift", thermal_drift, "motor_voltage"),
)
FORCES: tuple[Block | Placement, ...] = (
    drive.external_force,
    place("load_friction", load_friction, "friction"),
    place("cogging", cogging, "load", params={"count": _ripple}),
    place("coulomb_friction", coulomb_friction, "friction"),
    place("stribeck_friction", stribeck_friction, "friction", params={"excess": _sticky}),
    drive.net_force,
    shaft_acceleration,
)

PLANT = Plant(
    inputs=INPUTS,
    wires=WIRES,
    constants={"internal_step": STEP},
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
)
