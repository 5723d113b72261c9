"""The rigs on the bench: numbers, what is known of them, and how they are driven and logged.

Nominal numbers and their uncertainties are those that a description states; the names in them
are the product's, the constants of the simulation are frequencies and ratios made from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from servo_models.withheld.rig.laws import CODE

Values = Mapping[str, float]

CURRENT, VOLTAGE, SPEED_LOOP, ANGLE_LOOP, FIRMWARE = range(5)
"""What a command becomes: the motor's current or voltage, or a goal of speed or angle."""


@dataclass(frozen=True)
class Signal:
    """A column of a log: number in the file = (SI - ``zero``) / ``unit_size``."""

    name: str
    unit: str
    unit_size: float
    digits: int = 9

    @property
    def column(self) -> str:
        return f"{self.name}_{self.unit}"


@dataclass(frozen=True)
class Rig:
    """A rig and how it is used.

    Attributes:
        actuator, variant: as descriptions call them.
        nominal: true values scatter about these [SI].
        spread: relative standard deviations of that scatter.
        constants: from true values to settings of the simulation.
        units: from true values to settings per SI unit of an effect's parameter, by name.
        command: what is commanded, ``rest`` its value at rest [SI].
        amplitude: range of the largest excursion from rest [SI].
        load: range of the load torque [N m], known to the description, or with a column of it.
        strength: from true values to the load torque [N m] that the rig can hold.
        readings: what is logged always, then what may be logged as well: signal and place
            (0 angle, 1 drive or current, 2 feedback or encoder, 3 rate, 4 current under a duty).
        further: what may be logged beside these in a log that is asked for.
        fastest, slowest: time constants of the nominal rig [s].
        step: of the simulation [s]; ``sampling`` in these steps.
        settle: time [s] for which the rig is held at rest before a log begins.
        chirp: range of the highest frequency [Hz].
        integrators: from the command to the angle of a rig that nothing holds: what it plays and
            its load are balanced, so that it comes back.
    """

    actuator: str
    variant: str
    about: str
    nominal: Values
    spread: Values
    constants: Callable[[Values], dict[str, float]]
    units: Callable[[Values], dict[str, float]]
    command: Signal
    rest: float
    amplitude: tuple[float, float]
    load: tuple[float, float]
    strength: Callable[[Values], float]
    readings: tuple[tuple[Signal, int], ...]
    fastest: float
    slowest: float
    step: float
    sampling: tuple[int, ...]
    settle: float
    chirp: tuple[float, float]
    integrators: int = 0
    further: tuple[tuple[Signal, int], ...] = ()


LOAD = Signal("load_torque", "N.m", 1.0)  # a load that changes, as logged
REST, VOLTS_PER_SECOND, SUPPLY, GEAR, K_F = 1.5e-3, 250.0, 5.0, 24.0, 0.1
PULSE_PER_ANGLE = (2400e-6 - 544e-6) / math.pi
STALL_TORQUE, STALL_VOLTAGE, NO_LOAD = 0.1765, 4.8, 51.1 * 4.8 / GEAR
ARMATURE = 7.0
SERVO = {
    "motor_time_constant": 0.0347,
    "motor_gain": 51.1,
    "amplifier_gain": 77.7,
    "potentiometer_gain": VOLTS_PER_SECOND * PULSE_PER_ANGLE / K_F,
    "transport_delay.time": 0.0289,
}


