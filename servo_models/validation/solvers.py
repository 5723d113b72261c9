"""Independent references: the physics of the papers written a second time, on purpose.

The references themselves are those of each actuator, ``validation/<actuator>/reference.py``; here
is what solves them.  None of them uses a block, an actuator or the stepper.  Every right-hand side
and every number is taken from the papers again, in the paper's own units, and solved by other
means: the matrix exponential for linear sets, ``scipy.integrate.solve_ivp`` with located events for
the others.  An error would have to be made twice, in two forms, to pass unseen.  The rigs of
``withheld/generator`` are a third form, of other laws.

A reference is called with times [s] of shape (n,) and input columns of shape (n,) in SI,
held from their row on, and returns output columns of shape (n,) in SI: the values at the
end of the step that led to each row.

Sources: matrix exponential: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed.,
sec. 4.3.3; events: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.5 and
II.6; sliding: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994), sec. 3; play:
Nordin, Gutman, Automatica 38 (2002) 1633.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array

Edges = list[tuple[float, float]]  # (time [s], value that begins there), in order of time
Segment = tuple[float, float, tuple[float, ...]]  # begin [s], end [s], signals between

SAME_TIME = 1e-9  # distance [s] below which instants are one: sums of steps are rounded


def changes(times: Array, values: Array, delay: float = 0.0, rest: float = 0.0) -> Edges:
    """Return the edges of a held column, ``delay`` [s] later and at ``rest`` before."""
    kept = [k for k in range(len(values)) if k == 0 or values[k] != values[k - 1]]
    edges = [(float(times[k]) + delay, float(values[k])) for k in kept]
    return edges if delay == 0.0 else [(float(times[0]), rest), *edges]


def sampled(edges: Edges, period: float, end: float) -> Edges:
    """Return the edges as seen by a sampler with ticks at k ``period`` [s] from time 0."""
    seen: Edges = []
    for k in range(math.floor(end / period + SAME_TIME) + 1):
        tick = k * period
        value = value_at(edges, tick)
        if not seen or value != seen[-1][1]:
            seen.append((tick, value))
    return seen


def segments(signals: Sequence[Edges], end: float) -> list[Segment]:
    """Return the spans up to ``end`` [s] in which no signal changes."""
    starts = sorted(time for edges in signals for time, _ in edges if time < end)
    cuts = [t for k, t in enumerate(starts) if k == 0 or t > starts[k - 1] + SAME_TIME]
    spans = zip(cuts, [*cuts[1:], end])
    return [
        (begin, stop, tuple(value_at(edges, begin) for edges in signals)) for begin, stop in spans
    ]


def rows_in(times: Array, begin: float, end: float, first: bool) -> NDArray[np.intp]:
    """Return the rows in (begin, end]; the first segment also has the row at its begin."""
    low = begin - SAME_TIME if first else begin + SAME_TIME
    return np.flatnonzero((times > low) & (times <= end + SAME_TIME))


def value_at(edges: Edges, time: float) -> float:
    """Return the value that holds from ``time`` [s] on."""
    return edges[bisect.bisect_right(edges, time + SAME_TIME, key=lambda edge: edge[0]) - 1][1]


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
        """Make a system from nested rows of numbers."""
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
        return np.asarray(expm(joint)[:n])


Key = Hashable
Values = tuple[float, ...]

RELATIVE = 1e-11  # tolerance of ``solve_ivp``; the absolute one is relative to full scale
HAIR = 1e-12
"""Fraction of full scale by which a margin has to be negative before its regime ends, so that
rounding does not end a regime that begins with a margin of 0."""


@dataclass(frozen=True)
class Exit:
    """A way out of a regime, taken when ``margin(x)`` falls below 0 by a hair of ``scale``.

    ``land(x)`` gives the next regime and state.
    """

    margin: Callable[[Array], float]
    scale: float
    land: Callable[[Array], tuple[Key, Array]]


@dataclass(frozen=True)
class Regime:
    """A smooth right-hand side and its ways out."""

    rates: Callable[[Array], Sequence[float] | Array]
    exits: tuple[Exit, ...] = ()


class Switching(Protocol):
    """A system that ``follow`` integrates; ``u`` are the inputs held at present."""

    @property
    def start(self) -> Sequence[float]:
        """State at rest."""

    @property
    def scale(self) -> Sequence[float]:
        """Full scale of each state, to which the absolute tolerance is relative."""

    @property
    def longest_step(self) -> float:
        """Time [s] within which no margin falls and rises again unseen."""

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """Choose the regime, and put the state into it, when the inputs have changed."""

    def regime(self, key: Key, u: Values) -> Regime:
        """Return the regime of that key."""

    def outputs(self, key: Key, x: Array, u: Values) -> Sequence[float]:
        """Return the outputs."""


def follow(system: Switching, times: Array, signals: Sequence[Edges]) -> Array:
    """Return the outputs, shape (len(times), p), from rest, for inputs given as edges."""
    out: list[Sequence[float]] = [()] * len(times)
    x = np.array(system.start, dtype=float)
    for k, (begin, end, u) in enumerate(segments(signals, float(times[-1]))):
        rows = rows_in(times, begin, end, first=k == 0)
        key, x = system.enter(x, u)
        now = begin
        while True:
            until, dense, land = _run_regime(system, system.regime(key, u), x, now, end)
            for row in rows[(times[rows] <= until) | (until >= end)]:
                out[row] = system.outputs(key, dense(min(max(times[row], now), until)), u)
            rows = rows[(times[rows] > until) & (until < end)]
            x, now = dense(until), until
            if land is None:
                break
            key, x = land(x)
    return np.array(out, dtype=float)


def _run_regime(system: Switching, regime: Regime, x: Array, now: float, end: float) -> Any:
    """Integrate to the first exit or to ``end``: time reached, dense output, its landing."""
    from scipy.integrate import solve_ivp

    solution = solve_ivp(
        lambda t, x: regime.rates(x),
        (now, end),
        x,
        method="DOP853",
        rtol=RELATIVE,
        atol=RELATIVE * np.array(system.scale),
        max_step=system.longest_step,
        dense_output=True,
        events=[_event(way) for way in regime.exits] or None,
    )
    hits = [k for k in range(len(regime.exits)) if len(solution.t_events[k])]
    land = regime.exits[hits[0]].land if hits else None
    return float(solution.t[-1]), solution.sol, land


def _event(way: Exit) -> Callable[[float, Array], float]:
    def event(t: float, x: Array) -> float:
        return way.margin(x) + HAIR * way.scale

    event.terminal = True  # type: ignore[attr-defined]
    event.direction = -1.0  # type: ignore[attr-defined]
    return event


@dataclass(frozen=True)
class Play:
    """x' = A x + B u, y = C x + D u with a play of +/- ``half_width`` before the output.

    The last state is the output's position.  It is still, or moves as fast as the shaft.

    Attributes:
        a, b, c, d: matrices; the last rows of ``a`` and ``b`` are 0.
        shaft: index of the shaft's position, in the unit of ``half_width``.
        turning: row that gives the shaft's speed from x.
        half_width: of the play.
        scale: full scale of each state.
        longest_step: see ``switching.Switching``.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    shaft: int
    turning: Array
    half_width: float
    scale: Sequence[float]
    longest_step: float

    @property
    def start(self) -> Sequence[float]:
        """Shaft and output rest in the middle."""
        return [0.0] * len(self.a)

    def speed(self, x: Array) -> float:
        """Speed of the shaft."""
        return float(self.turning @ x)

    def lead(self, x: Array) -> float:
        """Lead of the shaft over the output, at most ``half_width`` either way."""
        return float(x[self.shaft] - x[-1])

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """Keys: up and down while the shaft pushes, free between."""
        touching = self.half_width * (1.0 - 1e-9)
        if self.lead(x) >= touching and self.speed(x) > 0.0:
            return "up", x
        if self.lead(x) <= -touching and self.speed(x) < 0.0:
            return "down", x
        return "free", x

    def regime(self, key: Key, u: Values) -> Regime:
        """Pushing until the shaft turns back, or free until it has crossed the play."""
        drive = self.b @ np.array(u)

        def rates(x: Array) -> Array:
            moved: Array = self.a @ x + drive
            moved[-1] = 0.0 if key == "free" else self.speed(x)
            return moved

        if key == "free":
            width, scale = self.half_width, self.scale[-1]
            ahead = Exit(lambda x: width - self.lead(x), scale, lambda x: ("up", x))
            behind = Exit(lambda x: width + self.lead(x), scale, lambda x: ("down", x))
            return Regime(rates, (ahead, behind))
        sign = 1.0 if key == "up" else -1.0
        fastest = float(np.abs(self.turning) @ np.array(self.scale))
        return Regime(
            rates, (Exit(lambda x: sign * self.speed(x), fastest, lambda x: ("free", x)),)
        )

    def outputs(self, key: Key, x: Array, u: Values) -> Sequence[float]:
        """C x + D u, then the output's speed."""
        rate = 0.0 if key == "free" else self.speed(x)
        return [*(self.c @ x + self.d @ np.array(u)), rate]


