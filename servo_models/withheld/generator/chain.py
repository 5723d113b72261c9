"""What happens to a command before it reaches the rig, and to an angle after it left it.

Both on the fine grid of the simulation; delays and frames are whole numbers of its steps.
Stages stand in the order in which a signal meets them; one that is 0 is absent.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from servo_models.withheld.generator.compiled import compiled

Array = NDArray[np.float64]


class Command(NamedTuple):
    """Stages of the command, in its own unit up to ``scale`` and that of the drive after it."""

    delay: float = 0.0  # s
    hold: float = 0.0  # s
    dead_band: float = 0.0
    scale: float = 1.0  # drive per command
    command_step: float = 0.0
    command_gain: float = 0.0
    command_offset: float = 0.0
    command_asymmetry: float = 0.0
    command_dead_zone: float = 0.0
    command_ceiling: float = 0.0
    slew: float = 0.0


class Sensor(NamedTuple):
    """Stages of the reading [rad]."""

    reading_play: float = 0.0
    reading_lag: float = 0.0
    reading_bow: float = 0.0
    reading_cubic: float = 0.0
    reading_scale: float = 1.0
    reading_gain: float = 0.0
    reading_slew: float = 0.0
    reading_offset: float = 0.0
    reading_step: float = 0.0


@compiled
def clip(value: float, limit: float) -> float:
    """A value inside +/- limit."""
    return min(max(value, -limit), limit)


@compiled
def coded(value: float, step: float) -> float:
    """A value rounded to whole codes; no step leaves it."""
    return value if step <= 0.0 else step * math.floor(value / step + 0.5)


@compiled
def travelled(command: Array, lost: Array, c: Command, h: float) -> Array:
    """Return what of a command arrives at the drive.

    Args:
        command: shape (n,), begins at rest.
        lost: 1 where a command is not received, so that the one before stays, shape (n,).
        c: stages.
        h: step [s].
    """
    late, frame = round(c.delay / h), round(c.hold / h)
    received = kept = held = command[0]
    arrived = np.empty_like(command)
    last = np.nan
    line = np.full(late + 1, command[0])
    for n in range(len(command)):
        if lost[n] == 0.0:
            received = command[n]
        line[n % (late + 1)] = received
        out = line[(n + 1) % (late + 1)]
        if frame > 0:
            if n % frame == 0:
                held = out
            out = held
        if c.dead_band > 0.0:
            if abs(out - kept) > c.dead_band:
                kept = out
            out = kept
        out = coded(out * c.scale, c.command_step)
        out = (1.0 + c.command_gain) * out + c.command_offset
        out += c.command_asymmetry * abs(out)
        out -= clip(out, c.command_dead_zone)
        if c.command_ceiling > 0.0:
            out = clip(out, c.command_ceiling)
        if c.slew > 0.0 and n > 0:
            before = last
            last += clip(out - last, c.slew * h)
            arrived[n] = 0.5 * (before + last)
        else:
            arrived[n] = last = out
    return arrived


@compiled
def read(angle: Array, s: Sensor, h: float) -> Array:
    """Return what a sensor makes of an angle [rad], shape (n,), before noise."""
    reading = np.empty_like(angle)
    output = lagged = slewed = before = 0.0
    follow = -math.expm1(-h / max(s.reading_lag, h))
    for n in range(len(angle)):
        value = angle[n]
        output += value - output - clip(value - output, s.reading_play)
        if s.reading_lag > 0.0:
            lagged += follow * (0.5 * (before + output) - lagged)
        else:
            lagged = output
        before = output
        ratio = lagged / s.reading_scale
        value = (1.0 + s.reading_gain) * lagged
        value += lagged * ratio * (s.reading_bow + s.reading_cubic * ratio)
        if s.reading_slew > 0.0:
            slewed += clip(value - slewed, s.reading_slew * h)
            value = slewed
        reading[n] = coded(value + s.reading_offset, s.reading_step)
    return reading