def servo_constants(true: Values) -> dict[str, float]:
    """Natural frequency [rad/s], decay [1/s] and top speed [rad/s] of the loop."""
    supply = true.get("supply_voltage", SUPPLY)
    lag, top = true["motor_time_constant"], true["motor_gain"] * supply / GEAR
    band = supply / (true["amplifier_gain"] * K_F * true["potentiometer_gain"])
    natural = math.sqrt(top / (band * lag))
    return {
        "loop.kind": ANGLE_LOOP,
        "shaft.inertia": lag * STALL_TORQUE / NO_LOAD,
        "shaft.natural_frequency": natural,
        "shaft.decay": 1.0 / lag,
        "loop.top_speed": top,
        "loop.rest": REST * VOLTS_PER_SECOND / (K_F * true["potentiometer_gain"]),
        "loop.drive_per_load": STALL_VOLTAGE / STALL_TORQUE / supply,
        "feedback.full_scale": 6.0 / true["potentiometer_gain"],
        "reading.drive_unit": supply,
        "reading.feedback_unit": true["potentiometer_gain"],
        "command.scale": VOLTS_PER_SECOND / (K_F * true["potentiometer_gain"]),
        "command.delay": true["transport_delay.time"],
        "shaft.stop_frequency": 3e3,
        "gear.contact_rate": 1e4,
        "friction.bristle_stiffness": 1000.0,
    }


def servo_units(true: Values) -> dict[str, float]:
    """An angle per volt of command and of feedback, shares of the drive per volt, and so on."""
    supply = true.get("supply_voltage", SUPPLY)
    return {
        "1": 1.0,
        "command": 1.0 / (K_F * true["potentiometer_gain"]),
        "feedback": 1.0 / true["potentiometer_gain"],
        "drive": 1.0 / supply,
        "heat": (supply / SUPPLY) ** 2,
        "drag": 1.0 / NO_LOAD,
        "speed": NO_LOAD,
        "source": 1.0 / ARMATURE,
    }


STOP = math.radians(3.0)
MOTOR = {
    "torque_constant": 6.432,
    "back_emf_constant": 0.08,
    "resistance": 3630.0,
    "inductance": 34.0,
    "rotor_inertia": 7.246e-7,
    "friction_coefficient": 2.7e-4,
    "stiffness": 1.1,
}


def motor_constants(true: Values) -> dict[str, float]:
    """Electrical corner [rad/s], natural frequency [rad/s] and decay [1/s] of the rotor."""
    return {
        "loop.kind": VOLTAGE,
        "shaft.inertia": true["rotor_inertia"],
        "shaft.natural_frequency": math.sqrt(true["stiffness"] / true["rotor_inertia"]),
        "shaft.decay": true["friction_coefficient"] / true["rotor_inertia"],
        "motor.corner": true["resistance"] / true["inductance"],
        "motor.resistance": true["resistance"],
        "motor.flux_per_angle": true["back_emf_constant"] / true["inductance"],
        "motor.torque_per_current": true["torque_constant"],
        "shaft.travel": STOP,
        "shaft.stop_frequency": 3.5e4,
        "friction.bristle_stiffness": 600.0,
        "reading.full_scale": STOP,
    }


def motor_units(true: Values) -> dict[str, float]:
    """All in SI; drag and speed per full speed."""
    return {"1": 1.0, "drag": 1.0 / 100.0, "speed": 100.0}


BUS_VOLTS, BUS_TORQUE, BUS_SPEED = 7.4, 19.5 * 0.0980665, 52.0 * 2.0 * math.pi / 60.0
BUS_GAIN, BUS_TICK = 16.0, 1e-3
BUS_STEP = 1e-4
BUS = {
    "torque_constant": BUS_VOLTS / BUS_SPEED,
    "resistance": BUS_VOLTS / BUS_SPEED * BUS_VOLTS / BUS_TORQUE,
    "inertia": 0.028,
    "loop_factor": 0.166,
}


def bus_constants(true: Values) -> dict[str, float]:
    """Motor, loop gain and clock of a servo with firmware."""
    return {
        "loop.kind": FIRMWARE,
        "shaft.inertia": true["inertia"],
        "motor.torque_per_current": true["torque_constant"],
        "motor.resistance": true["resistance"],
        "loop.supply": true.get("supply", BUS_VOLTS),
        "loop.duty_per_angle": BUS_GAIN * true["loop_factor"],
        "loop.tick": float(round(BUS_TICK / BUS_STEP)),
        "feedback.step": CODE,
        "shaft.stop_frequency": 3e3,
        "gear.contact_rate": 1e4,
        "friction.bristle_stiffness": 1e4,
    }


