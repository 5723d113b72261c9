"""Laws of signals that every simulated rig has, whatever moves it.

What is compiled here is part of its callers' compiled code, which numba keeps beside their files:
after a change remove these (``__pycache__``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

F = TypeVar("F", bound=Callable[..., Any])
Array = NDArray[np.float64]

CODE = 2.0 * math.pi / 4096.0  # angle [rad] of a code of a 12 bit encoder


def compiled(function: F) -> F:
    """Compile with numba, and keep what was compiled beside the file."""
    return cast(F, njit(cache=True, error_model="numpy")(function))


@compiled
def clip(value: float, limit: float) -> float:
    """A value inside +/- limit."""
    return min(max(value, -limit), limit)


@compiled
def dead(value: float, half: float) -> float:
    """What of a value is beyond +/- half."""
    return value - clip(value, half)


@compiled
def code_of(value: float, step: float, noise: float = 0.0) -> int:
    """The nearest whole code of a value; ``noise`` [codes] comes before it counts."""
    return math.floor(value / step + noise + 0.5)


@compiled
def coded(value: float, step: float) -> float:
    """A value rounded to whole codes; a step of 0 leaves it."""
    return value if step <= 0.0 else step * code_of(value, step)


@compiled
def pressed(
    beyond: float, rate: float, stiffness: float, damping: float, scale: float = 1.0
) -> float:
    """Force of a contact, a spring and a damper in parallel that push and never pull."""
    push = scale * (stiffness * beyond + damping * rate)
    return push if push * beyond > 0.0 else 0.0


@compiled
def duty(goal: float, seen: float, stiffness: float, limit: float) -> float:
    """Duty of a firmware's position loop, which is proportional to the error [rad]."""
    return clip(stiffness * (goal - seen), limit)


def triangle(phase: Array) -> Array:
    """A triangle wave of size 1 that rises from 0, over its phase [periods]."""
    return np.asarray(1.0 - 4.0 * np.abs(np.mod(phase + 0.25, 1.0) - 0.5))


def chirp_turns(low: float, high: float, seconds: float, count: int) -> Array:
    """Phase [periods] of a chirp in ``count`` rows, whose frequency [Hz] grows in equal ratios."""
    time = np.arange(count) / count
    return np.asarray(low * seconds * ((high / low) ** time - 1.0) / np.log(high / low))
