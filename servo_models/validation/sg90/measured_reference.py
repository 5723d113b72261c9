"""A real SG90 as its steps show it: first-order motor, drive limit, delayed command.

theta' = w / 24, T w' = G u - w, u = A (U - K_f k_FS theta) limited to the supply, less the
volts of a load; in SI.  Source: the structure is that of eqs. 2 and 6 of S. Kochuk et al.,
with K_f k_FS such that 544 to 2400 us are 180 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from servo_models.core.types import Array
from servo_models.validation.solvers.inputs import changes
from servo_models.validation.solvers.switching import Exit, Key, Regime, Values, follow

T, G, A, DELAY = 0.0347, 51.1, 77.7, 0.0289
VOLTS_PER_SECOND, REST = 250.0, 1.5e-3
BACK = VOLTS_PER_SECOND * 1856e-6 / math.pi
"""K_f k_FS [V/rad]."""
K_F = 0.1
GEAR = 24.0
VOLTS_PER_LOAD = 4.8 / 0.1765


@dataclass(frozen=True)
class RealServo:
    """States angle [rad] from that of 1.5 ms, and motor speed [rad/s]."""

    start: ClassVar[Sequence[float]] = (0.0, 0.0)
    scale: ClassVar[Sequence[float]] = (1.6, 250.0)
    longest_step: ClassVar[float] = 2e-3

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Response with located events; inputs pulse_width, load_torque, supply_voltage."""
        pulses = changes(times, inputs["pulse_width"], DELAY, REST)
        others = [changes(times, inputs[name]) for name in ("load_torque", "supply_voltage")]
        columns = follow(self, times, [pulses, *others])
        names = ("angle", "rate", "feedback_voltage", "motor_voltage", "motor_speed", "saturated")
        return {name: columns[:, k] for k, name in enumerate(names)}

    def wanted(self, x: Array, u: Values) -> float:
        """Voltage [V] that the amplifier would give without a limit."""
        return A * (VOLTS_PER_SECOND * (u[0] - REST) - BACK * float(x[0]))

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """At either limit, or between."""
        wanted, limit = self.wanted(x, u), abs(u[2])
        return ("low" if wanted < -limit else "high" if wanted > limit else "free"), x

    def regime(self, key: Key, u: Values) -> Regime:
        """One side of a limit or between them."""
        limit = abs(u[2])

        def rates(x: Array) -> tuple[float, float]:
            volts = {"low": -limit, "high": limit}.get(str(key), self.wanted(x, u))
            return x[1] / GEAR, (G * (volts - VOLTS_PER_LOAD * u[1]) - x[1]) / T

        above = Exit(lambda x: self.wanted(x, u) + limit, 1.0, lambda x: ("low", x))
        below = Exit(lambda x: limit - self.wanted(x, u), 1.0, lambda x: ("high", x))
        if key == "free":
            return Regime(rates, (above, below))
        inward = -1.0 if key == "low" else 1.0
        back = Exit(lambda x: inward * self.wanted(x, u) - limit, 1.0, lambda x: ("free", x))
        return Regime(rates, (back,))

    def outputs(self, key: Key, x: Array, u: Values) -> tuple[float, ...]:
        """See ``__call__``; SI."""
        limit = abs(u[2])
        volts = min(max(self.wanted(x, u), -limit), limit)
        angle, speed = float(x[0]), float(x[1])
        feedback = (VOLTS_PER_SECOND * REST + BACK * angle) / K_F
        full = 1.0 if abs(volts) >= limit else 0.0
        return angle, speed / GEAR, feedback, volts, speed, full
