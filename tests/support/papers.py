"""Equations of both papers."""

from __future__ import annotations

from collections.abc import Mapping

import control
import numpy as np
from numpy.typing import NDArray

from servo_models.actuators.torque_motor.variants import TABLE_1

MEASURED = ("torque_motor", "measured")
SG90 = ("sg90", "linear")


def equations_1_to_9(k: Mapping[str, float] = TABLE_1) -> control.StateSpace:
    """v = R i + L i' + K_b theta', K_t i = J theta'' + K_f theta' + K_s theta + load."""
    inertia = k["rotor_inertia"]
    a = [
        [-k["resistance"] / k["inductance"], 0.0, -k["back_emf_constant"] / k["inductance"]],
        [0.0, 0.0, 1.0],
        [
            k["torque_constant"] / inertia,
            -k["stiffness"] / inertia,
            -k["friction_coefficient"] / inertia,
        ],
    ]
    b = [[1.0 / k["inductance"], 0.0], [0.0, 0.0], [0.0, -1.0 / inertia]]
    return control.ss(a, b, [[0.0, 1.0, 0.0]], [[0.0, 0.0]])


def equation_12(frequencies: object) -> NDArray[np.complex128]:
    """Equation 12 of the valve paper with its delay, in rad/V."""
    s = 2j * np.pi * np.asarray(frequencies, dtype=float)
    polynomial = s**3 + 492.0 * s**2 + 1582240.0 * s + 184512000.0
    return np.asarray(241560.0 * np.exp(-0.0011 * s) / polynomial)
