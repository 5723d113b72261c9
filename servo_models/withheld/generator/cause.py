"""What a cause of a gap is: quantities with ranges, one of which is its size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from servo_models.withheld.generator.bench import Bench


@dataclass(frozen=True)
class Quantity:
    """A parameter of a cause: its name, the setting it becomes, and its range.

    Attributes:
        weak, strong: range [SI], drawn evenly on a logarithmic scale, or a linear one where
            ``weak`` is not above 0; a cause grows from ``weak`` to ``strong``.
        unit: name of the factor from SI to the setting, see ``Bench.units``.
        signed: either sign.
        grid: a time in whole steps of the simulation.
    """

    name: str
    setting: str
    weak: float
    strong: float
    unit: str = "1"
    signed: bool = False
    grid: bool = False

    @property
    def decades(self) -> float:
        """Natural logarithm of the range."""
        return abs(math.log(self.strong / self.weak))

    def at(self, share: float) -> float:
        """Return the value at a share of the range, 0 to 1."""
        if self.weak <= 0.0:
            return self.weak + share * (self.strong - self.weak)
        return self.weak * math.pow(self.strong / self.weak, share)


@dataclass(frozen=True)
class Cause:
    """One thing that a model leaves out; ``size`` makes it large or small, ``others`` shape it."""

    name: str
    size: Quantity
    others: tuple[Quantity, ...] = ()


@dataclass(frozen=True)
class Drawn:
    """A cause with its sign and shape drawn, its size open."""

    cause: Cause
    sign: float
    others: Mapping[str, float]

    def values(self, share: float, step: float) -> dict[str, float]:
        """Return its parameters [SI] by name, sized at ``share`` of the range."""
        size = self.cause.size
        value = self.sign * size.at(share)
        if size.grid:
            value = max(1, round(value / step)) * step
        return {size.name: value, **self.others}

    def settings(self, share: float, bench: Bench, units: Mapping[str, float]) -> dict[str, float]:
        """Return what the simulation takes."""
        values = self.values(share, bench.step)
        every = (self.cause.size, *self.cause.others)
        return {q.setting: values[q.name] * units[q.unit] for q in every}


def draw(cause: Cause, rng: np.random.Generator) -> Drawn:
    """Draw the sign and the shape of a cause."""
    sign = float(rng.choice([-1.0, 1.0])) if cause.size.signed else 1.0
    return Drawn(cause, sign, {q.name: q.at(float(rng.random())) for q in cause.others})
