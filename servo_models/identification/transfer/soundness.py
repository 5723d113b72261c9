"""Poles and zeros that disqualify a transfer function, however well it fits."""

from __future__ import annotations

import numpy as np

from servo_models.core.types import Array
from servo_models.identification.transfer.fit import Fit
from servo_models.identification.transfer.functions import Complex, TransferFunction

UNDAMPED = 0.01
"""Damping ratio below which a pole pair counts as undamped."""
SETTLED = 4.0
"""Time constants of an oscillation until it is within 2 %."""
CERTAIN = 0.95
CLOSE = 0.01
"""A zero and a pole that are closer, relative to their size, leave nothing to be seen."""
VAGUE = 0.5
"""A zero whose standard error is a larger part of its size, or of the slowest pole's where that
is larger (a differentiator's zero at 0), is not determined."""


def pole_trouble(function: TransferFunction, longest: float | None) -> str:
    """Return why poles are not those of an actuator that the record shows, or "".

    Args:
        function: to be judged.
        longest: duration of the longest record [s], None without records.
    """
    for pole in sorted(function.poles, key=lambda p: -p.real):
        size, oscillates = abs(pole), pole.imag != 0.0
        where = _shown(pole)
        if oscillates and abs(pole.real) < UNDAMPED * size:
            ratio = -pole.real / size
            return f"undamped: poles at {where} rad/s, damping ratio {ratio:.2g}, never settle"
        if pole.real > 0.0 and not (longest and size * longest < 0.1):
            return f"unstable: a pole at {where} rad/s"
        if oscillates and longest and longest * abs(pole.real) < SETTLED:
            settling = SETTLED / abs(pole.real)
            return (
                f"undamped within the record: poles at {where} rad/s settle in {settling:.3g} s,"
                f" the longest record lasts {longest:.3g} s"
            )
    return ""


def slow_pole(function: TransferFunction, longest: float | None) -> str:
    """Return a warning about a real pole that the record is too short for, or ""."""
    slow = [p for p in function.poles if p.imag == 0.0 and longest and abs(p.real) * longest < 1.0]
    if not slow:
        return ""
    return (
        f"the pole at {_shown(slow[0])} rad/s is slower than the longest record ({longest:.3g} s):"
        " the static gain is not determined; record longer, or take it as an integrator"
    )


def surplus_zero(fit: Fit) -> str:
    """Return which zero is not determined, or cancels a pole, or "".

    Roots move by dp = -p^i da_i / A'(p); the distance of a pole and a zero is tested against
    its covariance.
    Source: Soederstroem, Test of pole-zero cancellation, Automatica 11 (1975).
    """
    from scipy.stats import chi2

    f, m, n = fit.function, fit.structure.zeros + 1, fit.structure.poles
    slowest = float(np.min(np.abs(f.poles)))
    for zero in f.zeros:
        slope = np.zeros(len(fit.covariance), dtype=complex)
        slope[:m] = _root_slopes(np.array(f.numerator), zero)
        error = float(np.sqrt(np.real(slope.conj() @ fit.covariance @ slope)))
        if error > VAGUE * max(abs(zero), slowest):
            return f"the zero at {_shown(zero)} rad/s is not determined: standard error {error:.2g}"
        for pole in f.poles:
            slope[m : m + n] = -_root_slopes(np.array(f.denominator), pole)[1:]
            parts = [slope.real] if zero.imag == pole.imag == 0.0 else [slope.real, slope.imag]
            spread = np.array(parts) @ fit.covariance @ np.array(parts).T
            gap = zero - pole
            distance = np.array([gap.real, gap.imag][: len(parts)])
            statistic = float(distance @ np.linalg.pinv(spread, hermitian=True) @ distance)
            near = abs(gap) < CLOSE * abs(pole)
            if near or statistic < chi2.ppf(CERTAIN, len(parts)):
                return (
                    f"pole-zero cancellation: the zero at {_shown(zero)} rad/s and the pole at"
                    f" {_shown(pole)} rad/s are one within"
                    + (f" {100.0 * CLOSE:g} %" if near else " their uncertainty")
                )
    return ""


def _root_slopes(polynomial: Array, root: complex) -> Complex:
    """Derivatives of a root by the coefficients, highest power first."""
    degree = len(polynomial) - 1
    powers = root ** (degree - np.arange(degree + 1))
    return np.asarray(-powers / np.polyval(np.polyder(polynomial), root), dtype=complex)


def _shown(root: complex) -> str:
    if root.imag == 0.0:
        return f"{root.real:.5g}"
    real = f"{root.real:.5g} " if abs(root.real) > 1e-6 * abs(root) else ""
    return f"{real}+-{abs(root.imag):.5g}j"
