"""Bench tables and records of a servo whose truth is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array

K_EN = 425.64


@dataclass(frozen=True)
class Bench:
    """A motor on a bench, by pieces as in the SG90 paper's Fig. 8; the negative side second.

    ``knee``: voltages beyond which the speed is ``top``, whatever the line says.
    """

    gain: float = K_EN
    zero: tuple[float, float] = (0.6 - 106.76 / K_EN, 1.5 - 544.0 / K_EN)
    edge: tuple[float, float] = (0.5, 0.6)
    knee: tuple[float, float] = (0.6 + (670.0 - 106.76) / K_EN, 1.5)
    top: tuple[float, float] = (670.0, 544.0)
    half_width: float = 0.0

    def speed(self, voltage: float, rising: bool) -> float:
        side = 0 if voltage > 0.0 else 1
        size = abs(voltage)
        if size <= self.edge[side] + (self.half_width if rising else -self.half_width):
            return 0.0
        line = self.gain * (size - self.zero[side])
        return math.copysign(self.top[side] if size > self.knee[side] else line, voltage)

    def table(
        self, step: float, first: float, highest: float, noise: float = 0.0, seed: int = 0
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Voltages up and down again, on both sides; speeds; whether it went up."""
        up = np.arange(first, highest, step)
        side = np.concatenate([up, up[::-1]])
        rising = np.arange(len(side)) < len(up)
        voltages, rising = np.concatenate([side, -side]), np.concatenate([rising, rising])
        speeds = np.array([self.speed(float(u), bool(r)) for u, r in zip(voltages, rising)])
        chance = np.random.default_rng(seed).normal(0.0, noise, len(speeds))
        return voltages, speeds + chance * (speeds != 0.0), rising


def write(path: Path, **columns: Array) -> None:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.6g")


DESCRIPTION = """
actuator = "sg90"
variant = "printed"
[elements.potentiometer]
file = "potentiometer.csv"
angle = { column = "angle_deg", unit = "deg" }
voltage = { column = "U", unit = "V" }
[elements.amplifier]
file = "amplifier.csv"
input = "in"
output = "unloaded"
[elements.amplifier_loaded]
file = "amplifier.csv"
input = { column = "in", unit = "V" }
output = { column = "loaded", unit = "V" }
[elements.motor]
file = "motor.csv"
voltage = { column = "U_mV", unit = "mV" }
speed = { column = "n", unit = "rpm" }
[elements.motor_step]
file = "step.csv"
time = { column = "t_ms", unit = "ms" }
voltage = "U"
speed = "w"
[elements.gears]
teeth = [[8, 48], [8, 32]]
[elements.synthesis]
k_f = [0.05, 0.1]
"""


def taken_apart(folder: Path) -> Path:
    """The paper's servo, taken apart and measured; the path of its description."""
    draw = np.random.default_rng(3)
    angles, inputs = np.arange(-90.0, 91.0, 10.0), np.linspace(0.125, 0.6, 20)
    voltages = 0.025 * (angles + 95.0) + draw.normal(0.0, 0.005, len(angles))
    write(folder / "potentiometer.csv", angle_deg=angles, U=voltages)
    unloaded = -0.1 + 5.7895 * (inputs - 0.125) + draw.normal(0.0, 0.01, 20)
    loaded = -1.15 + 7.4737 * (inputs - 0.125) + draw.normal(0.0, 0.01, 20)
    columns = {"in": inputs, "unloaded": unloaded, "loaded": loaded}
    write(folder / "amplifier.csv", **columns)
    drive, speeds, _ = Bench(half_width=0.03).table(0.02, 0.013, 2.5, noise=2.0)
    write(folder / "motor.csv", U_mV=1e3 * drive, n=speeds * 30.0 / math.pi)
    times = np.arange(0.0, 6.0, 0.02)
    turned = 633.3 / 1.307 * (1.0 - np.exp(-1.307 * np.maximum(times - 0.5, 0.0)))
    step = np.where(times >= 0.5 - 1e-9, 1.0, 0.0)
    noisy = turned + draw.normal(0.0, 2.0, len(times))
    write(folder / "step.csv", t_ms=1e3 * times, U=step, w=noisy)
    (folder / "servo.toml").write_text(DESCRIPTION)
    return folder / "servo.toml"
