"""Linear systems under held inputs, solved exactly by the matrix exponential.

Source: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., sec. 4.3.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.solvers.inputs import Edges, rows_in, segments


@dataclass(frozen=True)
class LinearSystem:
    """x' = A x + B u, y = C x + D u, at rest with x = 0 and u = 0.

    Attributes:
        a, b, c, d: matrices of shapes (n, n), (n, m), (p, n), (p, m).
    """

    a: Array
    b: Array
    c: Array
    d: Array

    @classmethod
    def of(
        cls,
        a: Sequence[Sequence[float]],
        b: Sequence[Sequence[float]],
        c: Sequence[Sequence[float]],
        d: Sequence[Sequence[float]],
    ) -> LinearSystem:
        """Make a system of nested rows of numbers."""
        return cls(*(np.array(rows, dtype=float) for rows in (a, b, c, d)))

    @classmethod
    def transfer(cls, numerator: Sequence[float], denominator: Sequence[float]) -> LinearSystem:
        """Return a realisation of a transfer function, made by python-control."""
        import control

        made = control.ss(control.tf(list(numerator), list(denominator)))
        return cls(made.A, made.B, made.C, made.D)

    def response(self, times: Array, signals: Sequence[Edges]) -> Array:
        """Return the outputs, shape (len(times), p), for inputs given as edges.

        The state goes from row to row, in spans counted in picoseconds, so that a regular
        grid needs few matrix exponentials; the rounding does not add up.
        """
        out = np.empty((len(times), len(self.c)))
        maps: dict[float, Array] = {}
        now, state = float(times[0]), np.zeros(len(self.a))
        for k, (begin, end, values) in enumerate(segments(signals, float(times[-1]))):
            held = np.array(values)
            rows = rows_in(times, begin, end, first=k == 0)
            for row, instant in [*((r, min(times[r], end)) for r in rows), (None, end)]:
                span = round(float(instant) - now, 12)
                if span not in maps:
                    maps[span] = self._map(span)
                state = maps[span] @ np.concatenate([state, held])
                now += span
                if row is not None:
                    out[row] = self.c @ state + self.d @ held
        return out

    def _map(self, span: float) -> Array:
        """Matrix from state and held input to the state ``span`` [s] later."""
        from scipy.linalg import expm

        n, m = self.b.shape
        joint = np.zeros((n + m, n + m))
        joint[:n, :n], joint[:n, n:] = self.a * span, self.b * span
        found: Array = expm(joint)[:n]
        return found
