"""State space of a linear model, read off its own step.

A step of a linear model maps state and held input linearly; the matrix logarithm of that
map gives the continuous A and B.  The Runge-Kutta method leaves a relative error of about
(pole x internal step)^4 / 120.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from servo_models.flat import neutral_effects
from servo_models.reference.linear import LinearSystem
from servo_models.simulate import Model

Array = NDArray[np.float64]


def linearise(model: Model, output: str, size: float) -> LinearSystem:
    """Return A, B, C, D from the first input to ``output``, in SI.

    Args:
        model: without delay, clock or any nonlinear effect.
        output: name of the output.
        size: step [s] of the map, less than half a period of the fastest pole.
    """
    from scipy.linalg import logm

    start, step = model.stepper()
    neutral = neutral_effects(model.flat, list(model.values.values()))
    free = [i for i, (_, owner, _) in enumerate(model.flat.states) if owner not in neutral]
    row = model.plant.outputs.index(output)
    rest = [float(wire.rest) for wire in model.plant.inputs]
    scales = [wire.scale for wire in (*(s.wire for s in model.plant.states), model.plant.inputs[0])]
    scale = np.array([scales[i] for i in (*free, -1)])

    def mapped(deviation: Array, span: float) -> Array:
        """State and output after ``span`` for a deviation of states and input from rest."""
        x = start()
        for i, value in zip(free, deviation):
            x[i] += float(value)
        _, outputs = step(x, [rest[0] + float(deviation[-1]), *rest[1:]], 0.0, span)
        return np.array([*(x[i] for i in free), outputs[row]])

    n = len(free)
    deviations = np.diag(scale)

    def slopes(span: float) -> Array:
        origin = mapped(np.zeros(n + 1), span)
        columns = [(mapped(d, span) - origin) / s for d, s in zip(deviations, scale)]
        return np.column_stack(columns)

    joint = np.eye(n + 1)
    joint[:n] = slopes(size)[:n]
    ab = np.real(logm(joint)) / size
    cd = slopes(0.0)[n:]
    return LinearSystem(ab[:n, :n], ab[:n, n:], cd[:, :n], cd[:, n:])


def transfer_function(system: LinearSystem) -> tuple[float, Array]:
    """Return numerator and denominator of a system without zeros, highest power first.

    The numerator is C A^(n-1) B.
    """
    n = len(system.a)
    gain = system.c @ np.linalg.matrix_power(system.a, n - 1) @ system.b
    return float(gain[0, 0]), np.poly(system.a).astype(float)
