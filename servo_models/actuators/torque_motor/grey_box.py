"""Physical constants from the coefficients of an identified transfer function.

Source: valve paper sec. 5; Ljung, System Identification, 2nd ed., sec. 9.6 for the way of
the covariance from coefficients to constants (first order, "delta method").
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from servo_models.actuators.torque_motor.variants import TABLE_1, grey_box
from servo_models.core.types import Array

COEFFICIENTS = ("gain", "s2", "s1", "s0")
"""Of gain / (s^3 + s2 s^2 + s1 s + s0)."""
KNOWN = ("resistance", "rotor_inertia", "stiffness")
"""What the torque motor's four coefficients cannot tell."""
VAGUE = 0.3
"""A constant whose standard error is a larger part of it is not determined."""
TOUCHY = 10.0
"""Without standard errors: 1 % in a coefficient moves a constant that is not determined by
more than this [%]."""
DELAY = "transport_delay.time"


@dataclass(frozen=True)
class Constant:
    """A physical constant.

    Attributes:
        name: of the actuator's parameter.
        value, standard_error: SI; None where the coefficients came without errors.
        touchiest: coefficient or known constant that moves it most.
        elasticity: relative change of it per relative change of ``touchiest`` [1].
    """

    name: str
    value: float
    standard_error: float | None
    touchiest: str = ""
    elasticity: float = 0.0

    @property
    def determined(self) -> bool:
        """Whether the data say more than its order of magnitude."""
        if self.standard_error is None:
            return abs(self.elasticity) <= TOUCHY
        return self.standard_error <= VAGUE * abs(self.value)

    @property
    def warning(self) -> str:
        """A sentence where the constant is not determined or hangs on one coefficient, or ""."""
        touchy = f"1 % in {self.touchiest} moves it by {abs(self.elasticity):.0f} %"
        if self.determined:
            ill = abs(self.elasticity) > TOUCHY
            return f"{self.name} is ill-conditioned: {touchy}" if ill else ""
        why = touchy
        if self.standard_error is not None and self.value:
            share = 100.0 * self.standard_error / abs(self.value)
            why = f"its standard error is {share:.0f} % of it; {touchy}"
        return f"the data do not determine {self.name}: {why}"


@dataclass(frozen=True, eq=False)
class PhysicalConstants:
    """Constants of the torque motor by name, and their covariance in that order, SI."""

    constants: Mapping[str, Constant]
    covariance: Array | None

    @property
    def warnings(self) -> tuple[str, ...]:
        return tuple(c.warning for c in self.constants.values() if c.warning)

    @property
    def estimates(self) -> dict[str, tuple[float, float | None]]:
        """(value, standard error), SI, by name of the parameter."""
        return {c.name: (c.value, c.standard_error) for c in self.constants.values()}


def torque_motor_constants(
    coefficients: ArrayLike,
    covariance: ArrayLike | None = None,
    known: Mapping[str, float] | None = None,
    known_errors: Mapping[str, float] | None = None,
) -> PhysicalConstants:
    """Return inductance, torque constant, friction coefficient and back EMF constant.

    Args:
        coefficients: gain, s2, s1, s0 of gain / (s^3 + s2 s^2 + s1 s + s0), SI, from voltage
            [V] to angle [rad]; a fifth one is the delay [s] and becomes
            ``transport_delay.time``.
        covariance: of the coefficients, SI.
        known: resistance, rotor_inertia and stiffness, SI; default Table 1.
        known_errors: their standard errors, SI; exact where not named.
    """
    given = np.asarray(coefficients, dtype=float)
    held = {name: (known or TABLE_1)[name] for name in KNOWN}
    base = np.array([*given[:4], *held.values()])

    def solve(x: Array) -> dict[str, float]:
        return grey_box(*map(float, x))

    values = solve(base)
    names = list(values)
    slopes = _slopes(lambda x: np.array(list(solve(x).values())), base)
    spread = None
    if covariance is not None:
        joint = np.zeros((len(base), len(base)))
        joint[:4, :4] = np.asarray(covariance, dtype=float)[:4, :4]
        for k, name in enumerate(KNOWN, start=4):
            joint[k, k] = (known_errors or {}).get(name, 0.0) ** 2
        spread = slopes @ joint @ slopes.T
    causes = (*(f"coefficient {c}" for c in COEFFICIENTS), *KNOWN)
    found: dict[str, Constant] = {}
    for k, name in enumerate(names):
        elasticity = slopes[k] * base / values[name]
        most = int(np.argmax(np.abs(elasticity)))
        error = None if spread is None else float(np.sqrt(spread[k, k]))
        found[name] = Constant(name, values[name], error, causes[most], float(elasticity[most]))
    if len(given) > 4:
        error = None if covariance is None else float(np.sqrt(np.asarray(covariance)[4, 4]))
        found[DELAY] = Constant(DELAY, float(given[4]), error)
    return PhysicalConstants(found, spread)


def _slopes(function: Callable[[Array], Array], at: Array) -> Array:
    """Derivatives of a vector function by central differences, shape (outputs, inputs)."""
    columns = []
    for k, value in enumerate(at):
        step = np.zeros(len(at))
        step[k] = 1e-5 * value
        columns.append((function(at + step) - function(at - step)) / (2.0 * step[k]))
    return np.column_stack(columns)
