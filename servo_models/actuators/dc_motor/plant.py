"""The plants of the motor on a voltage, on a current, and in loops of speed and position."""

from __future__ import annotations

import math

from servo_models.actuators.dc_motor import physics as motor
from servo_models.actuators.shaft import (
    external_load,
    free_shaft,
    no_second_mass,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
)
from servo_models.actuators.wiring import (
    AMMETER,
    BENCH_DRIVE,
    CALIBRATED,
    LEARNT,
    LOADS,
    input_scale,
    residual_curves,
    turning,
    without,
)
from servo_models.core.block import Block
from servo_models.core.plant import Placement, Plant, State, Wire, internal_step, place
from servo_models.effects import effects_on
from servo_models.effects.gear_compliance import compliant_load, compliant_output, resonance_step
from servo_models.effects.residual_map import residual_drive, residual_reading, residual_torque

TURN = 2.0 * math.pi  # rad
VOLTS = 24.0
AMPERES = 2.0  # continuous current; the peak is several times as large
SPEED = 600.0  # rad/s, about 6000 rpm
TORQUE = 0.06  # N m, torque of AMPERES
ACCELERATION = 6e3  # rad/s2, acceleration of the bare rotor
ENCODER_STEP = 1.0 / 64.0  # step [turns] of a cheap encoder
RESONANCE = {"inertia": {"low": 1e-3, "high": 2e6}}
"""Bounds of the inertia behind a compliance, over the rotor's.  A smaller one cannot be seen; an
FMU has the bounds of a motor without a gearbox, and behind a gearbox the inertia is far larger."""

SCALES = (TURN, SPEED)

Chain = tuple[Block | Placement, ...]

LOAD = Wire(
    "load_torque",
    "N.m",
    "load against positive motion",
    TORQUE,
    low=-1e3,
    high=1e3,
    bench=LOADS,
)
VOLTAGE = Wire("voltage", "V", "voltage on the motor", VOLTS, low=-1e3, high=1e3)
CURRENT = Wire("current_command", "A", "commanded current", AMPERES, low=-1e3, high=1e3)
SPEED_COMMAND = Wire(
    "speed_command", "rad/s", "commanded speed of the motor", SPEED, low=-1e5, high=1e5
)
POSITION_COMMAND = Wire(
    "position_command",
    "rad",
    "commanded angle of the motor",
    TURN,
    low=-1e6,
    high=1e6,
    display="deg",
)
WIRES = (
    Wire("angle", "rad", "angle of the output", TURN, display="deg"),
    Wire("rate", "rad/s", "rate of the output", SPEED),
    Wire(
        "encoder_angle",
        "rad",
        "angle as read by the encoder of the motor",
        TURN,
        display="deg",
        words=("encoder",),
    ),
    Wire(
        "encoder_speed",
        "rad/s",
        "speed as read by the encoder of the motor",
        SPEED,
        words=("velocity",),
    ),
    Wire("current", "A", "current of the motor", AMPERES, bench=AMMETER),
    Wire("motor_torque", "N.m", "torque of the current, at the output", TORQUE),
    Wire("friction", "N.m", "dry friction level", TORQUE),
    Wire("load", "N.m", "load torque with all its parts", TORQUE),
    Wire("load_rate", "rad/s", "rate behind the compliance", SPEED),
    Wire("load_acceleration", "rad/s2", "acceleration behind the compliance", ACCELERATION),
    Wire("shaft_inertia", "kg.m2", "accelerated inertia", TORQUE / ACCELERATION),
    Wire("travel", "rad", "half range of the output", TURN, display="deg"),
    *LEARNT,
)
MOTOR_VOLTAGE = Wire("motor_voltage", "V", "voltage on the winding", VOLTS)

