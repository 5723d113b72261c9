"""Cases of the linear drive."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.cases import Case, grid, schedule
from servo_models.validation.linear_drive.reference import LinearDrive

CLOSED = "closed form from tick to tick, with located reversals"


def to_and_fro(times: Array) -> Array:
    """Commanded position [m]: 60 mm there and back in 2 s, at up to 94 mm/s."""
    return np.asarray(0.03 * (1.0 - np.cos(math.pi * times)))


def cases() -> list[Case]:
    """Return runs with and without dry friction, on the controller's clock and off it."""
    times, coarse, odd = grid(2.0, 1e-3), grid(2.0, 4e-3), grid(1.9999, 0.7e-3)
    pulses = schedule(times, (0.0, 0.0), (0.35, 5.0), (0.85, 0.0), (1.35, 5.0), (1.85, 0.0))
    pushed = schedule(odd, (0.0, 0.0), (0.5, 30.0), (1.2, -20.0), (1.6, 0.0))
    rig, simple = LinearDrive(), LinearDrive(100.0, 250.0, 0.0, 0.0)
    late = {"transport_delay.time": 1e-3}

    def case(
        variant: str,
        name: str,
        times: Array,
        inputs: Mapping[str, Array | float],
        reference: LinearDrive,
        parameters: Mapping[str, float] | None = None,
        linear: bool = False,
        is_step: bool = False,
        cost: tuple[str, ...] = (),
    ) -> Case:
        return Case(
            "linear_drive",
            variant,
            name,
            times,
            inputs,
            reference,
            CLOSED,
            linear,
            is_step,
            parameters or {},
            cost,
            "position",
        )

    moving = {"reference": to_and_fro(times)}
    pulsed = {**moving, "disturbance": pulses}
    loaded = {"reference": to_and_fro(odd), "load_force": pushed}
    step = {"reference": 1e-4}
    return [
        case(
            "identified",
            "to and fro with pulses, every 1 ms",
            times,
            pulsed,
            rig,
            cost=("position", "speed", "drive"),
        ),
        case("identified", "to and fro under load, every 0.7 ms", odd, loaded, rig),
        case("identified", "1 ms late, every 1 ms", times, moving, LinearDrive(delay=1e-3), late),
        case("identified", "step to 0.1 mm, every 1 ms", times[:201], step, rig, is_step=True),
        case(
            "simple",
            "to and fro, every 4 ms",
            coarse,
            {"reference": to_and_fro(coarse)},
            simple,
            linear=True,
        ),
    ]
