"""Cases of the general servo."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.cases import EVENTS, EXACT, Case, Reference, grid, schedule
from servo_models.validation.second_order_servo.reference import Limited, Linear, Servo

PULSE = Servo(90.0, 30.0, 0.8, 10.0, 6e-4, fastest=500.0, hardest=300.0 * 180.0 / math.pi)
BUS = Servo(90.0, 30.0, 0.8, 5.0, 9e-3, fastest=60.0 / 0.18, hardest=200.0 * 180.0 / math.pi)
CARRIED = 9e-4  # inertia of the carried load [kg m^2]


def cases() -> list[Case]:
    """Return small and large steps of each set, a load within the limits, and friction."""
    times, odd = grid(0.6, 1e-3), grid(1.1998, 0.7e-3)
    sweep = {
        "pulse_width": schedule(odd, (0, 1.5e-3), (0.1, 2.2e-3), (0.5, 1.2e-3), (0.8, 1.6e-3)),
        "load_torque": schedule(odd, (0, 0.0), (0.3, 0.06), (0.9, -0.04)),
    }
    gentle = {
        "pulse_width": 1.5e-3 + 3e-5 * np.sin(12.0 * odd),
        "load_torque": schedule(odd, (0, 0.0), (0.3, 0.01), (0.9, 0.0)),
    }
    carried = replace(PULSE, added=CARRIED)
    dry = replace(carried, friction=0.02)

    def case(
        name: str,
        times: Array,
        inputs: Mapping[str, Array | float],
        reference: Reference,
        variant: str = "pulse",
        is_step: bool = False,
        cost: tuple[str, ...] = (),
        **parameters: float,
    ) -> Case:
        linear = isinstance(reference, Linear)
        return Case(
            "second_order_servo",
            variant,
            name,
            times,
            inputs,
            reference,
            EXACT if linear else EVENTS,
            linear,
            is_step,
            {key.replace("__", "."): value for key, value in parameters.items()},
            cost,
        )

    return [
        case(
            "step of 9 deg, every 1 ms", times, {"pulse_width": 1.6e-3}, Linear(PULSE), is_step=True
        ),
        case(
            "step of 45 deg, every 1 ms", times, {"pulse_width": 2e-3}, Limited(PULSE), is_step=True
        ),
        case(
            "sine and load within the limits, carrying, every 0.7 ms",
            odd,
            gentle,
            Linear(carried),
            load_inertia__inertia=CARRIED,
        ),
        case(
            "63 deg to and fro and load, every 0.7 ms",
            odd,
            sweep,
            Limited(PULSE),
            cost=("angle", "rate", "drive"),
        ),
        case(
            "carrying, with dry friction, every 0.7 ms",
            odd,
            sweep,
            Limited(dry),
            load_inertia__inertia=CARRIED,
            coulomb_friction__level=dry.friction,
        ),
        case(
            "step of 60 deg, every 1 ms",
            times,
            {"goal": math.radians(60.0)},
            Limited(BUS),
            "bus",
            is_step=True,
        ),
    ]
