"""Causes outside the catalogue, and what comes and goes by itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from servo_models.withheld.generator.cause import Cause, Quantity

Array = NDArray[np.float64]

D = math.pi / 180.0
TURN = 2.0 * math.pi
BURST = (0.4, 1.6)
"""Length of a burst, in slowest time constants of the rig."""
SPELL = 0.3
"""Length of a spell in which a command is lost or not, likewise."""


class Outside(NamedTuple):
    """What comes and goes by itself."""

    lost_share: float = 0.0
    burst: float = 0.0
    sticking: float = 0.0
    hum: float = 0.0
    hum_frequency: float = 0.0


def _causes(
    torque: float, speed: float, angle: float, hertz: float, slow: float
) -> tuple[Cause, ...]:
    """Those of a rig with this full torque [N m], speed [rad/s], angle [rad] and bandwidth [Hz].

    ``slow`` is the slew rate [rad/s] of a sensor that shows.
    """

    def part(setting: str, weak: float, strong: float, name: str = "size") -> Quantity:
        return Quantity(name, setting, weak, strong)

    mode = (
        part("mode_frequency", TURN * 0.6 * hertz, TURN * 2.5 * hertz, "frequency"),
        part("mode_damping", 0.05, 0.3, "damping"),
    )
    kink = Quantity("size", "kink_slope", 0.05 / angle, 3.0 / angle, signed=True)
    bend = Quantity("angle", "kink_angle", -0.3 * angle, 0.3 * angle)
    travel = part("bouc_travel", 0.05 * angle, 0.3 * angle, "travel")
    hum = part("hum_frequency", TURN * hertz, TURN * 2.0 * hertz, "frequency")
    square = torque / (speed * speed)
    return (
        Cause("quadratic_drag", part("quadratic_drag", 0.02 * square, 2.0 * square)),
        Cause("asymmetric_drag", part("forward_drag", 0.02 * torque / speed, torque / speed)),
        Cause("bouc_wen_hysteresis", part("bouc_torque", 0.01 * torque, 0.6 * torque), (travel,)),
        Cause("dropped_commands", part("lost_share", 0.03, 0.6)),
        Cause("gain_bursts", part("burst", 0.03, 0.8)),
        Cause("second_resonance", part("mode_share", 0.03, 1.0), mode),
        Cause("gain_kink", kink, (bend,)),
        Cause("sensor_slew", part("reading_slew", slow, 0.1 * slow)),
        Cause("intermittent_sticking", part("sticking", 0.02 * torque, 0.6 * torque)),
        Cause("hum", part("hum", 0.01 * torque, 0.4 * torque), (hum,)),
    )


FOREIGN = {
    "sg90": _causes(torque=0.18, speed=10.0, angle=70.0 * D, hertz=6.0, slow=12.0),
    "torque_motor": _causes(torque=0.04, speed=10.0, angle=2.0 * D, hertz=80.0, slow=10.0),
}


def disturbed(
    settings: Mapping[str, float], count: int, step: float, slow: float, seed: int
) -> tuple[Array, Array]:
    """Return what comes and goes during a log.

    Args:
        settings: sizes by name, see ``Outside``.
        count, step: of the simulation's grid [s].
        slow: slowest time constant [s].
        seed: the same one gives the same instants for every size.

    Returns:
        factor on the drive, sticking [N m] and torque [N m], shape (count, 3); and 1 where a
        command is lost, shape (count,).
    """
    o = Outside(**{key: settings[key] for key in Outside._fields if key in settings})
    outside, lost = np.zeros((count, 3)), np.zeros(count)
    outside[:, 0] = 1.0
    rng = np.random.default_rng(seed)
    if o.lost_share > 0.0:
        spell = round(SPELL * slow / step)
        fate = rng.random(count // spell + 1)
        lost = np.repeat((fate < o.lost_share).astype(float), spell)[:count]
    if o.burst > 0.0:
        outside[:, 0] += o.burst * _bursts(rng, count, slow / step, smooth=True)
    if o.sticking > 0.0:
        outside[:, 1] = o.sticking * np.abs(_bursts(rng, count, slow / step, smooth=False))
    if o.hum > 0.0:
        phase = o.hum_frequency * step * np.arange(count) + TURN * rng.random()
        outside[:, 2] = o.hum * np.sin(phase)
    return outside, lost


def _bursts(rng: np.random.Generator, count: int, slow: float, smooth: bool) -> Array:
    """Bursts of either sign with pauses between them, each as long as chance will have it."""
    level, at = np.zeros(count), 0
    while at < count:
        pause, length = (int(slow * rng.uniform(*BURST)) for _ in range(2))
        height = rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0])
        shape = np.sin(np.pi * (np.arange(length) + 0.5) / length) ** 2 if smooth else 1.0
        inside = level[at + pause : at + pause + length]
        inside += (height * shape)[: len(inside)] if smooth else height
        at += pause + length
    return level
