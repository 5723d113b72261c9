"""What a transfer function is fitted to: time records and frequency responses.

Both kinds answer the same two questions: how far a point of the parameter space is from
the data, with exact derivatives, and what the data say about the coefficients when the
equation error is made linear in them.

Responses to held inputs are exact on any grid, with any delay: the delay moves the instants at
which the input changes, and between instants the matrix exponential goes on.  This is the hot
loop of the fit; python-control knows neither delays nor uneven grids without an approximation.
Sources: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., sec. 4.3.3, with
the sensitivities as further states (Ljung, System Identification, 2nd ed., sec. 10.3); Young,
Recursive Estimation and Time-Series Analysis, 2nd ed., ch. 8.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array, Complex, Mask
from servo_models.data.log import Log
from servo_models.errors import UserError, did_you_mean
from servo_models.identification.transfer.functions import TransferFunction

TICKS = 1e9  # ticks in a median sampling step; instants within one tick are one instant


@dataclass(frozen=True)
class Point:
    """Coefficients in a scale in which they are of order one.

    With s = ``scale`` p: exp(-delay s) sum(b_i p^i) / (p^n + sum(a_i p^i)).

    Attributes:
        b, a: lowest power first, shapes (zeros + 1,) and (poles,).
        scale: [1/s].
        delay: [s].
    """

    b: Array
    a: Array
    scale: float
    delay: float = 0.0

    @classmethod
    def of(cls, function: TransferFunction) -> Point:
        """Scale by the geometric mean of the poles, or the size of an integrator's others."""
        bottom = np.array(function.denominator[::-1])
        n = len(bottom) - 1
        sizes = np.abs(bottom[:-1]) ** (1.0 / (n - np.arange(n)))
        scale = float(sizes[0] if sizes[0] > 1e-3 * sizes.max() else sizes.max()) or 1.0
        top = np.array(function.numerator[::-1])
        powers = scale ** (n - np.arange(n))
        return cls(top / powers[: len(top)], bottom[:-1] / powers, scale, function.delay)

    def function(self) -> TransferFunction:
        units = self.units
        top, bottom = self.b * units[: len(self.b)], self.a * units
        return TransferFunction.of(top[::-1], [1.0, *bottom[::-1]], self.delay)

    @property
    def units(self) -> Array:
        """SI per scaled coefficient of the power 0, 1, ..., shape (poles,)."""
        n = len(self.a)
        return np.asarray(self.scale ** (n - np.arange(n)))


def check_signals(log: Log, source: str, output: str) -> None:
    """Raise UserError unless a log has this input and this output, begins at rest or settled, and
    every sample is judged."""
    for kind, name, known in (("input", source, log.inputs), ("output", output, log.outputs)):
        if name not in known:
            raise UserError(
                f"log '{log.name}': the log has no {kind} '{name}'; {did_you_mean(name, known)}"
            )
    if log.start is not None:
        raise UserError(
            f"log '{log.name}': a transfer function knows no 'start' but \"rest\" or \"settled\":"
            " give one of these, or cut the log where it rests with 'window'"
        )
    if log.skipped is not None and np.any(log.skipped):
        raise UserError(
            f"log '{log.name}': a transfer function is fitted to every sample, 'judged' leaves some"
            " out: remove it, or cut the log with 'window'"
        )