def bus_units(true: Values) -> dict[str, float]:
    """All in SI; drag and speed per full speed."""
    supply = true.get("supply", BUS_VOLTS)
    return {"1": 1.0, "drag": 1.0 / 10.0, "speed": 10.0, "heat": (supply / BUS_VOLTS) ** 2}


PULSE_REST, PULSE_SPEED, PULSE_STALL, PULSE_ACCELERATION = 1.5e-3, math.pi / 3.0 / 0.12, 0.18, 300.0
PULSE_GAIN = 0.5 * math.pi / 1e-3
PULSE_FULL_ANGLE, PULSE_FULL_SPEED = 0.5 * math.pi, 10.0
PULSE = {
    "natural_frequency": 30.0,
    "damping_ratio": 0.8,
    "transport_delay.time": 0.01,
    "acceleration_limit": PULSE_ACCELERATION,
    "inertia": PULSE_STALL / PULSE_ACCELERATION,
    "pulse_gain": PULSE_GAIN,
    "speed_limit": PULSE_SPEED,
}


def pulse_constants(true: Values) -> dict[str, float]:
    """A loop whose error, and the torque behind it, are limited."""
    natural, ratio = true["natural_frequency"], true["damping_ratio"]
    return {
        "loop.kind": ANGLE_LOOP,
        "shaft.inertia": true["inertia"],
        "shaft.natural_frequency": natural,
        "shaft.decay": 2.0 * ratio * natural,
        "loop.top_speed": true["speed_limit"],
        "loop.largest_error": 2.0 * ratio * true["speed_limit"] / natural,
        "loop.full": math.inf,
        "loop.acceleration": true["acceleration_limit"],
        "command.zero": PULSE_REST,
        "command.scale": true["pulse_gain"],
        "feedback.full_scale": PULSE_FULL_ANGLE,
        "command.delay": true["transport_delay.time"],
        "shaft.stop_frequency": 3e3,
        "gear.contact_rate": 1e4,
        "friction.bristle_stiffness": 1000.0,
    }


def pulse_units(true: Values) -> dict[str, float]:
    """A pulse per angle, shares of the top speed, and the heat of it."""
    top = true["speed_limit"]
    return {
        "1": 1.0,
        "command": 1.0 / true["pulse_gain"],
        "drive": 1.0 / top,
        "drag": 1.0 / top,
        "speed": top,
        "heat": (top / PULSE_FULL_SPEED) ** 2,
    }


def pulse_strength(true: Values) -> float:
    """Torque [N m] at standstill: of the largest acceleration, or of the top speed asked for."""
    wanted = 2.0 * true["damping_ratio"] * true["natural_frequency"] * true["speed_limit"]
    return true["inertia"] * min(wanted, true["acceleration_limit"])


LOOP_TORQUE, LOOP_SPEED = 0.06, 200.0 * math.pi
LOOP_STEP = 5e-5
GEARBOX, ENCODER_SCALE = 50.0, 2.0 * math.pi
ROTOR = {"rotor_inertia": 1e-5, "torque_constant": 0.03, "viscous_coefficient": 2e-6}
ROTOR_SPREAD = {"rotor_inertia": 0.3, "torque_constant": 0.2, "viscous_coefficient": 0.5}
LOOP = {**ROTOR, "speed_gain": 0.02, "integral_time": 0.05, "current_limit": 5.0}
WOUND = {**ROTOR, "resistance": 2.0, "winding_lag.time_constant": 5e-4}


def rotor_constants(true: Values, ratio: float = 1.0) -> dict[str, float]:
    """A free rotor on a current, seen behind a gearbox; its encoder is on the rotor."""
    return {
        "shaft.inertia": ratio * ratio * true["rotor_inertia"],
        "shaft.natural_frequency": 0.0,
        "shaft.decay": true["viscous_coefficient"] / true["rotor_inertia"],
        "motor.torque_per_current": ratio * true["torque_constant"],
        "friction.bristle_stiffness": 100.0 * ratio * ratio,
        "reading.feedback_unit": ratio,
        "reading.full_scale": ENCODER_SCALE / ratio,
    }


