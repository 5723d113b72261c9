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
    no_play,
    no_second_mass,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
)
from servo_models.actuators.smart_servo import physics as servo
from servo_models.actuators.wiring import (
    LEARNT,
    LOADS,
    REPORTED,
    TRACKED,
    WEAK_SUPPLY,
    input_scale,
    residual_curves,
    turning,
)
from servo_models.core.block import Block
from servo_models.core.plant import Placement, Plant, Wire, internal_step, place
from servo_models.effects import effects_on
from servo_models.effects.coasting_backlash import (
    coasting_friction,
    coasting_load,
    coasting_output,
    contact_step,
    divided_inertia,
)
from servo_models.effects.gear_compliance import compliant_load, compliant_output, resonance_step
from servo_models.effects.residual_map import residual_drive, residual_reading, residual_torque
from servo_models.effects.saturation import saturation

COUNT = 2.0 * math.pi / 4096.0  # rad
XL330_VOLTS = 5.0  # voltage at which the data sheet gives stall torque and speed
STS3215_VOLTS = 7.4  # supply of the smaller version
STS3215_HIGH_VOLTS = 12.0  # supply of the larger version
STS3215_TORQUE = 19.5 * 0.0980665  # stall torque [N m] at 7.4 V
STS3215_HIGH_TORQUE = 30.0 * 0.0980665  # stall torque [N m] at 12 V
CURRENT_LIMIT = replace(saturation.params["limit"], typical=0.3, high=10.0)
"""Limit in full scales of the current: below the stall current, or it never acts."""

INPUTS = (
    Wire("goal", "rad", "goal angle", low=-50.0, high=50.0, display="deg"),
    Wire("enabled", "1", "1 motor on, 0 off", rest=1.0, low=0.0, high=1.0, flag=True),
    Wire(
        "supply",
        "V",
        "supply",
        XL330_VOLTS,
        rest=XL330_VOLTS,
        low=0.0,
        high=30.0,
        bench=WEAK_SUPPLY,
    ),
    Wire(
        "load_torque",
        "N.m",
        "load against positive motion",
        0.5,
        low=-20.0,
        high=20.0,
        bench=LOADS,
    ),
)
WIRES = (
    Wire("angle", "rad", "angle of the output", display="deg", bench=TRACKED),
    Wire("rate", "rad/s", "rate of the output", scale=10.0, display="deg/s"),
    Wire("angle_reading", "rad", "angle as read by the encoder", display="deg", bench=REPORTED),
    Wire("error", "rad", "error of the position loop", display="deg"),
    Wire("duty", "1", "part of the supply on the motor", bench=REPORTED),
    Wire("bridge_supply", "V", "supply of the bridge under load", XL330_VOLTS, XL330_VOLTS),
    Wire("motor_voltage", "V", "mean voltage on the motor", scale=XL330_VOLTS),
    Wire("current", "A", "current of the motor", scale=1.5, bench=REPORTED),
    Wire("friction", "N.m", "dry friction level", scale=0.5),
    Wire("load", "N.m", "load torque with all its parts", scale=0.5),
    Wire("load_rate", "rad/s", "rate behind the compliance", scale=10.0),
    Wire("load_acceleration", "rad/s2", "acceleration behind the compliance", scale=1e3),
    Wire("coasting_inertia", "kg.m2", "inertia behind the play", scale=5e-3),
    Wire("play_twist", "rad", "angle of the gear over that behind the play", display="deg"),
    Wire("play_slip", "rad/s", "rate of the gear over that behind the play", scale=10.0),
    Wire("coasting_rate", "rad/s", "rate behind the play", scale=10.0),
    Wire("coasting_torque", "N.m", "torque on the mass behind the play, friction apart", scale=0.5),
    Wire("coasting_acceleration", "rad/s2", "acceleration behind the play", scale=1e3),
    Wire("shaft_inertia", "kg.m2", "accelerated inertia", scale=5e-3),
    Wire("travel", "rad", "half range of the output", scale=math.pi, display="deg"),
    *LEARNT,
)