SHAFT: Chain = (
    motor.rotor,
    free_shaft,
    no_second_mass,
    *effects_on("shaft_inertia", "load_inertia"),
    place("gear_compliance", resonance_step, "internal_step", params=RESONANCE),
    *effects_on("travel", "end_stops"),
    motor.shaft_motion,
    shaft_output,
    place("gear_compliance", compliant_output, "angle", "rate", "load_rate"),
    motor.encoder,
    *effects_on("encoder_angle", "sensor_lag"),
    *without(CALIBRATED, *effects_on("encoder_angle", "sensor_nonlinearity", "sensor_offset")),
    *effects_on("encoder_angle", "sensor_quantisation", step={"typical": ENCODER_STEP}),
    *effects_on("encoder_speed", "speed_lag", "speed_quantisation"),
)
TORQUES: Chain = (
    *effects_on("current", "direction_asymmetry"),
    external_load,
    *effects_on("load", "constant_load", "gravity_load"),
    place("gear_compliance", compliant_load, "load", "load_acceleration"),
    *effects_on("friction", "load_friction"),
    *effects_on("load", "viscous_friction", "presliding_friction", "cogging"),
    place("residual_map", residual_torque, "load"),
    *effects_on("friction", "coulomb_friction", "stribeck_friction"),
    motor.motor_torque,
    *effects_on("motor_torque", "hysteresis", turn={"high": 1e3}),
    *effects_on("motor_torque", "thermal_drift", full_scale={"high": 1e3}),
    motor.net_torque,
    shaft_acceleration,
    *effects_on(("angle", "rate"), "backlash"),
)


def _drive(wire: str) -> Chain:
    """Effects of a power stage on its command, and the curves that may be of it."""
    stage = effects_on(
        wire,
        "transport_delay",
        "sample_hold",
        "command_quantisation",
        "command_offset",
        "drive_dead_zone",
        "drive_saturation",
        "rate_limit",
    )
    return (*without(BENCH_DRIVE, *stage), *residual_curves(wire))


def _plant(
    commands: tuple[Wire, ...],
    wires: tuple[Wire, ...],
    drive: Chain,
    *states: State,
    step: float = 5e-4,
) -> Plant:
    """The motor behind a drive from commands to the current; ``step`` is the internal one [s]."""
    return Plant(
        inputs=(*commands, LOAD),
        wires=(*WIRES, *wires),
        constants=internal_step(step),
        chain=(
            *SHAFT,
            input_scale("command_gain", commands[0].name),
            input_scale("load_gain", LOAD.name),
            *drive,
            *TORQUES,
        ),
        states=(
            *turning("shaft", "shaft_rate", "acceleration", SCALES),
            *turning("load", "load_rate", "load_acceleration", SCALES, owner="gear_compliance"),
            *states,
        ),
        projection=shaft_contact,
        outputs=("angle", "rate", "encoder_angle", "encoder_speed", "current"),
        terminals={
            "command": tuple(wire.name for wire in commands),
            "shaft": ("load_torque", "angle", "rate"),
        },
    )


VOLTAGE_PLANT = _plant(
    (VOLTAGE,),
    (MOTOR_VOLTAGE,),
    (
        *_drive("voltage"),
        motor.terminals,
        place("residual_map", residual_drive, "motor_voltage"),
        motor.winding,
        *effects_on("current", "winding_lag"),
    ),
    step=1e-4,  # a fifth of the time constant of the winding
)
CURRENT_PLANT = _plant(
    (CURRENT,),
    (),
    (
        *_drive("current_command"),
        place("residual_map", residual_drive, "current_command"),
        motor.current_loop,
    ),
)
SPEED_PLANT = _plant(
    (SPEED_COMMAND, POSITION_COMMAND),
    (
        Wire("speed_reference", "rad/s", "speed that the loops are to reach", SPEED),
        Wire("current_command", "A", "current that the speed loop asks for", AMPERES),
    ),
    (
        *effects_on("speed_command", "transport_delay", "command_offset", "rate_limit"),
        *residual_curves("speed_command"),
        input_scale("position_command_gain", "position_command"),
        *effects_on("position_command", "position_transport_delay", "motion_profile"),
        place("residual_map", residual_reading, "encoder_speed"),
        motor.position_loop,
        motor.speed_loop,
        *effects_on("current_command", "sample_hold", "drive_dead_zone"),
        place("residual_map", residual_drive, "current_command"),
        motor.current_loop,
    ),
    State(
        Wire("integral", "A", "integral part of the speed loop", AMPERES),
        "integral_rate",
        carried=True,
    ),
)


def geared(plant: Plant, ratio: float) -> Plant:
    """Return a plant with the full scales of an output behind a gearbox."""
    exponents = {
        **dict.fromkeys(("rate", "load_rate", "load_acceleration"), -1),
        **dict.fromkeys(("shaft_speed", "load_speed"), -1),
        **dict.fromkeys(("load_torque", "motor_torque", "friction", "load"), 1),
        "shaft_inertia": 2,
    }
    wires = {name: plant.wire[name].scale * ratio**power for name, power in exponents.items()}
    return plant.rated(scales=wires)
