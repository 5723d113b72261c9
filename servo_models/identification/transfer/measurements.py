"""What a transfer function is fitted to: time records and frequency responses.

Both kinds tell how far a function is from the data, with exact derivatives by its coefficients.

Responses to held inputs are exact on any grid, with any delay: the delay moves the instants at
which the input changes, and between instants the matrix exponential goes on.  python-control
and scipy know neither delays nor uneven grids without an approximation.
Sources: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., sec. 4.3.3, with
the sensitivities as further states (Ljung, System Identification, 2nd ed., sec. 10.3).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array, Complex, Mask
from servo_models.data.log import Log
from servo_models.errors import UserError, did_you_mean
from servo_models.identification.transfer.functions import TransferFunction


@dataclass(frozen=True, eq=False)
class Record:
    """A time record of one input and one output, SI, shape (n,).

    The input is held between samples and given as deviation from the record's equilibrium; the
    constant offset of the output is a nuisance of each record.  No fit may see what is held out.
    """

    name: str
    times: Array
    given: Array
    measured: Array
    held_out: Mask

    @classmethod
    def of(cls, log: Log, source: str, output: str, rest: float = 0.0) -> Record:
        """Take a signal pair out of a log; it starts in the equilibrium of its first row if it has
        a ``settle`` time, else in that of ``rest`` [SI].

        Raises:
            UserError: a log without the signals, one that begins in motion, samples that are not
                judged, or an input at rest.
        """
        place = f"log '{log.name}':"
        for kind, name, known in (("input", source, log.inputs), ("output", output, log.outputs)):
            if name not in known:
                cure = did_you_mean(name, known)
                raise UserError(f"{place} the log has no {kind} '{name}'; {cure}")
        if log.start is not None:
            raise UserError(
                f'{place} a transfer function knows no \'start\' but "rest" or "settled": give one'
                " of these, or cut the log where it rests with 'window'"
            )
        if log.skipped is not None and np.any(log.skipped):
            raise UserError(
                f"{place} a transfer function is fitted to every sample, 'judged' leaves some out:"
                " remove it, or cut the log with 'window'"
            )
        u = log.inputs[source]
        given = u - (u[0] if log.settle > 0.0 else rest)
        if not np.any(given):
            raise UserError(
                f"{place} input '{source}' never leaves its rest: a transfer function needs a"
                " record in which it moves"
            )
        return cls(log.name, log.times, given, log.outputs[output], log.held_out)

    @cached_property
    def step(self) -> float:
        """Median sampling step [s]."""
        return float(np.median(np.diff(self.times)))

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency [rad/s] that it speaks of."""
        return 3.0 / float(self.times[-1] - self.times[0]), 1.0 / (3.0 * self.step)

    @property
    def fitted(self) -> Mask:
        """Rows of ``errors`` that a fit may see."""
        return np.asarray(~self.held_out)

    @cached_property
    def noise_guess(self) -> float:
        """Size of white noise by its second differences, or the smallest visible error."""
        bends = np.diff(self.measured, 2)
        noise = float(np.median(np.abs(bends))) / (0.6745 * np.sqrt(6.0))
        return float(max(noise, 1e-4 * np.std(self.measured), 1e-300))

    def errors(self, function: TransferFunction) -> tuple[Array, Array]:
        """Measured minus modelled, shape (n,), and its derivatives, shape (n, coefficients).

        Columns: numerator, denominator without its leading 1, and the delay, also where it is 0.
        """
        chain, scale, units = _chain(function)
        n, first = len(chain), len(chain) - len(function.numerator)
        b = np.append(np.zeros(first), np.array(function.numerator) / units[first:])
        joint = np.zeros((2 * n + 1, 2 * n + 1))  # p^i / A u, then p^i B / A^2 u, then u
        joint[:n, :n] = joint[n:-1, n:-1] = chain
        joint[n, :n], joint[0, -1] = b, 1.0
        states, u = self._driven(scale * joint, function.delay)
        z, v = states[:, :n], states[:, n:]
        rates = scale * np.column_stack([u + z @ chain[0], z[:, :-1]]) @ b
        columns = np.column_stack([z[:, first:] / units[first:], -v / units, -rates])
        return self._level(self.measured - z @ b), -self._level(columns)

    def response(self, function: TransferFunction) -> Array:
        """Return the modelled output, at the measured mean offset, shape (n,)."""
        return np.asarray(self.measured - self.errors(function)[0])

    def moved(self, function: TransferFunction) -> tuple[Array, Array]:
        """Modelled and measured movement in the rows that a fit may see."""
        model, measured = self._level(self.response(function)), self._level(self.measured)
        return model[self.fitted], measured[self.fitted]

    def _driven(self, matrix: Array, delay: float) -> tuple[Array, Array]:
        """Return states of x' = matrix (x, u) from x = 0, shape (samples, n), and u as it acts from
        each sample on: held between samples, and ``delay`` [s] later.

        Not finite where an unstable system leaves the floats.
        """
        from scipy.linalg import expm

        tick = 1e-9 * self.step  # instants within one tick are one instant
        samples = np.rint((self.times - self.times[0]) / tick).astype(np.int64)
        changes = np.flatnonzero(np.diff(self.given, prepend=0.0))
        edges = samples[changes] + int(np.rint(delay / tick))
        instants = np.union1d(samples, edges[(edges > 0) & (edges < samples[-1])])
        levels = np.append(0.0, self.given[changes])
        acting = levels[np.searchsorted(edges, instants, "right")]
        spans, which = np.unique(np.diff(instants), return_inverse=True)
        with np.errstate(all="ignore"):
            maps = expm(matrix * (tick * spans)[:, None, None])
        states = _compiled()(np.ascontiguousarray(maps[:, :-1]), which, acting)
        rows = np.searchsorted(instants, samples)
        return states[rows], acting[rows]

    def _level(self, columns: Array) -> Array:
        """Columns without their mean over the rows to be fitted, or all of them if none is."""
        used = ~self.held_out if not np.all(self.held_out) else self.held_out
        return np.asarray(columns - np.mean(columns[used], axis=0))


