"""Torque motor with a load inertia behind a damped spring: five states, exact.

Source: eqs. 3 to 6 of the valve paper; two-mass model, Ellis, Control System Design Guide,
2012, ch. 16.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.solvers.inputs import changes
from servo_models.validation.solvers.linear import LinearSystem
from servo_models.validation.torque_motor.reference import OUTPUTS, Constants


@dataclass(frozen=True)
class TwoMasses:
    """The output is the load's side of the spring; the load torque acts there.

    ``compliance`` [rad/(N m)], ``inertia`` of the load [kg m^2], ``damping`` ratio of the
    load on its spring with the rotor held.
    """

    constants: Constants
    compliance: float
    inertia: float
    damping: float

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; inputs voltage, load_torque."""
        voltage = changes(times, inputs["voltage"], self.constants.delay)
        signals = [voltage, changes(times, inputs["load_torque"])]
        columns = self.system().response(times, signals)
        named = {name: columns[:, k] for k, name in enumerate(OUTPUTS[:4])}
        return {**named, "at_stop": np.zeros(len(times))}

    def system(self) -> LinearSystem:
        """States current, rotor angle and speed, load angle and speed."""
        k, stiffness = self.constants, 1.0 / self.compliance
        drag = 2.0 * self.damping * math.sqrt(self.inertia * stiffness)
        twist = np.array([0.0, stiffness, drag, -stiffness, -drag])
        own = np.array([k.k_t, -k.k_s, -k.k_f, 0.0, 0.0])
        a = [
            np.array([-k.r / k.l, 0.0, -k.k_b / k.l, 0.0, 0.0]),
            np.eye(5)[2],
            (own - twist) / k.j,
            np.eye(5)[4],
            twist / self.inertia,
        ]
        b = np.zeros((5, 2))
        b[0, 0], b[4, 1] = 1.0 / k.l, -1.0 / self.inertia
        c = np.array([np.eye(5)[3], np.eye(5)[4], np.eye(5)[0], k.k_t * np.eye(5)[0]])
        return LinearSystem(np.array(a), b, c, np.zeros((4, 2)))
