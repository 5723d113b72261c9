"""Commands that an experiment may play, each a shape over time with a middle, a size and a pace.

Source: Ljung, System Identification, 2nd ed., sec. 13.3 (sweeps and random binary signals).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from servo_models.analysis.experiment import display, in_time
from servo_models.core.plant import Wire
from servo_models.core.types import Array

SMALLEST = 0.02  # least step of a ladder over its largest


@dataclass(frozen=True)
class Command:
    """A command within its limits.

    Attributes:
        family: name in ``FAMILIES``.
        middle, size: [SI of the input]; it stays within middle +- size.
        pace: [s], what it means is up to the family.
        seed: seed of what is random in it.
    """

    family: str
    middle: float
    size: float
    pace: float
    seed: int

    def values(self, times: Array) -> Array:
        """The command [SI] at ``times`` [s] from 0, shape (n,)."""
        random = np.random.default_rng(self.seed)
        return self.middle + self.size * FAMILIES[self.family].shape(times, self.pace, random)

    def text(self, wire: Wire, duration: float) -> str:
        """Say what is played on a wire for ``duration`` [s]."""
        scale, unit = display(wire)

        def level(value: float) -> str:
            return f"{scale * value:.4g} {unit}".rstrip()

        return FAMILIES[self.family].about.format(
            middle=level(self.middle),
            low=level(self.middle - self.size),
            high=level(self.middle + self.size),
            size=level(self.size),
            least=level(SMALLEST * self.size),
            pace=in_time(self.pace),
            slow=in_time(4.0 * self.pace),
            own=f"{0.25 / self.pace:.3g} Hz",
            first=f"{1.0 / duration:.3g} Hz",
            last=f"{1.0 / self.pace:.3g} Hz",
        )

    def nearby(self, ratio: float) -> Iterator[Command]:
        """Commands of the same family that are larger, smaller, faster or slower by ``ratio``."""
        for factor in (ratio, 1.0 / ratio):
            yield replace(self, size=self.size * factor)
            yield replace(self, pace=self.pace * factor)


def _ladder(times: Array, pace: float, random: np.random.Generator) -> Array:
    """Steps to both sides and back to the middle, growing until the end."""
    count = np.floor(times / pace)
    last = max(float(count[-1]), 1.0)
    side = np.array([0.0, 1.0, 0.0, -1.0])[count.astype(int) % 4]
    return np.asarray(side * SMALLEST ** (1.0 - count / last))


def _triangle(times: Array, pace: float, random: np.random.Generator) -> Array:
    """A triangle, ``pace`` from zero to its top."""
    return np.asarray(2.0 / np.pi * np.arcsin(np.sin(0.5 * np.pi * times / pace)))


def _chirp(times: Array, pace: float, random: np.random.Generator) -> Array:
    """A sine from one period over the whole length to a last period of ``pace``."""
    length = times[-1]
    growth = np.log(max(length / pace, 1.01))
    return np.asarray(np.sin(2.0 * np.pi * np.expm1(growth * times / length) / growth))


def _random(times: Array, pace: float, random: np.random.Generator) -> Array:
    """Either limit at random, kept for ``pace``."""
    count = np.floor(times / pace).astype(int)
    return np.asarray(random.choice([-1.0, 1.0], count[-1] + 1)[count])


def _bursts(times: Array, pace: float, random: np.random.Generator) -> Array:
    """Steps back to back for the first half, then the same steps four times as far apart."""
    half = 0.5 * times[-1]
    phase = np.where(times < half, times / pace, (times - half) / (4.0 * pace))
    return np.where(np.floor(phase).astype(int) % 2 == 0, 1.0, -1.0)


@dataclass(frozen=True)
class Family:
    """A shape over time, from times [s], pace [s] and a random generator; and it in words."""

    shape: Callable[[Array, float, np.random.Generator], Array]
    about: str


FAMILIES = {
    "ladder": Family(
        _ladder,
        "steps from {middle} to both sides and back, growing from {least} to {size}, {pace} each",
    ),
    "triangle": Family(_triangle, "a triangle of {size} amplitude about {middle} at {own}"),
    "chirp": Family(
        _chirp, "a sine of {size} amplitude about {middle} that sweeps from {first} to {last}"
    ),
    "random": Family(_random, "jumps between {low} and {high} at random, every {pace} at most"),
    "bursts": Family(
        _bursts,
        "steps between {low} and {high} every {pace}, and in the second half every {slow}",
    ),
}
