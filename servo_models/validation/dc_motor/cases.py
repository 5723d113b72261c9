"""Cases of the motor on a voltage, on a current and in a speed loop."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from servo_models.core.types import Array
from servo_models.validation.cases import EVENTS, EXACT, Case, grid, schedule
from servo_models.validation.dc_motor.reference import InSpeedLoop, Motor, OnCurrent, OnVoltage

DIRECT = Motor(30.0, 100.0, 2e-3)
GEARED = Motor(30.0, 100.0, 2e-3, ratio=50.0)
PROMPT = {"winding_lag.time_constant": 0.0}
ODRIVE = InSpeedLoop(Motor(30.0, 2500.0, 0.1), 5e-4 * 8192.0 / math.tau, 0.05, 10.0)
HOLDING = replace(ODRIVE, time=0.5, position_gain=20.0)
MOTEUS = replace(ODRIVE, gain=0.05 / (math.tau * 0.03), time=math.inf, position_gain=80.0)


def cases() -> list[Case]:
    """Return those of all three drives."""
    return [*_on_voltage(), *_on_current(), *_in_speed_loop()]


def _on_voltage() -> list[Case]:
    """Steps of each set with and without inductance, and a load."""
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


def _on_current() -> list[Case]:
    """A current to and fro under a load, of each set."""
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


def _in_speed_loop() -> list[Case]:
    """Speeds within the limit of the current and beyond it, under a load."""
    odd = grid(0.7994, 0.7e-3)
    small = schedule(odd, (0, 0.0), (0.05, 60.0), (0.5, -20.0))
    large = schedule(odd, (0, 0.0), (0.05, 400.0), (0.5, -200.0))
    load = schedule(odd, (0, 0.0), (0.3, 0.02), (0.6, 0.0))

    turned = schedule(odd, (0, 0.0), (0.05, 0.7), (0.4, -0.1))

    def case(variant: str, name: str, command: Array, loop: InSpeedLoop, of: str = "speed") -> Case:
        return Case(
            "dc_motor_speed",
            variant,
            name,
            odd,
            {f"{of}_command": command, "load_torque": loop.motor.ratio * load},
            loop,
            EVENTS,
            linear=False,
            parameters={"sensor_quantisation.step": 0.0} if of == "position" else {},
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
        case("odrive_position", "0.7 rad and load, every 0.7 ms", turned, HOLDING, "position"),
        case("moteus", "0.7 rad and load, every 0.7 ms", turned, MOTEUS, "position"),
    ]