@dataclass(frozen=True, eq=False)
class Record:
    """A time record of one input and one output, SI.

    Attributes:
        times: [s], shape (n,).
        given: input as deviation from where the record's equilibrium is; held.
        measured: output; its constant offset is a nuisance of each record.
        held_out: samples that no fit may see.
    """

    name: str
    times: Array
    given: Array
    measured: Array
    held_out: Mask

    @classmethod
    def of(cls, log: Log, source: str, output: str, rest: float = 0.0) -> Record:
        """Take a signal pair out of a log.

        A log with a ``settle`` time starts in the equilibrium of its first row, one
        without in that of ``rest`` [SI].

        Raises:
            UserError: a signal that is not there, an input at rest, samples that are not judged.
        """
        check_signals(log, source, output)
        u, y = log.inputs[source], log.outputs[output]
        given = u - (u[0] if log.settle > 0.0 else rest)
        if not np.any(given):
            raise UserError(
                f"log '{log.name}': input '{source}' never leaves its rest:"
                " a transfer function needs a record in which it moves"
            )
        return cls(log.name, log.times, given, y, log.held_out)

    @cached_property
    def held(self) -> Held:
        return Held.of(self.times, self.given)

    @property
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

    def errors(self, point: Point, delay: bool) -> tuple[Array, Array]:
        """Measured minus modelled, shape (n,), and its derivatives, shape (n, size).

        Columns: b, a, and the delay [s] if ``delay``.
        """
        z, v, u = self._states(point)
        m, w = len(point.b), point.scale
        columns = [z[:, :m], -v]
        if delay:
            highest = u - z @ point.a
            rates = np.column_stack([z[:, 1:], highest])[:, :m] @ point.b
            columns.append((-w * rates)[:, None])
        model, slopes = z[:, :m] @ point.b, np.column_stack(columns)
        return self._level(self.measured - model), -self._level(slopes)

    def response(self, function: TransferFunction) -> Array:
        """Return the modelled output, at the measured mean offset, shape (n,)."""
        error, _ = self.errors(Point.of(function), False)
        return np.asarray(self.measured - error)

    def regression(
        self, filter_: Point, model: Point | None, zeros: int
    ) -> tuple[Array, Array, Array]:
        """Left side (n,), regressors and instruments (n, size) of the filtered equation.

        The denominator of ``filter_`` filters it and its delay delays the input; ``model``
        makes the instruments, without it the regressors are their own.
        """
        a, b = _chain(filter_.a, filter_.scale)
        zu, _ = propagate(self.held, a, b, filter_.delay)
        start = np.mean(self.measured[: max(int(np.argmax(self.given != 0.0)), 1)])
        level = self.measured - start
        zy = self._smooth(level, a, b)
        regressors = self._level(np.column_stack([zu[:, : zeros + 1], -zy]))
        instruments = regressors
        if model:
            states, _, _ = self._states(model)
            zs = self._smooth(states[:, : len(model.b)] @ model.b, a, b)
            instruments = self._level(np.column_stack([zu[:, : zeros + 1], -zs]))
        return self._level(level - zy @ filter_.a), regressors, instruments

    def _smooth(self, values: Array, a: Array, b: Array) -> Array:
        """States of a filter driven by a sampled smooth signal (trapezoidal)."""
        middle = np.append(0.5 * (values[1:] + values[:-1]), 0.0)
        states, _ = propagate(Held.of(self.times, middle), a, b)
        return states

    def _states(self, point: Point) -> tuple[Array, Array, Array]:
        """p^i / A u, p^i B / A^2 u, and the delayed input, at the samples."""
        n = len(point.a)
        a, b = _chain(point.a, point.scale)
        joint = np.zeros((2 * n, 2 * n))
        joint[:n, :n] = joint[n:, n:] = a
        joint[-1, : len(point.b)] = point.scale * point.b
        states, u = propagate(self.held, joint, np.append(b, np.zeros(n)), point.delay)
        return states[:, :n], states[:, n:], u

    def _level(self, columns: Array) -> Array:
        """Columns without their mean over the rows to be fitted, or all of them if none is."""
        used = ~self.held_out if not np.all(self.held_out) else self.held_out
        return np.asarray(columns - np.mean(columns[used], axis=0))


def _chain(a: Array, scale: float) -> tuple[Array, Array]:
    """Companion form of p^i / A(p) in real time."""
    n = len(a)
    matrix = np.eye(n, k=1)
    matrix[-1] = -a
    return scale * matrix, np.append(np.zeros(n - 1), scale)


