"""What is commanded: steps of several sizes, slow triangles and a chirp, or one large step.

A command is held for one row of the log, as by a controller that logs what it commands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.withheld.generator.bench import Bench

Array = NDArray[np.float64]

LENGTH = (10.0, 20.0)
"""Of a log, in slowest time constants."""
SAMPLES = 20.0
"""Rows per fastest time constant, at the least, before a tier thins them out."""
LEVELS = (0.06, 0.14, 0.3, 0.55, 0.8, 1.0)
"""Sizes of steps, as shares of the largest."""
LEAD = 0.4
"""Rest before the first command, in slowest time constants."""


@dataclass(frozen=True)
class Plan:
    """What a log is made of.

    Attributes:
        stride: steps of the simulation per row.
        command: SI, one value per row, shape (n,).
    """

    stride: int
    command: Array


def large_step(bench: Bench, rng: np.random.Generator) -> tuple[Plan, ...]:
    """One large step, there and back."""
    stride = int(rng.choice(bench.sampling))
    count = _rows(bench, rng, stride, LENGTH)
    there = round(count * rng.uniform(0.08, 0.12))
    back = round(count * rng.uniform(0.45, 0.6))
    excursion = np.zeros(count)
    excursion[there:back] = rng.choice([-1.0, 1.0]) * rng.uniform(*bench.amplitude)
    return (_plan(bench, stride, excursion),)


def rich(bench: Bench, rng: np.random.Generator, thin: int) -> tuple[Plan, ...]:
    """Steps, triangles and a chirp in one log, or in two; ``thin`` times fewer rows."""
    amplitude = rng.uniform(*bench.amplitude)
    stride = thin * int(rng.choice(bench.sampling))
    if rng.random() < 0.7:
        first, second = (_rows(bench, rng, stride, LENGTH) for _ in range(2))
        parts = [
            [_steps(bench, rng, first, stride)],
            [
                _triangle(bench, rng, second // 2, stride),
                _chirp(bench, rng, second - second // 2, stride),
            ],
        ]
    else:
        rows = _rows(bench, rng, stride, (15.0, LENGTH[1]))
        parts = [
            [
                _steps(bench, rng, rows // 3, stride),
                _triangle(bench, rng, rows // 3, stride),
                _chirp(bench, rng, rows - 2 * (rows // 3), stride),
            ]
        ]
    return tuple(_plan(bench, stride, amplitude * np.concatenate(part)) for part in parts)


def _rows(bench: Bench, rng: np.random.Generator, stride: int, length: tuple[float, float]) -> int:
    """Rows of a log as many slowest time constants long as ``length`` allows."""
    return int(rng.uniform(*length) * bench.slowest / (stride * bench.step))


def _plan(bench: Bench, stride: int, excursion: Array) -> Plan:
    """A plan whose commands are those that its log can print."""
    numbers = (bench.rest + excursion) / bench.command.unit_size
    return Plan(stride, np.round(numbers, bench.command.digits) * bench.command.unit_size)


def _steps(bench: Bench, rng: np.random.Generator, count: int, stride: int) -> Array:
    """Rest, then every size once, in any order and direction."""
    lead = round(LEAD * bench.slowest / (stride * bench.step))
    levels = rng.permutation(LEVELS) * rng.choice([-1.0, 1.0], len(LEVELS))
    edges = np.linspace(lead, count, len(levels) + 1)
    edges[1:-1] += rng.uniform(-0.2, 0.2, len(levels) - 1) * (edges[1] - edges[0])
    which = np.searchsorted(edges, np.arange(count), side="right") - 1
    return np.where(which >= 0, levels[which], 0.0)


def _triangle(bench: Bench, rng: np.random.Generator, count: int, stride: int) -> Array:
    """Rest, then one slow and small triangle, both ways."""
    lead = round(LEAD * bench.slowest / (stride * bench.step))
    phase = np.maximum(np.arange(count) - lead, 0) / (count - lead)
    wave = 1.0 - 4.0 * np.abs(np.mod(phase + 0.25, 1.0) - 0.5)
    return np.asarray(rng.uniform(0.08, 0.25) * rng.choice([-1.0, 1.0]) * wave)


def _chirp(bench: Bench, rng: np.random.Generator, count: int, stride: int) -> Array:
    """A sine whose frequency grows in equal ratios from one and a half periods of its length."""
    seconds = count * stride * bench.step
    low, high = 1.5 / seconds, rng.uniform(*bench.chirp)
    time = np.arange(count) / count
    turns = low * seconds * ((high / low) ** time - 1.0) / np.log(high / low)
    return np.asarray(rng.uniform(0.2, 0.5) * np.sin(2.0 * np.pi * turns))
