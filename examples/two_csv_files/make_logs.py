"""Make the two logs of this example: a small servo that is not quite the SG90 of the catalogue.

The servo is simulated here by scipy, with equations written out below, and shares no code with
servo-models: what `identify` finds can be held against ``TRUTH``.  The logs have what real ones
have: noise, a reading in tenths of a degree, and a clock that does not tick quite evenly.

Run: ``python make_logs.py [FOLDER]``
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

TRUTH = {
    "motor_time_constant": 0.040,  # s
    "motor_gain": 46.0,  # rad/s of the motor per volt
    "amplifier_gain": 65.0,
    "potentiometer_gain": 1.52,  # V/rad
    "transport_delay.time": 0.022,  # s
}
GEARS, FEEDBACK, SUPPLY = 24.0, 0.1, 5.0
VOLTS_PER_SECOND = 5.0 / 0.020
"""The decoder makes 5 V of a pulse that fills the frame of 20 ms."""
REST = 1.5e-3
NOISE, QUANTUM = 0.25, 0.1
"""Of the angle [deg]."""
SEED = 7


def servo(times: Array, changes: Array, pulses: Array) -> Array:
    """Return the angle [rad] at ``times`` [s].

    ``changes`` [s] is when the pulse changes, ``pulses`` [s] the width from then on.
    """
    lag, gain, amplifier, sensor, delay = TRUTH.values()

    def rates(_: float, state: Array, pulse: float) -> list[float]:
        angle, speed = state
        wanted = amplifier * (VOLTS_PER_SECOND * (pulse - REST) - FEEDBACK * sensor * angle)
        volts = min(max(wanted, -SUPPLY), SUPPLY)
        return [speed / GEARS, (gain * volts - speed) / lag]

    angles, state = np.zeros(len(times)), np.zeros(2)
    edges = [*(changes + delay), times[-1] + 1.0]
    for begin, end, pulse in zip(edges, edges[1:], pulses):
        inside = (times >= begin) & (times < end)
        found = solve_ivp(
            rates,
            (begin, end),
            state,
            t_eval=np.append(times[inside], end),
            args=(pulse,),
            rtol=1e-9,
            atol=1e-10,
            max_step=2e-3,
        )
        angles[inside], state = found.y[0, :-1], found.y[:, -1]
    return angles


def steps(time: float) -> float:
    """Steps of many sizes, as angles by the usual 10 us per degree [us]."""
    sizes = [0, 40, -40, 10, 0, 70, -70, 5, -5, 25, -60, 0]
    return 1500.0 + 10.0 * sizes[min(int(time / 0.4), len(sizes) - 1)]


def flight(time: float) -> float:
    """What an autopilot might ask for: swings that get faster, then a few quick changes [us]."""
    if time < 3.0:
        return float(1500.0 + 250.0 * np.sin(2.0 * np.pi * (0.5 + 0.5 * time) * time))
    return 1500.0 + [0.0, 330.0, -150.0, 80.0, 0.0][min(int((time - 3.0) / 0.3), 4)]


def write(path: Path, command: Callable[[float], float], rng: np.random.Generator) -> None:
    """Write a log of 4.8 s at 100 Hz; the command changes when a row is written."""
    times = np.arange(0.0, 4.8, 0.01)
    times[1:] += rng.uniform(-5e-4, 5e-4, len(times) - 1)
    times = np.round(times, 4)
    pulses = np.array([round(command(time)) for time in times])
    angle = np.degrees(servo(times, times, 1e-6 * pulses)) + NOISE * rng.standard_normal(len(times))
    rows = zip(1e3 * times, pulses, QUANTUM * np.round(angle / QUANTUM))
    lines = [f"{time:.1f},{pulse},{reading:.1f}" for time, pulse, reading in rows]
    path.write_text("\n".join(["time_ms,pulse_us,angle_deg", *lines, ""]), encoding="utf-8")


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    rng = np.random.default_rng(SEED)
    write(folder / "steps.csv", steps, rng)
    write(folder / "flight.csv", flight, rng)


if __name__ == "__main__":
    main()
