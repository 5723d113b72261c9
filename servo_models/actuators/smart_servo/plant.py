"""Smart servos with a position loop in their firmware: Dynamixel XL330, Feetech STS3215.

The sets are nominal: two points of a data sheet (stall torque, no-load speed) make a DC
motor with k = V / speed and R = k V / torque.  Each variant rests at the supply of these
points.  The inertia is that of the bare servo, its rotor behind the gears: add that of an arm.
Friction, which no data sheet gives, decides how such a servo moves; identify it from logs.
"""

from __future__ import annotations

import math
from dataclasses import replace

from servo_models.actuators.shaft import (
    external_load,
    free_shaft,
    no_second_mass,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
)
from servo_models.actuators.smart_servo import physics as servo
from servo_models.core.block import Block, Param
from servo_models.core.plant import Placement, Plant, State, Wire, place
from servo_models.effects.backlash import backlash
from servo_models.effects.cogging import cogging
from servo_models.effects.constant_load import constant_load
from servo_models.effects.coulomb_friction import coulomb_friction
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.direction_asymmetry import direction_asymmetry
from servo_models.effects.end_stops import end_stops
from servo_models.effects.gear_compliance import (
    compliant_load,
    compliant_output,
    resonance_step,
)
from servo_models.effects.gravity_load import gravity_load
from servo_models.effects.lag import lag
from servo_models.effects.load_friction import load_friction
from servo_models.effects.load_inertia import load_inertia
from servo_models.effects.nonlinearity import nonlinearity
from servo_models.effects.offset import offset
from servo_models.effects.quantisation import quantisation
from servo_models.effects.rate_limit import rate_limit
from servo_models.effects.sample_hold import sample_hold
from servo_models.effects.stribeck_friction import stribeck_friction
from servo_models.effects.supply_sag import supply_sag
from servo_models.effects.thermal_drift import thermal_drift
from servo_models.effects.transport_delay import transport_delay
from servo_models.effects.viscous_friction import viscous_friction

COUNT = 2.0 * math.pi / 4096.0
XL330_VOLTS = 5.0  # recommended by its data sheet; stall torque and speed are given there
STS3215_VOLTS = 7.4  # of the version whose stall torque and speed are used

INPUTS = (
    Wire("goal", "rad", "goal angle", low=-50.0, high=50.0, display="deg"),
    Wire("enabled", "1", "1 motor on, 0 off", rest=1.0, low=0.0, high=1.0, flag=True),
    Wire("supply", "V", "supply", scale=XL330_VOLTS, rest=XL330_VOLTS, low=0.0, high=30.0),
    Wire("load_torque", "N.m", "load against positive motion", scale=0.5, low=-20.0, high=20.0),
)
WIRES = (
    Wire("angle", "rad", "angle of the output", display="deg"),
    Wire("rate", "rad/s", "rate of the output", scale=10.0, display="deg/s"),
    Wire("angle_reading", "rad", "angle as read by the encoder", display="deg"),
    Wire("error", "rad", "error of the position loop", display="deg"),
    Wire("duty", "1", "part of the supply on the motor"),
    Wire(
        "bridge_supply",
        "V",
        "supply of the bridge under load",
        scale=XL330_VOLTS,
        rest=XL330_VOLTS,
    ),
    Wire("motor_voltage", "V", "mean voltage on the motor", scale=XL330_VOLTS),
    Wire("current", "A", "current of the motor", scale=1.5),
    Wire("friction", "N.m", "dry friction level", scale=0.5),
    Wire("load", "N.m", "load torque with all its parts", scale=0.5),
    Wire("load_rate", "rad/s", "rate behind the compliance", scale=10.0),
    Wire("load_acceleration", "rad/s2", "acceleration behind the compliance", scale=1e3),
    Wire("shaft_inertia", "kg.m2", "accelerated inertia", scale=5e-3),
    Wire("travel", "rad", "half range of the output", scale=math.pi, display="deg"),
)
STEP = Param(
    "s", "longest internal step", default=1e-3, low=1e-5, high=5e-3, display="us", fixed=True
)
_source = replace(supply_sag.params["resistance"], typical=0.5, high=20.0)
_zone = replace(dead_zone.params["half_width"], typical=0.01)
_stop = replace(end_stops.params["half_range"], typical=0.05)

GOAL: tuple[Block | Placement, ...] = (
    servo.arm,
    free_shaft,
    no_second_mass,
    place("load_inertia", load_inertia, "shaft_inertia"),
    place("gear_compliance", resonance_step, "internal_step"),
    place("end_stops", end_stops, "travel", params={"half_range": _stop}),
    place("transport_delay", transport_delay, "goal"),
    place("rate_limit", rate_limit, "goal"),
)
LOOP: tuple[Block | Placement, ...] = (
    servo.arm_motion,
    shaft_output,
    place("gear_compliance", compliant_output, "angle", "rate", "load_rate"),
    place("backlash", backlash, "angle", "rate"),
    servo.encoder,
    place("sensor_lag", lag, "angle_reading"),
    place("sensor_nonlinearity", nonlinearity, "angle_reading"),
    place("sensor_offset", offset, "angle_reading"),
    place("sensor_quantisation", quantisation, "angle_reading"),
    servo.comparator,
    place("error_dead_zone", dead_zone, "error", params={"half_width": _zone}),
    servo.position_loop,
    place("sample_hold", sample_hold, "duty"),
    servo.supply_load,
    place("supply_sag", supply_sag, "bridge_supply", params={"resistance": _source}),
    servo.bridge,
    place("direction_asymmetry", direction_asymmetry, "motor_voltage"),
    place("drive_dead_zone", dead_zone, "motor_voltage"),
    place("drive_lag", lag, "motor_voltage"),
    place("thermal_drift", thermal_drift, "motor_voltage"),
    servo.winding,
)
TORQUES: tuple[Block | Placement, ...] = (
    external_load,
    place("constant_load", constant_load, "load"),
    place("gravity_load", gravity_load, "load"),
    place("gear_compliance", compliant_load, "load", "load_acceleration"),
    place("load_friction", load_friction, "friction"),
    place("viscous_friction", viscous_friction, "load"),
    place("cogging", cogging, "load"),
    place("coulomb_friction", coulomb_friction, "friction"),
    place("stribeck_friction", stribeck_friction, "friction"),
    servo.net_torque,
    shaft_acceleration,
)


def _turning(which: str, rate: str, acceleration: str, owner: str = "") -> tuple[State, State]:
    """Angle and speed of one mass."""
    angle = Wire(f"{which}_angle", "rad", f"angle of the {which}", display="deg")
    speed = Wire(f"{which}_speed", "rad/s", f"speed of the {which}", scale=10.0)
    return State(angle, rate, owner=owner), State(speed, acceleration, owner=owner)


PLANT = Plant(
    inputs=INPUTS,
    wires=WIRES,
    constants={"internal_step": STEP},
    chain=(*GOAL, *LOOP, *TORQUES),
    states=(
        *_turning("shaft", "shaft_rate", "acceleration"),
        *_turning("load", "load_rate", "load_acceleration", owner="gear_compliance"),
    ),
    projection=shaft_contact,
    outputs=("angle", "rate", "angle_reading", "duty", "current"),
)
STS3215_PLANT = PLANT.rated(
    rests=dict.fromkeys(("supply", "bridge_supply"), STS3215_VOLTS),
    scales=dict.fromkeys(("supply", "bridge_supply", "motor_voltage"), STS3215_VOLTS),
)
