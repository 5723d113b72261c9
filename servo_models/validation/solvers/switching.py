"""Systems that switch between smooth regimes, integrated with located events.

Each regime is integrated by ``scipy.integrate.solve_ivp`` (DOP853, relative tolerance
1e-11) until one of its margins falls to 0; the instant is found by root finding on the
dense output.  Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I,
II.5 (method) and II.6 (events).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.solvers.inputs import Edges, rows_in, segments

Key = Hashable
Values = tuple[float, ...]

RELATIVE = 1e-11
HAIR = 1e-12
"""Part of full scale by which a margin is overrun before it counts as fallen, so that a
regime entered with a margin of 0 is not left at once by rounding."""


@dataclass(frozen=True)
class Exit:
    """A way out of a regime, taken when ``margin(x)`` falls below 0 by a hair of ``scale``.

    ``land(x)`` is what follows.
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
    """What ``follow`` integrates; ``u`` are the inputs held at present."""

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
