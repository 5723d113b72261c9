"""Make the logs of the papers' own gap: what their plants do, for their models to explain.

`torque_motor.csv` is the transfer function of eq. 12 with its delay, solved exactly;
`sg90.csv` the printed nonlinear servo, its switching points located.  Both come from equations
written from the papers, not from the models that are diagnosed.

Run: ``python make_logs.py [FOLDER]``
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from servo_models.validation.sg90.reference import Printed
from servo_models.validation.torque_motor.reference import Equation12

Array = NDArray[np.float64]

SEED = 7
NOISE_MOTOR = 0.002
"""Of the torque motor's angle [deg]."""
NOISE_SERVO = 0.05
"""Of the servo's angle [deg]."""


def torque_motor(rng: np.random.Generator) -> list[str]:
    """Steps of several sizes and a sweep to 300 Hz, 0.6 s at 10 kHz, below the stops."""
    times: Array = 1e-4 * np.arange(6000.0)
    sizes = np.array([0.0, 20.0, -20.0, 10.0, -5.0, 25.0])
    steps = sizes[np.minimum(times / 0.05, 5.0).astype(int)]
    since = times - 0.3
    sweep = 20.0 * np.sin(2.0 * np.pi * (5.0 * since + 0.5 * 295.0 / 0.3 * since**2))
    voltage = np.where(since < 0.0, steps, sweep)
    angle = np.degrees(Equation12()(times, {"voltage": voltage})["angle"])
    reading = angle + NOISE_MOTOR * rng.standard_normal(len(times))
    rows = zip(times, voltage, reading)
    return ["time_s,voltage_V,angle_deg", *(f"{t:.4f},{u:.6f},{a:.5f}" for t, u, a in rows)]


def sg90(rng: np.random.Generator) -> list[str]:
    """Steps of several sizes and slow triangles, 200 s at 50 Hz."""
    times: Array = 0.02 * np.arange(10000.0)
    sizes = np.array([0.0, 60.0, -60.0, 20.0, -20.0, 5.0, -5.0, 80.0, 10.0, 0.0])
    steps = sizes[np.minimum(times / 12.0, 9.0).astype(int)]
    triangle = 4.0 * np.abs(np.mod((times - 120.0) / 20.0 + 0.25, 1.0) - 0.5) - 1.0
    degrees = np.where(times < 120.0, steps, np.where(times < 160.0, 15.0, 60.0) * -triangle)
    pulse = np.round(1500.0 + 10.0 * degrees) * 1e-6
    rest = np.zeros(len(times))
    found = Printed()(
        times, {"pulse_width": pulse, "load_torque": rest, "supply_voltage": rest + 5.0}
    )
    angle = np.degrees(found["angle"]) + NOISE_SERVO * rng.standard_normal(len(times))
    rows = zip(times, 1e6 * pulse, angle)
    return ["time_s,pulse_us,angle_deg", *(f"{t:.2f},{p:.0f},{a:.3f}" for t, p, a in rows)]


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    folder.mkdir(parents=True, exist_ok=True)
    for made in (torque_motor, sg90):
        rows = made(np.random.default_rng(SEED))
        (folder / f"{made.__name__}.csv").write_text("\n".join([*rows, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
