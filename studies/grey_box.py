"""Do the grey box's 95 % intervals cover the truth as often as they say?

Each rig is a torque motor whose constants are scattered about the paper's, recorded in noise:
voltage steps and a sine sweep in time.  The third order with delay is fitted to the records,
and its coefficients become physical constants with standard errors.  The table gives the shares of
rigs in which value +- 1.96 standard errors holds the true constant, with R, J and K_s known
exactly and known to 1 %.

Run: ``python -m studies grey_box [--rigs 300] [--seed 30000]`` (about seven minutes);
it prints the table of ``docs/studies/grey_box.md``.  Seeds below 20000 and from 100000 on
were used to develop.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import chirp, lfilter
from scipy.stats import binomtest

from servo_models import model, simulate
from servo_models.actuators.torque_motor.variants import GREY_BOX
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.identification.grey_box import physical_constants
from servo_models.identification.transfer.functions import Structure
from servo_models.identification.transfer.identify import identify_transfer

SCATTER = {
    "torque_constant": 0.15,
    "inductance": 0.15,
    "back_emf_constant": 0.3,
    "friction_coefficient": 0.2,
    "resistance": 0.01,
    "rotor_inertia": 0.01,
    "stiffness": 0.01,
}
"""Relative standard deviations of the rigs' constants."""
NOMINAL = model("torque_motor", "identified", {"end_stops.half_range": 0.0})
KNOWN_TO = 0.01
COLOUR = 0.9  # correlation of neighbouring samples of coloured noise


@dataclass(frozen=True)
class Rig:
    """True constants by name [SI], and the records of one rig."""

    truth: dict[str, float]
    logs: tuple[Log, ...]


def rig(seed: int, coloured: bool) -> Rig:
    """Make a rig: 5 or 10 kHz, delay 0.5 to 2 ms, noise of 0.1 to 1 mrad."""
    rng = np.random.default_rng(seed)
    truth = {n: NOMINAL.values[n] * np.exp(s * rng.standard_normal()) for n, s in SCATTER.items()}
    truth["transport_delay.time"] = rng.uniform(0.5e-3, 2e-3)
    chosen = model("torque_motor", "identified", {"end_stops.half_range": 0.0, **truth})
    rate = rng.choice([5e3, 1e4])
    noise = 10.0 ** rng.uniform(-4.0, -3.0)
    steps = np.arange(0.0, 0.3, 1.0 / rate)
    sweep = np.arange(0.0, 1.0, 1.0 / rate)
    voltages = {
        "steps": (steps, np.where(steps < 0.01, 0.0, np.where(steps < 0.15, 25.0, -15.0))),
        "sweep": (sweep, 20.0 * chirp(sweep, 2.0, 1.0, 400.0, method="logarithmic")),
    }
    logs = []
    for name, (times, voltage) in voltages.items():
        white = noise * rng.standard_normal(len(times))
        error = lfilter([np.sqrt(1.0 - COLOUR**2)], [1.0, -COLOUR], white) if coloured else white
        angle = simulate(chosen, times, {"voltage": voltage})["angle"] + error + 2e-3
        logs.append(log(name, times, voltage, angle))
    return Rig(truth, tuple(logs))


def log(name: str, times: Array, voltage: Array, angle: Array) -> Log:
    """A record of voltage [V] and angle [rad]."""
    return Log(
        name=name,
        path=Path(f"{name}.csv"),
        sha256="",
        times=times,
        inputs={"voltage": voltage},
        outputs={"angle": angle},
        channels={},
        rows=np.arange(len(times)),
        held_out=np.zeros(len(times), dtype=bool),
    )


def deviations(one: Rig) -> dict[tuple[str, bool], tuple[float, float, float]]:
    """Fit a rig and compare it with the truth.

    Returns error over standard error, relative standard error, and 1 if the constant is called
    not determined; by constant and whether R, J, K_s were known exactly.
    """
    result = identify_transfer(one.logs, model=NOMINAL, structures=[Structure(3, 0, True)])
    found = {}
    nominal = {name: NOMINAL.values[name] for name in GREY_BOX.known}
    errors = {name: KNOWN_TO * value for name, value in nominal.items()}
    for exact, known in ((True, one.truth), (False, nominal)):
        spread = {} if exact else errors
        found_constants = physical_constants(
            GREY_BOX, result.chosen.function.coefficients, known, result.chosen.covariance, spread
        )
        for name, constant in found_constants.constants.items():
            if name == GREY_BOX.delay and not exact:
                continue  # R, J and K_s have no part in it
            error, truth = constant.standard_error, one.truth[name]
            assert error
            score = (constant.value - truth) / error
            found[name, exact] = score, error / abs(truth), float(not constant.determined)
    return found


def study(rigs: int, seed: int, coloured: bool) -> list[str]:
    """Return lines of a table in Markdown."""
    every = [deviations(rig(seed + k, coloured)) for k in range(rigs)]
    lines = []
    for name, exact in every[0]:
        scores, sizes, vague = np.array([one[name, exact] for one in every]).T
        inside = int(np.sum(np.abs(scores) < 1.96))
        bounds = binomtest(inside, rigs).proportion_ci()
        lines.append(
            f"| {'coloured' if coloured else 'white'} | {'exactly' if exact else 'to 1 %'} |"
            f" {name} | {100.0 * np.median(sizes):.2g} % | {100.0 * inside / rigs:.1f} % |"
            f" {100.0 * bounds.low:.1f} to {100.0 * bounds.high:.1f} % |"
            f" {100.0 * np.mean(vague):.0f} % |"
        )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=30000)
    given = parser.parse_args()
    columns = (
        "noise",
        "R, J, K_s known",
        "constant",
        "median standard error",
        "covered",
        "95 % bounds of that",
        "called not determined",
    )
    print(f"| {' | '.join(columns)} |")
    print("|---" * len(columns) + "|")
    for coloured in (False, True):
        for line in study(given.rigs, given.seed + 10000 * coloured, coloured):
            print(line)


if __name__ == "__main__":
    main()
