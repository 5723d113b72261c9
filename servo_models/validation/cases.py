"""The runs that are compared with references: what goes in, and what must come out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from servo_models.reference import sg90, torque_motor
from servo_models.reference.backlash import MotorBacklash, ServoBacklash
from servo_models.reference.compliance import TwoMasses

Array = NDArray[np.float64]
Reference = Callable[[Array, Mapping[str, Array]], dict[str, Array]]

LINEAR_ANGLE, LINEAR, NONLINEAR = 1e-6, 1e-5, 1e-4
"""Largest error over full scale: angle of a linear set, its other outputs, nonlinear sets."""

EXACT = "matrix exponential"
TRANSFER = "python-control transfer function, matrix exponential"
EVENTS = "solve_ivp DOP853 at 1e-11 with located events"


@dataclass(frozen=True)
class Case:
    """One run and its reference.

    Attributes:
        actuator, variant, parameters: the model; parameters override the variant, SI.
        name: for people.
        times: communication points [s], shape (n,).
        inputs: SI columns or numbers by name; those not named stay at rest.
        reference: see ``servo_models.reference``.
        method: what the reference is solved by.
        linear: which bars apply.
        is_step: the angle answers one step at the first time, so its measures are judged.
    """

    actuator: str
    variant: str
    name: str
    times: Array = field(repr=False)
    inputs: Mapping[str, Array | float] = field(repr=False)
    reference: Reference = field(repr=False)
    method: str
    linear: bool
    is_step: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)

    def bar(self, output: str) -> float:
        """Return the largest error over full scale that passes."""
        if not self.linear:
            return NONLINEAR
        return LINEAR_ANGLE if output == "angle" else LINEAR


def all_cases() -> list[Case]:
    """Return every case, the SG90 first."""
    return [*_sg90_steps(), *_sg90_others(), *_motor_steps(), *_motor_others()]


def grid(stop: float, step: float) -> Array:
    """Return communication points from 0 to ``stop`` [s], a multiple of ``step`` [s]."""
    return step * np.arange(round(stop / step) + 1, dtype=float)


def schedule(times: Array, *values: tuple[float, float]) -> Array:
    """Return a held column from (time [s], value that begins there) in order of time."""
    begins = np.array([begin for begin, _ in values])
    index = np.searchsorted(begins, times + 1e-9, side="right") - 1
    return np.array([value for _, value in values])[index]


def _sg90_steps() -> list[Case]:
    times = grid(20.0, 0.02)
    cases = []
    for k_ap, amplifier in ((sg90.LOADED, ""), (sg90.UNLOADED, "_unloaded")):
        for k_f, feedback in ((0.1, ""), (0.18, "_kf018"), (0.05, "_kf005")):
            cases += [
                Case(
                    "sg90",
                    kind + amplifier + feedback,
                    "step to 2 ms, every 20 ms",
                    times,
                    {"pulse_width": 2e-3},
                    reference,
                    method,
                    linear=kind == "linear",
                    is_step=True,
                )
                for kind, reference, method in (
                    ("linear", sg90.Linear(k_f, k_ap), EXACT),
                    ("printed", sg90.Printed(k_f, k_ap), EVENTS),
                )
            ]
    return cases


def _sg90_others() -> list[Case]:
    times = grid(20.0, 0.02)
    odd = grid(19.9947, 0.0073)
    step = {"pulse_width": 2e-3}
    pulses = schedule(odd, (0, 1.5e-3), (1, 2.4e-3), (5, 0.7e-3), (9, 2.3e-3), (14, 1.2e-3))
    work = {"pulse_width": pulses, "load_torque": schedule(odd, (0, 0.0), (6, 0.05), (11, 0.0))}
    weak = {**work, "supply_voltage": schedule(odd, (0, 5.0), (10, 1.2), (15, 5.0))}
    swings = "pulses and load, every 7.3 ms"
    strict = {"angle_unit": 1.0}
    play = {"backlash.half_width": math.radians(2.0)}
    return [
        Case("sg90", "linear", "eq. 7", times, step, sg90.equation_7_response, TRANSFER, True),
        Case("sg90", "linear", swings, odd, work, sg90.Linear(), EXACT, True),
        Case(
            "sg90",
            "linear",
            "angle unit read strictly",
            times[:501],
            step,
            sg90.Linear(degrees=180.0 / math.pi),
            EXACT,
            True,
            parameters=strict,
        ),
        Case(
            "sg90",
            "oscillatory_motor",
            "step to 2 ms, every 20 ms",
            times[:501],
            step,
            sg90.Linear(rejected=True),
            EXACT,
            True,
        ),
        Case(
            "sg90",
            "printed",
            "pulses, load and weak supply, every 7.3 ms",
            odd,
            weak,
            sg90.Printed(),
            EVENTS,
            False,
        ),
        Case(
            "sg90",
            "printed_kf005",
            "into both stops, every 7.3 ms",
            odd,
            {"pulse_width": pulses},
            sg90.Printed(0.05),
            EVENTS,
            False,
        ),
        Case(
            "sg90",
            "linear",
            "backlash of +/- 2 deg in the loop, every 7.3 ms",
            odd,
            work,
            ServoBacklash(2.0),
            EVENTS,
            False,
            parameters=play,
        ),
    ]


MOTOR_SETS = (
    ("identified", torque_motor.IDENTIFIED),
    ("measured", torque_motor.TABLE_1),
    ("estimated", torque_motor.TABLE_2),
)
NO_STOPS = {"end_stops.half_range": 0.0}


def _motor_steps() -> list[Case]:
    times = grid(0.2, 1e-3)
    cases = []
    for variant, constants in MOTOR_SETS:
        cases += [
            Case(
                "torque_motor",
                variant,
                "40 V step, stops off, every 1 ms",
                times,
                {"voltage": 40.0},
                torque_motor.Linear(constants),
                EXACT,
                linear=True,
                is_step=True,
                parameters=NO_STOPS,
            ),
            Case(
                "torque_motor",
                variant,
                "50 V step into the stop, every 1 ms",
                times,
                {"voltage": 50.0},
                torque_motor.Contact(constants, torque_motor.STOP),
                EVENTS,
                linear=False,
                is_step=True,
            ),
        ]
    return cases


def _motor_others() -> list[Case]:
    times, odd, fine = grid(0.2, 1e-3), grid(0.3997, 0.7e-3), grid(0.3, 1e-4)
    swings: dict[str, Array | float] = {
        "voltage": schedule(odd, (0, 0.0), (0.01, 50.0), (0.1, -50.0), (0.2, 0.0), (0.3, 20.0)),
        "load_torque": schedule(odd, (0, 0.0), (0.05, 0.02), (0.25, 0.0)),
    }
    sine: dict[str, Array | float] = {"voltage": 40.0 * np.sin(20.0 * math.pi * fine)}
    k = torque_motor.IDENTIFIED
    rough, free = "+/- 50 V and load, every 0.7 ms", "+/- 50 V and load, stops off, every 0.7 ms"
    dry, sticky, play = 0.006, 0.004, math.radians(0.1)
    spring = TwoMasses(k, compliance=0.3, inertia=2e-7, damping=0.05)

    def case(
        name: str,
        reference: Reference,
        method: str,
        linear: bool,
        times: Array = odd,
        inputs: Mapping[str, Array | float] = swings,
        **parameters: float,
    ) -> Case:
        dotted = {key.replace("__", "."): value for key, value in parameters.items()}
        parameters = dotted if name == rough else {**NO_STOPS, **dotted}
        return Case(
            "torque_motor",
            "identified",
            name,
            times,
            inputs,
            reference,
            method,
            linear,
            parameters=parameters,
        )

    step = {"voltage": 40.0}
    return [
        case("eq. 12, 40 V step", torque_motor.Equation12(), TRANSFER, True, times, step),
        case("10 Hz, 40 V sine, stops off", torque_motor.Linear(k), EXACT, True, fine, sine),
        case(free, torque_motor.Linear(k), EXACT, True),
        case(rough, torque_motor.Contact(k, torque_motor.STOP), EVENTS, False),
        case(
            "Coulomb friction of 6 mN m",
            torque_motor.Contact(k, friction=dry),
            EVENTS,
            False,
            coulomb_friction__level=dry,
        ),
        case(
            "Stribeck friction of 4 to 8 mN m",
            torque_motor.Contact(k, friction=sticky, excess=sticky, stribeck=5.0),
            EVENTS,
            False,
            coulomb_friction__level=sticky,
            stribeck_friction__excess=sticky,
            stribeck_friction__speed=0.05,
        ),
        case(
            "backlash of +/- 0.1 deg",
            MotorBacklash(k, play),
            EVENTS,
            False,
            backlash__half_width=play,
        ),
        case(
            "gear compliance of 0.3 rad/(N m)",
            spring,
            EXACT,
            True,
            gear_compliance__compliance=spring.compliance,
            gear_compliance__inertia=spring.inertia,
            gear_compliance__damping=spring.damping,
        ),
    ]
