"""A bus servo of which little is known, and goals for it."""

from __future__ import annotations

import math

import numpy as np

from servo_models.core.types import Array

BELIEVED = {
    "natural_frequency": 15.0,
    "damping_ratio": 0.24,
    "transport_delay.time": 2.5e-3,
    "speed_limit": 2.3,
}
"""Standard deviations [SI] of a bus servo that should answer within 5 ms."""
TIMES = 0.01 * np.arange(1200)
NOISE = 2e-3  # rad


def goals() -> Array:
    """Steps, then a sweep [rad]."""
    levels = np.random.default_rng(1).uniform(-0.8, 0.8, 12)
    levels[0] = 0.0
    sweep = 0.4 * np.sin(2.0 * math.pi * (0.3 * TIMES + 0.12 * TIMES**2))
    return np.where(TIMES < 6.0, np.repeat(levels, 100), sweep)