@dataclass(frozen=True, eq=False)
class Sweep:
    """A frequency response in points.

    Attributes:
        source, output: names of input and output.
        frequencies: [rad/s], shape (n,).
        response: complex gain, SI output per SI input, shape (n,); lag is negative phase.
        spread: relative standard errors of the points, up to a common factor, shape (n,).
        held_out: points that no fit may see.
    """

    name: str
    source: str
    output: str
    frequencies: Array
    response: Complex
    spread: Array
    held_out: Mask

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency [rad/s]."""
        return float(self.frequencies.min()), float(self.frequencies.max())

    @property
    def fitted(self) -> Mask:
        """Rows of ``errors`` that a fit may see."""
        return np.tile(~self.held_out, 2)

    @cached_property
    def noise_guess(self) -> float:
        """Relative."""
        return 0.02 / float(np.median(self.spread))

    def errors(self, point: Point, delay: bool) -> tuple[Array, Array]:
        """Logarithm of gain [1] first, then phase [rad], each over the point's spread.

        Shapes (2 n,) and (2 n, size), see ``Record.errors``.
        """
        p = self._scaled(point)
        top, bottom = self._powers(p, len(point.b)), self._powers(p, len(point.a))
        upper, lower = top @ point.b, p ** len(point.a) + bottom @ point.a
        model = upper / lower * np.exp(-p * point.scale * point.delay)
        columns = [top / upper[:, None], -bottom / lower[:, None]]
        if delay:
            columns.append(np.asarray(-p * point.scale)[:, None])
        slopes = np.column_stack(columns)
        return self._rows(np.log(self.response / model)), -self._rows(slopes)

    def regression(
        self, filter_: Point, model: Point | None, zeros: int
    ) -> tuple[Array, Array, Array]:
        """See ``Record.regression``; shapes (2 n,) and (2 n, size)."""
        p = self._scaled(filter_)
        n = len(filter_.a)
        bottom = self._powers(p, n)
        lower = (p**n + bottom @ filter_.a) * self.response
        wait = np.exp(-1j * self.frequencies * filter_.delay)
        top = (wait / lower)[:, None] * bottom[:, : zeros + 1]

        def rows(output: Complex) -> Array:
            return self._rows(np.column_stack([top, -(output / lower)[:, None] * bottom]))

        regressors = rows(self.response)
        noise_free = rows(model.function().response(self.frequencies)) if model else regressors
        return self._rows(p**n * self.response / lower), regressors, noise_free

    def _scaled(self, point: Point) -> Complex:
        return np.asarray(1j * self.frequencies / point.scale, dtype=complex)

    def _rows(self, values: Complex) -> Array:
        weighted = (values.T / self.spread).T
        return np.concatenate([weighted.real, weighted.imag])

    @staticmethod
    def _powers(p: Complex, count: int) -> Complex:
        return np.asarray(p[:, None] ** np.arange(count))


Measurement = Record | Sweep
"""One record or one frequency response."""
Measurements = Sequence[Measurement]


def band(measurements: Measurements) -> tuple[float, float]:
    """Return the lowest and highest frequency [rad/s] that the data speak of."""
    lows, highs = zip(*(data.band for data in measurements))
    return min(lows), max(highs)


@dataclass(frozen=True, eq=False)
class Held:
    """A piecewise constant signal that is 0 before its first edge, and when it is asked for.

    Attributes:
        edges: ticks at which a new value begins, increasing, shape (m,).
        values: those values, shape (m,).
        samples: ticks at which outputs are wanted, the first one 0, shape (n,).
        tick: length of a tick [s].
    """

    edges: NDArray[np.int64]
    values: Array
    samples: NDArray[np.int64]
    tick: float

    @classmethod
    def of(cls, times: Array, values: Array) -> Held:
        """Make one of a sampled signal; each value is held from its time on."""
        tick = float(np.median(np.diff(times))) / TICKS
        samples = np.rint((times - times[0]) / tick).astype(np.int64)
        kept = np.flatnonzero(np.diff(values, prepend=0.0))
        return cls(samples[kept], values[kept], samples, tick)


def propagate(held: Held, a: Array, b: Array, delay: float = 0.0) -> tuple[Array, Array]:
    """Return states and delayed input at the samples, from x = 0 at the first one.

    Args:
        held: the input u.
        a, b: x' = a x + b u, shapes (n, n) and (n,), in 1/s.
        delay: of the input [s], not negative; any fraction of a sample.

    Returns:
        States of shape (samples, n), and u as it acts from each sample on, shape (samples,).
        Not finite where an unstable system leaves the floats.
    """
    from scipy.linalg import expm

    cut, recur = _compiled()
    edges = held.edges + int(np.rint(delay / held.tick))
    levels = np.concatenate([[0.0], held.values])
    spans, acting, row, at_sample = cut(held.samples, edges, levels)
    distinct = np.sort(spans)
    distinct = distinct[np.append(True, np.diff(distinct) > 0)]
    n = len(b)
    joint = np.zeros((n + 1, n + 1))
    joint[:n, :n], joint[:n, n] = a, b
    with np.errstate(all="ignore"):
        maps = expm(joint * (held.tick * distinct)[:, None, None])
    out = np.zeros((len(held.samples), n))
    which = np.searchsorted(distinct, spans)
    recur(np.ascontiguousarray(maps[:, :n, :]), which, acting, row, out)
    return out, at_sample


def _cut(samples: Any, edges: Any, levels: Array) -> tuple[Any, Array, Any, Array]:
    """Cut the time at samples and edges.

    Returns the length of each piece, the level that acts in it and the sample at its end
    or -1; then the level that acts from each sample on.
    """
    most = len(samples) + len(edges)
    spans, row = np.zeros(most, np.int64), np.full(most, -1)
    acting, at_sample = np.zeros(most), np.zeros(len(samples))
    count, edge, now = 0, 0, samples[0]
    for k in range(len(samples)):
        while edge < len(edges) and edges[edge] <= samples[k]:
            if edges[edge] > now:
                spans[count], acting[count] = edges[edge] - now, levels[edge]
                now = edges[edge]
                if now == samples[k]:
                    row[count] = k
                count += 1
            edge += 1
        if samples[k] > now:
            spans[count], acting[count], row[count] = samples[k] - now, levels[edge], k
            now = samples[k]
            count += 1
        at_sample[k] = levels[edge]
    return spans[:count], acting[:count], row[:count], at_sample


def _recursion(maps: Array, which: Any, acting: Array, row: Any, out: Array) -> None:
    """x <- maps[which[k]] (x, acting[k]); kept in ``out[row[k]]`` unless that is -1."""
    n = maps.shape[1]
    x, new = np.zeros(n), np.zeros(n)
    for k in range(len(which)):
        m = maps[which[k]]
        for i in range(n):
            total = m[i, n] * acting[k]
            for j in range(n):
                total += m[i, j] * x[j]
            new[i] = total
        for i in range(n):
            x[i] = new[i]
        if row[k] >= 0:
            for i in range(n):
                out[row[k], i] = x[i]


@functools.cache
def _compiled() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Cut and recursion through numba; as Python they would dominate the fit."""
    from numba import njit

    compiled = njit(cache=True, error_model="numpy")
    return compiled(_cut), compiled(_recursion)
