"""Cases of the motor on a voltage."""

from __future__ import annotations

from typing import Any

from servo_models.core.types import Array
from servo_models.validation.cases import EXACT, Case, grid, schedule
from servo_models.validation.dc_motor.reference import Motor, OnVoltage

DIRECT = Motor(30.0, 100.0, 2e-3)
GEARED = Motor(30.0, 100.0, 2e-3, ratio=50.0)
PROMPT = {"winding_lag.time_constant": 0.0}


def cases() -> list[Case]:
    """Return steps of each set with and without inductance, and a load."""
    times, odd = grid(0.3, 1e-3), grid(0.5999, 0.7e-3)
    swings = {
        "voltage": schedule(odd, (0, 0.0), (0.05, 12.0), (0.3, -6.0), (0.5, 0.0)),
        "load_torque": schedule(odd, (0, 0.0), (0.2, 0.02), (0.4, 0.0)),
    }
    heavy = {**swings, "load_torque": 50.0 * swings["load_torque"]}
    step, prompt, coil = {"voltage": 12.0}, (2.0,), (2.0, 1.0)
    listed: tuple[tuple[str, str, Array, dict[str, Any], OnVoltage, dict[str, float]], ...] = (
        ("direct", "step of 12 V, no inductance", times, step, OnVoltage(DIRECT, *prompt), PROMPT),
        ("direct", "step of 12 V, 1 mH", times, step, OnVoltage(DIRECT, *coil), {}),
        ("direct", "+12 V, -6 V and load", odd, swings, OnVoltage(DIRECT, *coil), {}),
        ("geared", "step of 12 V, no inductance", times, step, OnVoltage(GEARED, *prompt), PROMPT),
        ("geared", "+12 V, -6 V and load", odd, heavy, OnVoltage(GEARED, *prompt), PROMPT),
    )
    return [
        Case(
            "dc_motor",
            variant,
            name,
            rows,
            inputs,
            reference,
            EXACT,
            linear=parameters is PROMPT,  # a lag takes its signal for straight between two steps
            parameters=parameters,
            cost=("angle", "rate", "current") if (variant, rows is odd) == ("direct", True) else (),
        )
        for variant, name, rows, inputs, reference, parameters in listed
    ]
