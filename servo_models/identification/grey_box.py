"""Physical constants from the coefficients of an identified transfer function, by a grey box.

Source: Ljung, System Identification, 2nd ed., sec. 9.6 for the way of the covariance from
coefficients to constants (first order, "delta method").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from servo_models.analysis.statistics import derivatives
from servo_models.core.plant import GreyBox
from servo_models.core.types import Array
from servo_models.identification.result import Doubt

VAGUE = 0.3  # standard error over a constant from which it is not determined
TOUCHY = 10.0  # change [%] of a constant by 1 % in a coefficient, from which it is not determined


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
        return Doubt(f"the data do not determine {self.name}: {why}")


@dataclass(frozen=True, eq=False)
class PhysicalConstants:
    """Constants of an actuator by name, and their covariance in that order, SI."""

    constants: Mapping[str, Constant]
    covariance: Array | None

    @property
    def warnings(self) -> tuple[str, ...]:
        return tuple(c.warning for c in self.constants.values() if c.warning)

    @property
    def estimates(self) -> dict[str, tuple[float, float | None]]:
        """(value, standard error), SI, by name of the parameter."""
        return {c.name: (c.value, c.standard_error) for c in self.constants.values()}


def physical_constants(
    grey_box: GreyBox,
    coefficients: ArrayLike,
    known: Mapping[str, float],
    covariance: ArrayLike | None = None,
    known_errors: Mapping[str, float] | None = None,
) -> PhysicalConstants:
    """Return the constants that a grey box makes of a transfer function.

    Args:
        grey_box: of the actuator.
        coefficients: of the function, as many as the grey box names, SI; one more is the delay
            [s] and becomes the grey box's ``delay``.
        known: its known parameters by name, SI.
        covariance: of the coefficients, SI.
        known_errors: standard errors of the known ones, SI; exact where not named.
    """
    given, count = np.asarray(coefficients, dtype=float), len(grey_box.coefficients)
    base = np.array([*given[:count], *(known[name] for name in grey_box.known)])

    def solve(x: Array) -> dict[str, float]:
        return grey_box.solve(*map(float, x))

    values = solve(base)
    names = list(values)
    slopes = derivatives(lambda x: np.array(list(solve(x).values())), base)
    spread = None
    if covariance is not None:
        joint = np.zeros((len(base), len(base)))
        joint[:count, :count] = np.asarray(covariance, dtype=float)[:count, :count]
        for k, name in enumerate(grey_box.known, start=count):
            joint[k, k] = (known_errors or {}).get(name, 0.0) ** 2
        spread = slopes @ joint @ slopes.T
    causes = (*(f"coefficient {c}" for c in grey_box.coefficients), *grey_box.known)
    constants: dict[str, Constant] = {}
    for k, name in enumerate(names):
        elasticity = slopes[k] * base / values[name]
        most = int(np.argmax(np.abs(elasticity)))
        error = None if spread is None else float(np.sqrt(spread[k, k]))
        constants[name] = Constant(name, values[name], error, causes[most], float(elasticity[most]))
    if len(given) > count:
        error = None if covariance is None else float(np.sqrt(np.asarray(covariance)[count, count]))
        constants[grey_box.delay] = Constant(grey_box.delay, float(given[count]), error)
    return PhysicalConstants(constants, spread)
