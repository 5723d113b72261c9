"""Transfer functions with delay, and the structures among which an identification chooses."""

from __future__ import annotations

from dataclasses import dataclass

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

    def function(self, coefficients: Array) -> TransferFunction:
        """Return the function with these ``coefficients``, in their order there."""
        top, bottom, delay = np.split(coefficients, [self.zeros + 1, self.size - self.delay])
        return TransferFunction.of(top, [1.0, *bottom], delay.sum())


STRUCTURES = tuple(
    Structure(poles, zeros, delay)
    for poles in range(1, 6)
    for delay in (False, True)
    for zeros in range(poles)
)
"""First to fifth order with any number of zeros, without and with delay."""


@dataclass(frozen=True)
class TransferFunction:
    """G(s) = exp(-delay s) numerator(s) / denominator(s); ``str`` writes it so.

    Coefficients are in SI, that of the highest power of s first; the denominator begins with 1.
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
        monic = (top / bottom[0]).tolist(), (bottom / bottom[0]).tolist()
        return cls(tuple(monic[0]), tuple(monic[1]), float(delay))

    @property
    def structure(self) -> Structure:
        return Structure(len(self.denominator) - 1, len(self.numerator) - 1, self.delay > 0.0)

    @property
    def coefficients(self) -> Array:
        """Numerator, denominator without its leading 1, and the delay if there is one."""
        delay = (self.delay,) if self.delay > 0.0 else ()
        return np.array([*self.numerator, *self.denominator[1:], *delay])

    @property
    def poles(self) -> Complex:
        """Roots of the denominator [1/s]."""
        return np.roots(self.denominator).astype(complex)

    @property
    def zeros(self) -> Complex:
        """Roots of the numerator [1/s]."""
        return np.roots(self.numerator).astype(complex)

    def response(self, frequencies: ArrayLike) -> Complex:
        """Return G(j w), complex, at ``frequencies`` [rad/s]."""
        s = 1j * np.asarray(frequencies, dtype=float)
        ratio = np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
        return np.asarray(ratio * np.exp(-s * self.delay), dtype=complex)

    def __str__(self) -> str:
        top, bottom = _polynomial(self.numerator), _polynomial(self.denominator)
        lag = f" exp(-{self.delay:.5g} s)" if self.delay else ""
        shown = f"({top})" if len(self.numerator) > 1 else top
        return f"{shown}{lag} / ({bottom})"


def _polynomial(coefficients: tuple[float, ...]) -> str:
    """``s^2 + 372 s + 1.5376e+06``, six digits each."""
    terms = []
    for power, value in zip(range(len(coefficients))[::-1], coefficients):
        number, variable = f"{value:.6g}", {0: "", 1: "s"}.get(power, f"s^{power}")
        bare = power and number in ("1", "-1")
        terms.append(f"{number[:-1]}{variable}" if bare else f"{number} {variable}".strip())
    return " + ".join(terms).replace("+ -", "- ")
