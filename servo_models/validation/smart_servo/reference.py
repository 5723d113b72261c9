"""A smart servo written from its data sheets: firmware tick by tick, arm in closed form.

Between two ticks the duty is constant, so motor and arm are a mass under a constant torque
with the motor's back EMF as viscous friction.  Source: ROBOTIS e-manual XL330-M288;
Duclusaud et al., Extended friction models, 2025 (P loop on encoder counts).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.solvers import Sliding, changes, value_at

TICK = 1e-3  # sample time of the firmware [s]
COUNTS = 4096  # counts of the encoder in a turn
OUTPUTS = ("angle", "rate", "angle_reading", "duty", "current", "bridge_supply")


@dataclass(frozen=True)
class SmartServo:
    """P loop, bridge, DC motor of a data sheet, arm with Coulomb friction [N m].

    ``stiffness`` is duty per radian of error; voltage [V], stall torque [N m] and no-load
    speed [rev/min] are the data sheet's.
    """

    stiffness: float
    voltage: float
    stall_torque: float
    no_load: float
    inertia: float
    coulomb: float = 0.0

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; inputs goal, enabled, supply, load_torque."""
        edges = {name: changes(times, column) for name, column in inputs.items()}
        constant = self.voltage / (self.no_load * math.tau / 60.0)
        resistance = constant * self.voltage / self.stall_torque
        on = Sliding(self.inertia, constant**2 / resistance, self.coulomb)
        off = Sliding(self.inertia, 0.0, self.coulomb)
        x = v = now = duty = 0.0
        held: dict[str, float] = {}
        out = []
        for time, what in self._instants(times, [t for one in edges.values() for t, _ in one]):
            if held:
                running = held["enabled"] >= 0.5
                stall = constant / resistance * duty * held["supply"] if running else 0.0
                arm = on if running else off
                x, v = arm.after(x, v, stall - held["load_torque"], time - now)
            now = time
            reading = math.floor(x / math.tau * COUNTS + 0.5) * math.tau / COUNTS
            if what == "change":
                held = {name: value_at(one, now) for name, one in edges.items()}
            elif what == "tick":
                error = value_at(edges["goal"], now) - reading
                duty = max(-1.0, min(1.0, self.stiffness * error))
            else:
                driven = (duty * held["supply"] - constant * v) / resistance
                current = driven if held["enabled"] >= 0.5 else 0.0
                out.append((x, v, reading, duty, current, held["supply"]))
        return dict(zip(OUTPUTS, np.array(out).T))

    def _instants(self, times: Array, edges: list[float]) -> list[tuple[float, str]]:
        """All events in order; a row comes before events at its time, except the first row."""
        end = float(times[-1])
        happens = [
            *((time, "change") for time in edges),
            *((k * TICK, "tick") for k in range(math.floor(end / TICK + 1e-6) + 1)),
            *((float(time), "row") for time in times),
        ]
        order = ("row", "change", "tick")

        def place(instant: tuple[float, str]) -> tuple[float, int]:
            time = round(instant[0], 9)
            first = time <= round(float(times[0]), 9)
            return time, len(order) if first and instant[1] == "row" else order.index(instant[1])

        return sorted(happens, key=place)
