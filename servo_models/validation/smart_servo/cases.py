"""Cases of the smart servos."""

from __future__ import annotations

import math

from servo_models.validation.cases import Case, grid, schedule
from servo_models.validation.smart_servo.reference import SmartServo

CLOSED = "closed form from tick to tick, with located reversals"
XL330 = SmartServo(400.0 * 4096.0 / math.tau / (256.0 * 885.0), 5.0, 0.52, 103.0, 2.6e-3)
STS3215 = SmartServo(16.0 * 0.166, 7.4, 19.5 * 0.0980665, 52.0, 0.028)
STS3215_12V = SmartServo(16.0 * 0.166, 12.0, 30.0 * 0.0980665, 45.0, 0.028)
DRY = SmartServo(XL330.stiffness, 5.0, 0.52, 103.0, 2.6e-3, coulomb=0.05)


def cases() -> list[Case]:
    """Return a step of each servo, and dry friction with the motor switched off in between."""
    times, odd = grid(1.0, 1e-3), grid(1.4996, 2.3e-3)
    work = {
        "goal": schedule(odd, (0.0, 0.0), (0.1, 0.8), (0.7, -0.3)),
        "enabled": schedule(odd, (0.0, 1.0), (0.75, 0.0), (0.95, 1.0)),
        "supply": schedule(odd, (0.0, 5.0), (0.3, 4.1)),
        "load_torque": schedule(odd, (0.0, 0.0), (0.5, 0.12), (1.2, -0.1)),
    }
    step = {"goal": 0.3}
    return [
        *(
            Case(
                "smart_servo",
                variant,
                "step to 0.3 rad, every 1 ms",
                times,
                step,
                reference,
                CLOSED,
                linear=False,
                is_step=True,
            )
            for variant, reference in (
                ("xl330", XL330),
                ("sts3215", STS3215),
                ("sts3215_12v", STS3215_12V),
            )
        ),
        Case(
            "smart_servo",
            "xl330",
            "dry friction, load, switched off and on, every 2.3 ms",
            odd,
            work,
            DRY,
            CLOSED,
            linear=False,
            parameters={"coulomb_friction.level": DRY.coulomb},
            cost=("angle", "rate", "current"),
        ),
    ]
