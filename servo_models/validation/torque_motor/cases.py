"""Cases of the torque motor."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.cases import EVENTS, EXACT, TRANSFER, Case, Reference, grid, schedule
from servo_models.validation.torque_motor import reference as torque_motor

MOTOR_SETS = (
    ("identified", torque_motor.IDENTIFIED),
    ("measured", torque_motor.TABLE_1),
    ("estimated", torque_motor.TABLE_2),
)
NO_STOPS = {"end_stops.half_range": 0.0}


def cases() -> list[Case]:
    """Return the steps of every set, then the others."""
    return [*_steps(), *_others()]


def _steps() -> list[Case]:
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
                cost=("angle", "rate", "current") if variant == "identified" else (),
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


def _others() -> list[Case]:
    times, odd, fine = grid(0.2, 1e-3), grid(0.3997, 0.7e-3), grid(0.3, 1e-4)
    swings: dict[str, Array | float] = {
        "voltage": schedule(odd, (0, 0.0), (0.01, 50.0), (0.1, -50.0), (0.2, 0.0), (0.3, 20.0)),
        "load_torque": schedule(odd, (0, 0.0), (0.05, 0.02), (0.25, 0.0)),
    }
    sine: dict[str, Array | float] = {"voltage": 40.0 * np.sin(20.0 * math.pi * fine)}
    k = torque_motor.IDENTIFIED
    rough, free = "+/- 50 V and load, every 0.7 ms", "+/- 50 V and load, stops off, every 0.7 ms"
    dry, sticky, play = 0.006, 0.004, math.radians(0.1)
    spring = torque_motor.TwoMasses(k, compliance=0.3, inertia=2e-7, damping=0.05)

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
            torque_motor.MotorBacklash(k, play),
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
