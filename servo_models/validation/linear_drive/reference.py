"""EMPS linear drive written from its benchmark: carriage and controller, tick by tick.

Between two instants at which the drive or the load changes, the force is constant, so the
motion is known in closed form.
Source: Janot, Gautier, Brunot, "Data set and reference models of EMPS", 2019.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.solvers import SAME_TIME, Edges, Sliding, changes, value_at

TICK = 1e-3  # sample time of the controller [s]
LATE = 1e-7  # time [s] from a whole millisecond to the tick of the controller
K_P = 160.18  # position gain [1/s]
K_V = 243.45  # speed gain [V s/m]
G_TAU = 35.15  # force per drive [N/V]
FULL_DRIVE = 10.0  # largest drive [V]


@dataclass(frozen=True)
class LinearDrive:
    """M x'' + F_v x' + F_c sign(x') + offset = g_tau u - load, in kg, N s/m and N.

    u is the controller's voltage, ``delay`` [s] after its tick, and the disturbance.
    """

    mass: float = 95.1
    viscous: float = 203.5
    coulomb: float = 20.4
    offset: float = -3.16
    delay: float = 0.0

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; inputs reference, disturbance, load_force."""
        goal, pulse, load = (
            changes(times, inputs[name]) for name in ("reference", "disturbance", "load_force")
        )
        carriage = Sliding(self.mass, self.viscous, self.coulomb)
        x = v = now = last = last_but_one = 0.0
        drives: list[float] = []
        acting, pushed = 0.0, value_at(pulse, 0.0)
        out = []
        for time, what, index in self._instants(times, load, pulse):
            if time > now + SAME_TIME:
                pushed = value_at(pulse, now)
            net = G_TAU * (acting + pushed) - self.offset - value_at(load, now)
            x, v = carriage.after(x, v, net, time - now)
            now = time
            if what == "row":
                out.append((x, v, acting + pushed))
            elif what == "tick":
                speed = ((x + last) / 2.0 - (last + last_but_one) / 2.0) / TICK
                wanted = K_V * (K_P * (value_at(goal, now) - x) - speed)
                drives.append(max(-FULL_DRIVE, min(FULL_DRIVE, wanted)))
                last, last_but_one = x, last
            elif what == "acts":
                acting = drives[index]
        columns = np.array(out).T
        return dict(zip(("position", "speed", "drive"), columns))

    def _instants(self, times: Array, *held: Edges) -> list[tuple[float, str, int]]:
        """All events in order: (time, kind, number); the first tick is at time 0."""
        end = float(times[-1])
        ticks = [0.0, *(k * TICK + LATE for k in range(1, math.ceil(end / TICK) + 1))]
        happens = [
            *((tick, "tick", k) for k, tick in enumerate(ticks)),
            *((tick + self.delay, "acts", k) for k, tick in enumerate(ticks)),
            *((float(time), "row", k) for k, time in enumerate(times)),
            *((time, "edge", k) for edges in held for k, (time, _) in enumerate(edges)),
        ]
        order = ("edge", "tick", "acts", "row")
        instants = sorted(happens, key=lambda one: (one[0], order.index(one[1])))
        return [one for one in instants if one[0] <= end]
