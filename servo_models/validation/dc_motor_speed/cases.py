"""Cases of the motor in a speed loop."""

from __future__ import annotations

import math

from servo_models.core.types import Array
from servo_models.validation.cases import EVENTS, Case, grid, schedule
from servo_models.validation.dc_motor.cases import DIRECT, GEARED
from servo_models.validation.dc_motor.reference import InSpeedLoop, Motor

ODRIVE = InSpeedLoop(Motor(30.0, 2500.0, 0.1), 5e-4 * 8192.0 / math.tau, 0.05, 10.0)


def cases() -> list[Case]:
    """Return speeds within the limit of the current and beyond it, under a load."""
    odd = grid(0.7994, 0.7e-3)
    small = schedule(odd, (0, 0.0), (0.05, 60.0), (0.5, -20.0))
    large = schedule(odd, (0, 0.0), (0.05, 400.0), (0.5, -200.0))
    load = schedule(odd, (0, 0.0), (0.3, 0.02), (0.6, 0.0))

    def case(variant: str, name: str, command: Array, loop: InSpeedLoop) -> Case:
        return Case(
            "dc_motor_speed",
            variant,
            name,
            odd,
            {"speed_command": command, "load_torque": loop.motor.ratio * load},
            loop,
            EVENTS,
            linear=False,
            cost=("angle", "rate", "current")
            if (variant, command is large) == ("direct", True)
            else (),
        )

    direct, geared = (InSpeedLoop(motor, 0.02, 0.05, 5.0) for motor in (DIRECT, GEARED))
    return [
        case("direct", "60 rad/s and load, every 0.7 ms", small, direct),
        case("direct", "400 rad/s into the limit, every 0.7 ms", large, direct),
        case("geared", "400 rad/s into the limit, every 0.7 ms", large, geared),
        case("odrive", "60 rad/s and load, every 0.7 ms", small, ODRIVE),
    ]
