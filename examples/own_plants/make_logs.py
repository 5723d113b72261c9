"""Logs of three rigs that are not quite their models, made without this package.

Run: ``python make_logs.py [FOLDER]``
"""

import sys
from pathlib import Path

import numpy as np

EULER = 1e-4
"""Step of the integration [s]."""


def sticking(speed, force, friction, mass):
    """Return the speed after a step under a force and dry friction."""
    if speed == 0.0 and abs(force) <= friction:
        return 0.0
    against = np.sign(speed) if speed != 0.0 else np.sign(force)
    faster = speed + EULER * (force - friction * against) / mass
    return 0.0 if speed * faster < 0.0 else faster


def servo(commands):
    """Angles [rad]: the drive has a dead zone of 0.08, and the inertia is 2.3e-3 kg m2."""
    angle = speed = 0.0
    for command in commands:
        yield angle
        drive = 6.0 * (command - angle)
        drive = np.clip(np.sign(drive) * max(abs(drive) - 0.08, 0.0), -1.0, 1.0)
        speed += EULER * (drive - speed / 8.0) / 2.3e-3
        angle += EULER * speed


def damper(torques):
    """Angles [rad]: the seal rubs with 0.12 N m, and the oil is thinner: 0.36 N m s/rad."""
    angle = speed = 0.0
    for torque in torques:
        yield angle
        speed = sticking(speed, torque - 0.36 * speed, 0.12, 0.05)
        angle += EULER * speed


def valve(pressures):
    """Positions [m]: the packing rubs with 60 N, and the spring is softer: 0.96e5 N/m."""
    pressure, position, speed = 1.5e5, 0.0, 0.0
    for command in pressures:
        yield position
        pressure += EULER * (command - pressure) / 0.04
        force = 0.01 * (pressure - 1.5e5) - 0.96e5 * position - 400.0 * speed
        speed = sticking(speed, force, 60.0, 2.0)
        position += EULER * speed


RIGS = {
    # rig; column of its input, its unit in SI, its values, how long each is held [s]
    "servo": (servo, "command_deg", np.pi / 180, [0, 10, -20, 2, 0, 3, 25, -6, -4, 15], 0.6),
    "damper": (damper, "torque_Nm", 1.0, [0, 1, 0, -0.5, 0, 0.2, 1.5, -2, -0.3, 0.6, 0, -0.4], 0.7),
    "valve": (valve, "command_bar", 1e5, [1.5, 1.9, 1.4, 1.2, 1.25, 1.6, 1.62, 2, 1.1, 1.5], 1.5),
}
READINGS = {
    # column of the output, its unit in SI, its noise
    "servo": ("reading_deg", np.pi / 180, 0.02),
    "damper": ("angle_deg", np.pi / 180, 0.1),
    "valve": ("position_mm", 1e-3, 0.005),
}
EVERY = 100
"""Steps of the integration for a row of a log."""


def main():
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    for name, (rig, given, unit, values, hold) in RIGS.items():
        measured, scale, noise = READINGS[name]
        inputs = np.repeat(np.array(values, float), round(hold / EULER))
        outputs = np.fromiter(rig(unit * inputs), float) / scale
        table = np.column_stack([EULER * np.arange(len(inputs)), inputs, outputs])[::EVERY]
        table[:, 2] += noise * np.random.default_rng(1).standard_normal(len(table))
        header = f"time_s,{given},{measured}"
        np.savetxt(folder / f"{name}.csv", table, "%.5g", ",", header=header, comments="")


if __name__ == "__main__":
    main()