@dataclass(frozen=True)
class Sliding:
    """A mass [kg] with viscous [N s/m] and Coulomb friction [N], or the same in rotation."""

    mass: float
    viscous: float
    coulomb: float

    def after(self, x: float, v: float, force: float, time: float) -> tuple[float, float]:
        """Position and speed after ``time`` [s] under a constant ``force`` [N]."""
        while time > 0.0:
            if v == 0.0 and abs(force) <= self.coulomb:
                break
            way = math.copysign(1.0, v if v != 0.0 else force)
            rest = force - way * self.coulomb
            ends, moved = self._free(v, rest, time)
            if way * ends >= 0.0:
                return x + moved, ends
            stops = self._stop(v, rest)
            x, v, time = x + self._free(v, rest, stops)[1], 0.0, time - stops
        return x, v

    def _free(self, v: float, force: float, time: float) -> tuple[float, float]:
        """Speed and travel after ``time`` [s] without a reversal."""
        if self.viscous == 0.0:
            ends = v + force / self.mass * time
            return ends, 0.5 * (v + ends) * time
        slow, final = self.mass / self.viscous, force / self.viscous
        ends = final + (v - final) * math.exp(-time / slow)
        return ends, final * time + slow * (v - ends)

    def _stop(self, v: float, force: float) -> float:
        """Time [s] from speed ``v`` to standstill."""
        if self.viscous == 0.0:
            return -self.mass * v / force
        return self.mass / self.viscous * math.log1p(-self.viscous * v / force)
