"""A linear state space about a working point, with exact delays."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from servo_models.core.types import Array

CANCELS = 1e-6  # largest distance of a pole and a zero that cancel, over the fastest pole
FURTHEST_ZERO = 1e4  # largest zero over the fastest pole; a larger one is a rounded leading 0


@dataclass(frozen=True)
class LinearModel:
    """x' = A x + B u, y = C x + D u, in SI, for deviations from a working point.

    With a period, x' is the state one period later, and y is read at the instant u is set.

    Delays are channels of their own: ``joint_*`` has their outputs before the inputs u and
    their inputs before the outputs y.  A, B, C, D are those of the model without delay.

    Attributes:
        joint_a, joint_b, joint_c, joint_d: of shapes (n, n), (n, k + m), (k + p, n),
            (k + p, k + m) for n states, k delays, m inputs and p outputs.
        states, inputs, outputs: names, in the order of rows and columns.
        channels: time [s] of each delay channel.
        delays: time [s] by name of the effect.
        left_out: effects that have no linear form, with the reason.
        point: SI values of inputs, states and outputs at the working point.
        period: [s] from sample to sample, 0 in continuous time.
    """

    joint_a: Array
    joint_b: Array
    joint_c: Array
    joint_d: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    channels: tuple[float, ...]
    delays: Mapping[str, float]
    left_out: Mapping[str, str]
    point: Mapping[str, float]
    period: float = 0.0

    def matrices(self) -> tuple[Array, Array, Array, Array]:
        """Return A, B, C, D with every delay 0, shapes (n, n), (n, m), (p, n), (p, m)."""
        k = len(self.channels)
        b, c, d = self.joint_b, self.joint_c, self.joint_d
        through = np.linalg.inv(np.eye(k) - d[:k, :k])
        return (
            self.joint_a + b[:, :k] @ through @ c[:k],
            b[:, k:] + b[:, :k] @ through @ d[:k, k:],
            c[k:] + d[k:, :k] @ through @ c[:k],
            d[k:, k:] + d[k:, :k] @ through @ d[:k, k:],
        )

    def is_stable(self) -> bool:
        """Whether no pole of A grows; an integrator does not."""
        poles = np.linalg.eigvals(self.matrices()[0])
        growth = abs(poles) - 1.0 if self.period else poles.real
        return bool(np.all(growth <= 1e-9 * np.max(abs(poles), initial=0.0)))

    def slowest(self) -> float:
        """Return the longest time constant [s] of the poles that decay, 0 without any."""
        poles = self.rates()
        rates = -poles.real
        decaying = rates[rates > 1e-9 * np.max(abs(poles), initial=0.0)]
        return float(1.0 / decaying.min()) if len(decaying) else 0.0

    def integrates(self) -> bool:
        """Whether a pole is at 0, so that the output does not return."""
        sizes = abs(self.rates())
        return bool(np.any(sizes <= 1e-9 * np.max(sizes, initial=0.0)))

    def rates(self) -> NDArray[np.complex128]:
        """Return the poles [rad/s] of A; of a sampled model without those of pure delays."""
        return self._in_time(np.linalg.eigvals(self.matrices()[0]))

    def _in_time(self, roots: ArrayLike) -> NDArray[np.complex128]:
        """Roots [rad/s]; those of a sampled model by the logarithm, without pure delays."""
        given = np.asarray(roots, dtype=complex)
        return np.log(given[given != 0.0]) / self.period if self.period else given

    def poles_and_zeros(
        self, input_: str, output: str
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return poles and zeros [rad/s] from one input to one output, what cancels left out."""
        import control

        system = control.ss(*self.channel(input_, output), remove_useless_states=False)
        poles, zeros = list(system.poles()), []
        fastest = np.max(np.abs(poles), initial=0.0)
        for zero in system.zeros():
            nearest = min(poles, key=lambda pole: abs(pole - zero), default=math.inf)
            if abs(nearest - zero) <= CANCELS * fastest:
                poles.remove(nearest)
            elif abs(zero) <= FURTHEST_ZERO * fastest:
                zeros.append(zero)
        return self._in_time(poles), self._in_time(zeros)

    def channel(self, input_: str, output: str) -> tuple[Array, Array, Array, Array]:
        """Return A, B, C, D from one input to one output, shapes (n, n), (n, 1), (1, n), (1, 1)."""
        a, b, c, d = self.matrices()
        column, row = [self.inputs.index(input_)], [self.outputs.index(output)]
        return a, b[:, column], c[row], d[row][:, column]

    def response(self, frequencies: ArrayLike, input_: str, output: str) -> NDArray[np.complex128]:
        """Return output over input [SI], shape (n,), at ``frequencies`` [Hz], delays exact.

        With a period it is valid up to half the sampling frequency.
        """
        k, n = len(self.channels), len(self.states)
        times = np.array(self.channels)
        column, row = k + self.inputs.index(input_), k + self.outputs.index(output)
        values = []
        for frequency in np.atleast_1d(np.asarray(frequencies, dtype=float)):
            s = 2j * math.pi * frequency
            shift = cmath.exp(s * self.period) if self.period else s
            whole = self.joint_c @ np.linalg.solve(shift * np.eye(n) - self.joint_a, self.joint_b)
            whole = whole + self.joint_d
            late = np.diag(np.exp(-s * times))
            loop = np.linalg.solve(np.eye(k) - whole[:k, :k] @ late, whole[:k, column])
            values.append(whole[row, column] + whole[row, :k] @ late @ loop)
        return np.array(values, dtype=complex)


def transfer_function(
    system: tuple[Array, Array, Array, Array],
) -> tuple[float, Array]:
    """Return numerator and denominator of a system without zeros, highest power first.

    The numerator is C A^(n-1) B.
    """
    a, b, c, _ = system
    gain = c @ np.linalg.matrix_power(a, len(a) - 1) @ b
    return float(gain[0, 0]), np.poly(a).astype(float)
