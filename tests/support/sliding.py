"""A second opinion on dry friction: ``solve_ivp`` from reversal to reversal."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

Law = Callable[[float, float], float]


def slide(
    net: Law, friction: Law, inertia: float, position: float, speed: float, duration: float
) -> tuple[float, float]:
    """Position and speed after ``duration`` [s] of inertia x'' = net - sign(x') friction.

    ``net`` and ``friction`` are functions of position and speed without jumps.
    """
    left = duration
    while left > 0.0:
        if speed != 0.0:
            sign = math.copysign(1.0, speed)
        elif abs(net(position, 0.0)) <= friction(position, 0.0):
            return position, 0.0
        else:
            sign = math.copysign(1.0, net(position, 0.0))

        def slope(_: float, y: np.ndarray, sign: float = sign) -> list[float]:
            return [y[1], (net(y[0], y[1]) - sign * friction(y[0], y[1])) / inertia]

        def reversal(_: float, y: np.ndarray) -> float:
            return float(y[1])

        reversal.terminal = True  # type: ignore[attr-defined]
        reversal.direction = -sign  # type: ignore[attr-defined]
        done = solve_ivp(
            slope,
            (0.0, left),
            [position, speed],
            method="DOP853",
            rtol=1e-10,
            atol=1e-13,
            events=reversal,
        )
        position, speed = float(done.y[0, -1]), float(done.y[1, -1])
        left -= float(done.t[-1])
        if done.status == 1:
            speed = 0.0
        else:
            break
    return position, speed
