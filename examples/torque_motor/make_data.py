"""Make the data of this example: a sweep and a step of a torque motor like that of eq. 12.

The equations are those of the valve paper (eqs. 3 to 7), as a transfer function with a delay,
by scipy alone: what `identify` finds can be held against ``TRUTH``.

Run: ``python make_data.py [FOLDER]``
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.signal import freqs, lsim, lti

TRUTH = {
    "torque_constant": 5.2,  # N m/A
    "back_emf_constant": 0.1,  # V s/rad
    "resistance": 3630.0,  # ohm; this and the next two are known from single measurements
    "rotor_inertia": 7.246e-7,  # kg m^2
    "stiffness": 1.1,  # N m/rad
    "inductance": 30.0,  # H
    "friction_coefficient": 2.7e-4,  # N m s/rad
    "transport_delay.time": 1.1e-3,  # s
}
NOISE = 0.01
"""Of the angle [deg] in the step, and relative in the sweep."""
SEED = 12


def transfer_function() -> tuple[list[float], list[float]]:
    """Numerator and denominator of eq. 9, angle [rad] per voltage [V]."""
    k_t, k_b, r, j, k_s, inductance, k_f, _ = TRUTH.values()
    middle = r * k_f + k_b * k_t + k_s * inductance
    return [k_t], [j * inductance, inductance * k_f + r * j, middle, r * k_s]


def sweep(rng: np.random.Generator) -> list[str]:
    """Gain and phase as an analyser gives them, 1 to 500 Hz."""
    hertz = np.round(np.geomspace(1.0, 500.0, 40), 2)
    omega = 2.0 * np.pi * hertz
    _, exact = freqs(*transfer_function(), worN=omega)
    exact = exact * np.exp(-1j * omega * TRUTH["transport_delay.time"])
    gain = np.degrees(np.abs(exact)) * (1.0 + NOISE * rng.standard_normal(len(hertz)))
    phase = np.unwrap(np.angle(exact)) + NOISE * rng.standard_normal(len(hertz))
    rows = zip(hertz, gain, np.degrees(phase))
    return ["frequency_Hz,gain_deg_per_V,phase_deg", *(f"{f},{g:.6f},{p:.2f}" for f, g, p in rows)]


def step(rng: np.random.Generator) -> list[str]:
    """A step to 25 V and one back to -10 V, at 5 kHz."""
    fine = 1e-4 * np.arange(1601)  # the steps and the delay fall on this grid
    late = fine - TRUTH["transport_delay.time"] + 1e-9
    _, angle, _ = lsim(lti(*transfer_function()), volts(late), fine, interp=False)
    times = fine[::2]
    reading = np.degrees(angle[::2]) + NOISE * rng.standard_normal(len(times))
    rows = zip(times, volts(times + 1e-9), reading)
    return ["time_s,voltage_V,angle_deg", *(f"{t:.4f},{u:g},{a:.4f}" for t, u, a in rows)]


def volts(times: np.ndarray) -> np.ndarray:
    return np.where(times < 0.01, 0.0, np.where(times < 0.09, 25.0, -10.0))


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    rng = np.random.default_rng(SEED)
    for name, rows in (("sweep.csv", sweep(rng)), ("step.csv", step(rng))):
        (folder / name).write_text("\n".join([*rows, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
