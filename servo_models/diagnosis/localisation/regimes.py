"""The dimensions of a breakdown: into which bin each sample falls, and what the bin is called."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from servo_models.analysis.experiment import display, in_time
from servo_models.core.types import Array
from servo_models.diagnosis.localisation.breakdown import (
    Breakdown,
    Rows,
    Sums,
    grows,
    plain,
    tabulate,
)
from servo_models.diagnosis.localisation.samples import Samples

WINDOWS = 12  # windows of time, over all logs
REST = 0.01  # amplitude over the largest one up to which a command rests
AMPLITUDES = (0.03, 0.1, 0.2, 0.5, 1.0)  # upper edges of classes over the largest amplitude
SPEEDS = (0.1, 0.4, 1.0)  # upper edges of classes over the largest speed
POSITIONS = 6  # classes of position, of equal width
ROUNDING = 1e-6  # edge over the range below which it is 0: a motion hardly ends where it began
AROUND = 0.1  # window around reversals over the time between them
Edge = tuple[str, float, float]


def by_signal(samples: Samples) -> Breakdown:
    """Shares of the outputs."""
    edges = [(name, math.nan, math.nan) for name in samples.names]
    return _split(samples, "signal", "", edges, samples.output, "in ")


def by_time(samples: Samples) -> Breakdown:
    """Shares of windows of time, each log with at least one."""
    total = sum(log.duration for log in samples.logs)
    edges: list[Edge] = []
    firsts, counts = [], []
    for log in samples.logs:
        count = max(1, round(WINDOWS * log.duration / total))
        firsts.append(len(edges))
        counts.append(count)
        cuts = log.begin + np.linspace(0.0, log.duration, count + 1)
        name = f" of {log.name}" if len(samples.logs) > 1 else ""
        labels = [f"{_between(a, b, 's')}{name}" for a, b in itertools.pairwise(cuts)]
        if name and count == 1:
            labels = [log.name]
        edges += [(label, a, b) for label, a, b in zip(labels, cuts, cuts[1:])]
    durations = np.array([log.duration for log in samples.logs])
    windows = np.array(counts)[samples.log]
    within = (samples.times / durations[samples.log] * windows).astype(int)
    at = np.array(firsts)[samples.log] + np.minimum(within, windows - 1)
    return _split(samples, "time", "s", edges, at, "during ")


def by_amplitude(samples: Samples) -> Breakdown | None:
    """Shares of amplitudes of the command: half its range between two reversals of it; None
    where it rests in all logs."""
    scale, unit = display(samples.command)
    values = scale * samples.commanded
    most = values.max()
    if most == 0.0:
        return None
    cuts = [REST * most, *(_round(share * most) for share in AMPLITUDES[:-1]), math.inf]
    at = np.searchsorted(cuts, values)
    edges = [("0, held", 0.0, cuts[0])]
    edges += [(_between(a, b, unit), a, b) for a, b in itertools.pairwise(cuts)]
    return _split(samples, "command amplitude", unit, edges, at, "at command amplitude ")


def by_speed(samples: Samples) -> Breakdown:
    """Shares of speeds of the output, by direction."""
    scale, unit = display(samples.main)
    per = f"{unit}/s"
    values = scale * samples.speed
    most = float(np.quantile(np.abs(values), 0.995)) or 1.0
    cuts = [_round(share * most) for share in SPEEDS[:-1]]
    fall = np.searchsorted(cuts, np.abs(values))
    k = len(SPEEDS)
    at = np.where(values == 0.0, k, np.where(values > 0.0, k + 1 + fall, k - 1 - fall))
    bounds = [0.0, *cuts, math.inf]
    up = [(f"{_between(a, b, per)} up", a, b) for a, b in itertools.pairwise(bounds)]
    down = [(f"{_between(a, b, per)} down", -b, -a) for a, b in itertools.pairwise(bounds)]
    edges = [*down[::-1], ("standstill", 0.0, 0.0), *up]
    return _split(samples, "speed", per, edges, at, "at ")


def by_reversal(samples: Samples) -> Breakdown | None:
    """Shares of windows around reversals of motion, None where nothing turns."""
    if samples.between == 0.0:
        return None
    near = _round(AROUND * samples.between)
    at = np.where(samples.since < near, 1, np.where(samples.since < 3 * near, 2, 3))
    at = np.where((samples.until <= near) & (at == 3), 0, at)
    width, far = in_time(near), in_time(3 * near)
    edges = [
        (f"within {width} before a reversal", -near, 0.0),
        (f"within {width} after a reversal", 0.0, near),
        (f"from {width} to {far} after a reversal", near, 3 * near),
        ("far from reversals", math.nan, math.nan),
    ]
    return _split(samples, "time since a reversal", "s", edges, at, "")


def by_position(samples: Samples) -> Breakdown:
    """Shares of equal parts of the range of the output."""
    scale, unit = display(samples.main)
    values = scale * samples.position
    low, high = float(values.min()), float(values.max())
    cuts = np.linspace(low, high, POSITIONS + 1)
    cuts[np.abs(cuts) < ROUNDING * (high - low)] = 0.0
    at = np.clip(np.searchsorted(cuts, values, side="right") - 1, 0, POSITIONS - 1)
    digits = _digits(float(np.abs(cuts).max()), (high - low) / POSITIONS)
    edges = [(_between(a, b, unit, digits), a, b) for a, b in itertools.pairwise(cuts)]
    return _split(samples, "position", unit, edges, at, "at position ")


def _split(
    samples: Samples, dimension: str, unit: str, edges: Sequence[Edge], at: Rows, phrase: str
) -> Breakdown:
    k = len(edges)
    before, after = samples.before**2, samples.after**2

    def total(values: Array) -> Array:
        return np.bincount(at, values, k).astype(float)

    sums = Sums(
        total(before),
        total(after),
        total(samples.amplitude**2),
        np.bincount(at, minlength=k).astype(float),
        grows(before, after, at, samples.parts, k),
    )
    return tabulate(dimension, unit, edges, sums, phrase)


def _between(low: float, high: float, unit: str, digits: int = 3) -> str:
    if high == math.inf:
        return f"above {plain(low, digits)} {unit}".rstrip()
    return f"{plain(low, digits)} to {plain(high, digits)} {unit}".rstrip()


def _digits(largest: float, width: float) -> int:
    """Significant digits by which edges so far apart differ; three at least."""
    return 3 + (max(0, math.ceil(math.log10(largest / (10.0 * width)))) if width > 0.0 else 0)


def _round(value: float) -> float:
    """The number 1, 2 or 5 times a power of ten that is nearest."""
    power = 10.0 ** math.floor(math.log10(value))
    return float(min((1, 2, 5, 10), key=lambda m: abs(math.log(value / power / m))) * power)