def rotor_units(ratio: float = 1.0) -> dict[str, float]:
    """All in SI; drag and speed per full speed, heat of the full torque, the encoder's angle."""
    return {
        "1": 1.0,
        "drag": ratio / LOOP_SPEED,
        "speed": LOOP_SPEED / ratio,
        "heat": 1.0 / (ratio * LOOP_TORQUE) ** 2,
        "encoder": 1.0 / ratio,
    }


def loop_constants(true: Values) -> dict[str, float]:
    """A free rotor under the current of a PI loop about its speed."""
    return {
        **rotor_constants(true),
        "loop.kind": SPEED_LOOP,
        "loop.largest_current": true["current_limit"],
        "loop.gain": true["speed_gain"],
        "loop.rate": 1.0 / true["integral_time"],
    }


def loop_units(true: Values) -> dict[str, float]:
    """Those of the rotor, and steps per second."""
    return {**rotor_units(), "tick": 1.0 / LOOP_STEP}


def wound_constants(true: Values) -> dict[str, float]:
    """A geared rotor whose winding is on a voltage."""
    rotor, corner = rotor_constants(true, GEARBOX), 1.0 / true["winding_lag.time_constant"]
    return {
        **rotor,
        "loop.kind": VOLTAGE,
        "motor.corner": corner,
        "motor.resistance": true["resistance"],
        "motor.flux_per_angle": rotor["motor.torque_per_current"] * corner / true["resistance"],
    }


def wound_pole() -> float:
    """Pole [rad/s] of the geared motor's speed, its winding apart: (k^2 / R + b) / J."""
    brake = WOUND["torque_constant"] ** 2 / WOUND["resistance"]
    return (brake + WOUND["viscous_coefficient"]) / WOUND["rotor_inertia"]


def poles(inertia: float, drag: float, spring: float) -> tuple[float, float]:
    """Magnitude of the poles of J s^2 + b s + c, and their distance from the axis [rad/s]."""
    return math.sqrt(spring / inertia), 0.5 * drag / inertia


def motor_poles(true: Values) -> tuple[float, float]:
    """Magnitude of the fastest and of the slowest pole [rad/s] of the linear rig."""
    c = motor_constants(true)
    drag, spring = c["shaft.decay"], c["shaft.natural_frequency"] ** 2
    pull = c["motor.torque_per_current"] / c["shaft.inertia"]
    # current, angle, speed
    system = np.array(
        [
            [-c["motor.corner"], 0.0, -c["motor.flux_per_angle"]],
            [0.0, 0.0, 1.0],
            [pull, -spring, -drag],
        ]
    )
    sizes = np.abs(np.linalg.eigvals(system))
    return float(sizes.max()), float(sizes.min())


