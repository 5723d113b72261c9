"""Cases of the motor on a current."""

from __future__ import annotations

from servo_models.validation.cases import EXACT, Case, grid, schedule
from servo_models.validation.dc_motor.cases import DIRECT, GEARED
from servo_models.validation.dc_motor.reference import OnCurrent


def cases() -> list[Case]:
    """Return a current to and fro under a load, of each set."""
    odd = grid(0.5999, 0.7e-3)
    current = schedule(odd, (0, 0.0), (0.05, 1.0), (0.3, -1.5), (0.5, 0.0))
    load = schedule(odd, (0, 0.0), (0.2, 0.02), (0.4, 0.0))
    return [
        Case(
            "dc_motor_current",
            variant,
            "+1 A, -1.5 A and load, every 0.7 ms",
            odd,
            {"current_command": current, "load_torque": motor.ratio * load},
            OnCurrent(motor),
            EXACT,
            linear=True,
            cost=("angle", "rate") if variant == "direct" else (),
        )
        for variant, motor in (("direct", DIRECT), ("geared", GEARED))
    ]