def _chain(function: TransferFunction) -> tuple[Array, float, Array]:
    """Companion form of p^i / A(p), highest power first, with s = scale p; that scale [1/s], about
    the size of the poles; and SI per coefficient in it, shape (poles,)."""
    bottom = np.array(function.denominator[1:])
    powers = np.arange(1, len(bottom) + 1)
    sizes = np.abs(bottom) ** (1.0 / powers)
    scale = float(sizes[-1] if sizes[-1] > 1e-3 * sizes.max() else sizes.max()) or 1.0
    chain = np.eye(len(bottom), k=-1)
    chain[0] = -bottom / scale**powers
    return chain, scale, np.asarray(scale**powers)


def _recursion(maps: Array, which: NDArray[np.int64], acting: Array) -> Array:
    """x[k + 1] = maps[which[k]] (x[k], acting[k]) from x[0] = 0."""
    n = maps.shape[1]
    states = np.zeros((len(which) + 1, n))
    for k in range(len(which)):
        for i in range(n):
            states[k + 1, i] = maps[which[k], i, n] * acting[k]
            for j in range(n):
                states[k + 1, i] += maps[which[k], i, j] * states[k, j]
    return states


@functools.cache
def _compiled() -> Callable[..., Array]:
    """The recursion through numba: the hot loop of the fit, which Python would dominate."""
    from numba import njit

    compiled: Callable[..., Array] = njit(cache=True, error_model="numpy")(_recursion)
    return compiled


@dataclass(frozen=True, eq=False)
class Sweep:
    """A frequency response in points, shape (n,): frequencies [rad/s], and complex gain in SI with
    lags as negative phase.  No fit may see what is held out."""

    name: str
    source: str
    output: str
    frequencies: Array
    measured: Complex
    held_out: Mask
    noise_guess: ClassVar[float] = 0.02

    @property
    def band(self) -> tuple[float, float]:
        return float(self.frequencies.min()), float(self.frequencies.max())

    @property
    def fitted(self) -> Mask:
        return np.tile(~self.held_out, 2)

    def response(self, function: TransferFunction) -> Complex:
        return function.response(self.frequencies)

    def errors(self, function: TransferFunction) -> tuple[Array, Array]:
        """Logarithm of gain [1] first, then phase [rad], measured over modelled.

        Shapes (2 n,) and (2 n, coefficients), see ``Record.errors``.  Phases of the derivatives
        are continuous over the points, so that a delay that is far off still has a slope.
        """
        s = 1j * self.frequencies[:, None]
        powers = s ** np.arange(len(function.denominator) - 1)[::-1]
        upper, lower = (np.polyval(c, s) for c in (function.numerator, function.denominator))
        slopes = np.hstack([powers[:, -len(function.numerator) :] / upper, -powers / lower, -s])
        errors = np.log(self.measured / self.response(function))
        return np.concatenate([errors.real, errors.imag]), -np.vstack([slopes.real, slopes.imag])

    def moved(self, function: TransferFunction) -> tuple[Complex, Complex]:
        """See ``Record.moved``."""
        return self.response(function)[~self.held_out], self.measured[~self.held_out]


Measurement = Record | Sweep  # one record or one frequency response
Measurements = Sequence[Measurement]


def band(measurements: Measurements) -> tuple[float, float]:
    """Return the lowest and highest frequency [rad/s] that the data speak of."""
    lows, highs = zip(*(data.band for data in measurements))
    return min(lows), max(highs)
