"""Transfer functions with delay, and the structures among which an identification chooses."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from servo_models.core.types import Array, Complex


@dataclass(frozen=True)
class Structure:
    """How many poles and zeros, and whether there is a transport delay.

    Strictly proper: ``zeros`` < ``poles``.  ``str`` gives it in words.
    """

    poles: int
    zeros: int = 0
    delay: bool = False

    def __str__(self) -> str:
        zeros = {0: "", 1: ", 1 zero"}.get(self.zeros, f", {self.zeros} zeros")
        return f"order {self.poles}{zeros}{' + delay' if self.delay else ''}"

    @property
    def size(self) -> int:
        """Number of free coefficients, the delay included."""
        return self.poles + self.zeros + 1 + self.delay


STRUCTURES = tuple(
    Structure(poles, zeros, delay)
    for poles, delay in itertools.product(range(1, 6), (False, True))
    for zeros in range(poles)
)
"""First to fifth order with any number of zeros, without and with delay."""


@dataclass(frozen=True)
class TransferFunction:
    """G(s) = exp(-delay s) numerator(s) / denominator(s).

    Attributes:
        numerator, denominator: coefficients, highest power of s first, in SI (s in 1/s);
            the denominator begins with 1.
        delay: [s].
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    delay: float = 0.0

    @classmethod
    def of(
        cls, numerator: ArrayLike, denominator: ArrayLike, delay: float = 0.0
    ) -> TransferFunction:
        """Make one of any coefficients, highest power first; the denominator becomes monic."""
        top, bottom = (np.atleast_1d(np.asarray(c, dtype=float)) for c in (numerator, denominator))
        lead = bottom[0]
        return cls(tuple(map(float, top / lead)), tuple(map(float, bottom / lead)), float(delay))

    @property
    def structure(self) -> Structure:
        return Structure(len(self.denominator) - 1, len(self.numerator) - 1, self.delay > 0.0)

    @cached_property
    def rational(self) -> Any:
        """A ``control.TransferFunction``: all but the delay, which has none there."""
        import control

        return control.tf(self.numerator, self.denominator)

    @cached_property
    def poles(self) -> Complex:
        """Roots of the denominator [1/s]."""
        return np.asarray(self.rational.poles(), dtype=complex)

    @cached_property
    def zeros(self) -> Complex:
        """Roots of the numerator [1/s]."""
        return np.asarray(self.rational.zeros(), dtype=complex)

    def response(self, frequencies: ArrayLike) -> Complex:
        """Return G(j w), complex, at ``frequencies`` [rad/s]."""
        s = 1j * np.asarray(frequencies, dtype=float)
        return np.asarray(self.rational(s) * np.exp(-s * self.delay), dtype=complex)

    def phase(self, frequencies: ArrayLike) -> Array:
        """Return the phase [rad] at ``frequencies`` [rad/s], without jumps of a turn."""
        w = np.atleast_1d(np.asarray(frequencies, dtype=float))
        zeros, poles = (np.angle(1j * w[:, None] - r).sum(axis=1) for r in (self.zeros, self.poles))
        start = float(np.angle(self.numerator[0]) + np.angle(0.0 - self.zeros).sum())
        return np.asarray(
            np.angle(self.numerator[0])
            + zeros
            - poles
            - w * self.delay
            - 2.0 * np.pi * round(start / (2.0 * np.pi))
        )

    def __str__(self) -> str:
        top, bottom = _polynomial(self.numerator), _polynomial(self.denominator)
        lag = f" exp(-{self.delay:.5g} s)" if self.delay else ""
        shown = f"({top})" if len(self.numerator) > 1 else top
        return f"{shown}{lag} / ({bottom})"


def _polynomial(coefficients: tuple[float, ...]) -> str:
    """``s^2 + 372 s + 1537600``, five digits each."""
    degree = len(coefficients) - 1
    text = ""
    for k, value in enumerate(coefficients):
        power = degree - k
        variable = {0: "", 1: "s"}.get(power, f"s^{power}")
        number = f"{abs(value):.6g}"
        size = variable if variable and number == "1" else f"{number} {variable}".strip()
        sign = "-" if value < 0.0 else "+"
        text += f" {sign} {size}" if text else ("-" if value < 0.0 else "") + size
    return text