FAST, SLOW = motor_poles(MOTOR)
BUS_PULL = BUS["torque_constant"] / BUS["resistance"]
BUS_FAST, BUS_SLOW = poles(  # without its clock
    BUS["inertia"],
    BUS_PULL * BUS["torque_constant"],
    BUS_PULL * BUS_VOLTS * BUS_GAIN * BUS["loop_factor"],
)
LOOP_PULL = LOOP["torque_constant"] * LOOP["speed_gain"]
LOOP_FAST, LOOP_SLOW = poles(
    LOOP["rotor_inertia"],
    LOOP_PULL + LOOP["viscous_coefficient"],
    LOOP_PULL / LOOP["integral_time"],
)
DEGREE = math.pi / 180.0
WOUND_VOLTS, FREE_AMPERES = 24.0, 1.0
FREE_READINGS = ((Signal("encoder_angle", "rad", 1.0), 2), (Signal("current", "A", 1.0), 1))
"""Of a motor that nothing holds: the encoder is judged, the current may be logged as well."""
SWING = 60.0 * DEGREE * GEARBOX * WOUND["torque_constant"] / WOUND_VOLTS
"""In which the full voltage turns the output by 60 degrees [s]."""
SPIN = math.sqrt(
    2.0 * ENCODER_SCALE * ROTOR["rotor_inertia"] / (ROTOR["torque_constant"] * FREE_AMPERES)
)
"""In which one ampere turns the bare rotor once, from rest [s]."""
RIGS = (
    Rig(
        actuator="sg90",
        variant="measured",
        about="SG90 on the bench, its horn tracked from outside",
        nominal=SERVO,
        spread={
            "motor_time_constant": 0.2,
            "motor_gain": 0.1,
            "amplifier_gain": 0.2,
            "transport_delay.time": 0.35,
            "potentiometer_gain": 0.05,
        },
        constants=servo_constants,
        units=servo_units,
        command=Signal("pulse_width", "us", 1e-6, 2),
        rest=REST,
        amplitude=(45.0 * DEGREE * PULSE_PER_ANGLE, 75.0 * DEGREE * PULSE_PER_ANGLE),
        load=(0.01, 0.04),
        strength=lambda true: STALL_TORQUE * SUPPLY / STALL_VOLTAGE,
        readings=(
            (Signal("angle_reading", "deg", DEGREE), 0),
            (Signal("motor_voltage", "V", 1.0), 1),
            (Signal("feedback_voltage", "V", 1.0), 2),
        ),
        fastest=SERVO["motor_time_constant"],
        slowest=2.0 * SERVO["motor_time_constant"],
        step=1e-4,
        sampling=(10, 12, 16),
        settle=0.4,
        chirp=(5.0, 9.0),
        further=((Signal("rate_reading", "rad/s", 1.0), 3),),
    ),
    Rig(
        actuator="torque_motor",
        variant="measured",
        about="torque motor of a servo valve on the bench",
        nominal=MOTOR,
        spread={
            "torque_constant": 0.25,
            "inductance": 0.25,
            "back_emf_constant": 0.5,
            "friction_coefficient": 0.5,
            "resistance": 0.01,
            "rotor_inertia": 0.01,
            "stiffness": 0.01,
        },
        constants=motor_constants,
        units=motor_units,
        command=Signal("voltage", "V", 1.0, 4),
        rest=0.0,
        amplitude=(16.0, 26.0),
        load=(0.002, 0.008),
        strength=lambda true: true["stiffness"] * STOP,
        readings=((Signal("angle", "deg", DEGREE), 0), (Signal("current", "mA", 1e-3), 1)),
        fastest=1.0 / FAST,
        slowest=1.0 / SLOW,
        step=1e-5,
        sampling=(3, 4),
        settle=0.05,
        chirp=(150.0, 300.0),
    ),
    Rig(
        actuator="smart_servo",
        variant="sts3215",
        about="bus servo on the bench, its horn tracked from outside",
        nominal=BUS,
        spread={
            "torque_constant": 0.3,
            "resistance": 0.4,
            "inertia": 0.3,
            "loop_factor": 0.2,
        },
        constants=bus_constants,
        units=bus_units,
        command=Signal("goal", "deg", DEGREE, 3),
        rest=0.0,
        amplitude=(45.0 * DEGREE, 75.0 * DEGREE),
        load=(0.2, 0.7),
        strength=lambda true: true["torque_constant"] * BUS_VOLTS / true["resistance"],
        readings=((Signal("angle", "deg", DEGREE), 0), (Signal("duty", "1", 1.0), 1)),
        fastest=1.0 / BUS_FAST,
        slowest=1.0 / BUS_SLOW,
        step=BUS_STEP,
        sampling=(24, 30, 34),
        settle=1.0,
        chirp=(2.0, 4.0),
        further=(
            (Signal("angle_reading", "deg", DEGREE), 2),
            (Signal("current", "mA", 1e-3), 4),
        ),
    ),
    Rig(
        actuator="second_order_servo",
        variant="pulse",
        about="hobby servo of an unknown make on the bench, its horn tracked from outside",
        nominal=PULSE,
        spread={
            "natural_frequency": 0.5,
            "damping_ratio": 0.3,
            "transport_delay.time": 0.5,
            "acceleration_limit": 0.5,
            "inertia": 0.5,
            "pulse_gain": 0.2,
            "speed_limit": 0.4,
        },
        constants=pulse_constants,
        units=pulse_units,
        command=Signal("pulse_width", "us", 1e-6, 2),
        rest=PULSE_REST,
        amplitude=(45.0 * DEGREE / PULSE_GAIN, 75.0 * DEGREE / PULSE_GAIN),
        load=(0.02, 0.08),
        strength=pulse_strength,
        readings=(
            (Signal("angle_reading", "deg", DEGREE), 0),
            (Signal("rate_reading", "rad/s", 1.0), 3),
        ),
        fastest=1.0 / PULSE["natural_frequency"],
        slowest=75.0 * DEGREE / PULSE_SPEED,
        step=1e-4,
        sampling=(10, 12, 16),
        settle=1.0,
        chirp=(3.0, 6.0),
        further=((Signal("feedback", "deg", DEGREE), 2),),
    ),
    Rig(
        actuator="dc_motor_speed",
        variant="direct",
        about="motor in a speed loop on the bench, read by its own encoder",
        nominal=LOOP,
        spread={**ROTOR_SPREAD, "speed_gain": 0.1, "integral_time": 0.1, "current_limit": 0.1},
        constants=loop_constants,
        units=loop_units,
        command=Signal("speed_command", "rad/s", 1.0, 3),
        rest=0.0,
        amplitude=(200.0, 400.0),
        load=(0.01, 0.05),
        strength=lambda true: true["torque_constant"] * true["current_limit"],
        readings=(
            (Signal("encoder_speed", "rad/s", 1.0), 2),
            (Signal("current", "A", 1.0), 1),
        ),
        fastest=1.0 / LOOP_FAST,
        slowest=1.0 / LOOP_SLOW,
        step=LOOP_STEP,
        sampling=(8, 10, 12),
        settle=0.6,
        chirp=(5.0, 15.0),
    ),
    Rig(
        actuator="dc_motor",
        variant="geared",
        about="geared motor on a voltage on the bench, read by the encoder on its motor",
        nominal=WOUND,
        spread={**ROTOR_SPREAD, "resistance": 0.2, "winding_lag.time_constant": 0.5},
        constants=wound_constants,
        units=lambda true: rotor_units(GEARBOX),
        command=Signal("voltage", "V", 1.0, 4),
        rest=0.0,
        amplitude=(0.5 * WOUND_VOLTS, WOUND_VOLTS),
        load=(0.5, 3.0),
        strength=lambda true: GEARBOX * true["torque_constant"] * WOUND_VOLTS / true["resistance"],
        readings=FREE_READINGS,
        fastest=1.0 / wound_pole(),
        slowest=SWING,
        step=LOOP_STEP,
        sampling=(16, 18, 20),
        settle=0.02,
        chirp=(5.0, 15.0),
        integrators=1,
    ),
    Rig(
        actuator="dc_motor_current",
        variant="direct",
        about="bare motor on a current on the bench, read by its own encoder",
        nominal=ROTOR,
        spread=ROTOR_SPREAD,
        constants=rotor_constants,
        units=lambda true: rotor_units(),
        command=Signal("current_command", "A", 1.0, 5),
        rest=0.0,
        amplitude=(FREE_AMPERES, 3.0 * FREE_AMPERES),
        load=(2e-3, 0.01),
        strength=lambda true: true["torque_constant"] * FREE_AMPERES,
        readings=FREE_READINGS,
        fastest=SPIN,
        slowest=SPIN,
        step=LOOP_STEP,
        sampling=(16, 18, 20),
        settle=0.02,
        chirp=(5.0, 15.0),
        integrators=2,
    ),
)
