"""Bounds of parameters and of wires, and what is said of a value that is outside."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from servo_models.core.types import Array, Mask
from servo_models.units import factor


class Bounded(Protocol):
    """A parameter or a wire: unit, unit to be read in, and bounds [SI], None for none."""

    @property
    def unit(self) -> str: ...
    @property
    def display(self) -> str | None: ...
    @property
    def low(self) -> float | None: ...
    @property
    def high(self) -> float | None: ...


def is_outside(values: Array, bounds: Bounded) -> Mask:
    """Mark values [SI] out of the bounds of a parameter or a wire; same shape as ``values``."""
    low = -math.inf if bounds.low is None else bounds.low
    high = math.inf if bounds.high is None else bounds.high
    return np.asarray((values < low) | (values > high))


def inside(value: float, bounds: Bounded) -> float:
    """Return ``value`` [SI], or the bound that it is beyond."""
    low = -math.inf if bounds.low is None else bounds.low
    high = math.inf if bounds.high is None else bounds.high
    return min(max(value, low), high)


def on_bound(value: float, bounds: Bounded) -> float:
    """Return ``value`` [SI], or the bound that it misses by rounding: 10 us are 9.99...e-6 s."""
    for bound in (bounds.low, bounds.high):
        if bound is not None and math.isclose(value, bound, rel_tol=1e-12):
            return bound
    return value


def outside(kind: str, name: str, value: float, bounds: Bounded) -> str:
    """Sentence about a value [SI] out of bounds, in the unit that a person reads it in."""
    unit = bounds.display or bounds.unit
    low, high = displayed(bounds)
    return (
        f"{kind} '{name}' = {value * factor(bounds.unit, unit):g} {unit} is outside"
        f" [{low:g}, {high:g}] {unit}: choose a value inside"
    )


def displayed(bounds: Bounded) -> tuple[float, float]:
    """Return both bounds in the unit that a person reads, NaN for none.

    A bound with more than three digits there, as 0.2 rad in degrees, becomes the nearest number
    of two digits inside: what is shown is allowed.
    """
    scale = factor(bounds.unit, bounds.display) if bounds.display else 1.0
    low = math.nan if bounds.low is None else _round(bounds.low * scale, math.ceil)
    high = math.nan if bounds.high is None else _round(bounds.high * scale, math.floor)
    return low, high


def _round(value: float, to_inside: Callable[[float], int]) -> float:
    brief = float(f"{value:.3g}")
    if math.isclose(value, brief, rel_tol=1e-9) or not math.isfinite(value):
        return brief
    place = 10.0 ** (math.floor(math.log10(abs(value))) - 1)
    return to_inside(value / place) * place
