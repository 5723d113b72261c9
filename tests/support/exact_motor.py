"""The linear torque motor by the matrix exponential, from the valve paper's equations.

It shares nothing with the product's integrator.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.signal import cont2discrete

from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Log
from tests.support.logs import log_of

STEP = 5e-4
TRUE = {
    "torque_constant": 5.4,
    "back_emf_constant": 0.08,
    "resistance": 3630.0,
    "inductance": 31.0,
    "rotor_inertia": 7.246e-7,
    "friction_coefficient": 2.7e-4,
    "stiffness": 1.1,
}


def rig(
    values: dict[str, float],
    voltage: Array,
    step: float = STEP,
    begin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Array:
    """Angle [rad] at each sample of a held voltage: eqs. 3 to 9, exactly discretised.

    It begins with a current [A], an angle [rad] and a rate [rad/s].
    """
    v = values
    a = np.array(
        [
            [-v["resistance"] / v["inductance"], 0.0, -v["back_emf_constant"] / v["inductance"]],
            [0.0, 0.0, 1.0],
            [
                v["torque_constant"] / v["rotor_inertia"],
                -v["stiffness"] / v["rotor_inertia"],
                -v["friction_coefficient"] / v["rotor_inertia"],
            ],
        ]
    )
    b = np.array([[1.0 / v["inductance"]], [0.0], [0.0]])
    ad, bd, *_ = cont2discrete((a, b, np.eye(3), np.zeros((3, 1))), step)
    x, out = np.array(begin), np.empty(len(voltage))
    for i, u in enumerate(voltage):
        out[i] = x[1]
        x = ad @ x + bd[:, 0] * u
    return out


def prbs(count: int, seed: int, hold: int = 20, size: float = 20.0) -> Array:
    signs = np.random.default_rng(seed).choice([-size, size], count // hold + 1)
    return np.repeat(signs, hold)[:count]


def bench_log(voltage: Array, angle: Array, name: str = "rig", **more: object) -> Log:
    times = STEP * np.arange(len(voltage))
    path = Path(f"{name}.csv")
    return log_of(times, {"voltage": voltage}, {"angle": angle}, name=name, path=path, **more)


def nominal(**changes: float | str) -> Model:
    """Table 1 without stops: the simulation that the rig disagrees with."""
    return model("torque_motor", "measured", {"end_stops.half_range": 0.0, **changes})


def noisy(seed: int, sigma: float = 2e-4, count: int = 1500) -> Log:
    voltage = prbs(count, seed)
    noise = sigma * np.random.default_rng(seed + 1000).standard_normal(count)
    return bench_log(voltage, rig(TRUE, voltage) + noise)