GOAL: tuple[Block | Placement, ...] = (
    servo.arm,
    free_shaft,
    no_second_mass,
    no_play,
    *effects_on("shaft_inertia", "load_inertia"),
    place("coasting_backlash", divided_inertia, "shaft_inertia", "coasting_inertia"),
    place("coasting_backlash", contact_step, "internal_step"),
    place("gear_compliance", resonance_step, "internal_step"),
    *effects_on("travel", "end_stops", half_range={"typical": 0.05}),
    input_scale("command_gain", "goal"),
    input_scale("load_gain", "load_torque"),
    *effects_on("goal", "transport_delay", "command_lag", "motion_profile"),
)
LOOP: tuple[Block | Placement, ...] = (
    *residual_curves("goal"),
    servo.arm_motion,
    shaft_output,
    place("gear_compliance", compliant_output, "angle", "rate", "load_rate"),
    place(
        "coasting_backlash",
        coasting_output,
        "angle",
        "rate",
        "play_twist",
        "play_slip",
        "coasting_rate",
    ),
    *effects_on(("angle", "rate"), "backlash"),
    servo.encoder,
    *effects_on(
        "angle_reading", "sensor_lag", "sensor_nonlinearity", "sensor_offset", "sensor_quantisation"
    ),
    place("residual_map", residual_reading, "angle_reading"),
    servo.comparator,
    *effects_on("error", "error_dead_zone", half_width={"typical": 0.01}),
    servo.position_loop,
    *effects_on("duty", "drive_saturation", limit={"high": 1.0}),
    *effects_on("duty", "sample_hold"),
    servo.supply_load,
    *effects_on(
        "bridge_supply", "supply_sag", resistance={"unit": "Ohm", "typical": 0.5, "high": 20.0}
    ),
    servo.bridge,
    *effects_on(
        "motor_voltage",
        "direction_asymmetry",
        "hysteresis",
        "drive_dead_zone",
        "drive_lag",
        "thermal_drift",
    ),
    place("residual_map", residual_drive, "motor_voltage"),
    servo.winding,
    place("current_limit", saturation, "current", params={"limit": CURRENT_LIMIT}),
)
TORQUES: tuple[Block | Placement, ...] = (
    external_load,
    *effects_on("load", "constant_load", "gravity_load"),
    place("coasting_backlash", coasting_load, "load", "coasting_torque"),
    place("gear_compliance", compliant_load, "load", "load_acceleration"),
    *effects_on("friction", "load_friction"),
    *effects_on("load", "viscous_friction", "presliding_friction", "cogging"),
    place("residual_map", residual_torque, "load"),
    *effects_on("friction", "coulomb_friction", "stribeck_friction"),
    place("coasting_backlash", coasting_friction, "friction", "coasting_acceleration"),
    servo.net_torque,
    shaft_acceleration,
)


SCALES = (1.0, 10.0)  # rad, rad/s

PLANT = Plant(
    inputs=INPUTS,
    wires=WIRES,
    constants=internal_step(1e-3),
    chain=(*GOAL, *LOOP, *TORQUES),
    states=(
        *turning("shaft", "shaft_rate", "acceleration", SCALES),
        *turning("load", "load_rate", "load_acceleration", SCALES, owner="gear_compliance"),
        *turning(
            "coasting",
            "coasting_rate",
            "coasting_acceleration",
            SCALES,
            owner="coasting_backlash",
            mass="mass behind the play",
        ),
    ),
    projection=shaft_contact,
    outputs=("angle", "rate", "angle_reading", "duty", "current", "bridge_supply"),
    terminals={
        "command": ("goal", "enabled"),
        "shaft": ("load_torque", "angle", "rate"),
        "supply": ("supply",),
    },
)


def sts3215(volts: float, torque: float) -> Plant:
    """The plant with the supply [V] and the loads [N m] of an STS3215, which carries an arm."""
    supplies, loads = ("supply", "bridge_supply"), ("load_torque", "friction", "load")
    return PLANT.rated(
        rests=dict.fromkeys(supplies, volts),
        scales={
            **dict.fromkeys((*supplies, "motor_voltage"), volts),
            **dict.fromkeys((*loads, "coasting_torque"), torque),
        },
    )


STS3215_PLANT = sts3215(STS3215_VOLTS, STS3215_TORQUE)
STS3215_12V_PLANT = sts3215(STS3215_HIGH_VOLTS, STS3215_HIGH_TORQUE)
