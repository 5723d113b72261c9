"""Bounds of parameters and of wires, and what is said of a value that is outside."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from servo_models.recording import Array, Mask
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


def outside(kind: str, name: str, value: float, bounds: Bounded) -> str:
    """Sentence about a value [SI] out of bounds, in the unit that a person reads it in."""
    unit = bounds.display or bounds.unit
    scale = factor(bounds.unit, unit)
    low, high = (math.nan if b is None else b * scale for b in (bounds.low, bounds.high))
    return (
        f"{kind} '{name}' = {value * scale:g} {unit} is outside [{low:g}, {high:g}] {unit}:"
        " choose a value inside"
    )
