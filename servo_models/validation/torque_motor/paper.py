"""Figures of the valve paper."""

from __future__ import annotations

import cmath
import math

import numpy as np

from servo_models.actuators.torque_motor.variants import EQ_12, grey_box
from servo_models.analysis.compare import time_to
from servo_models.analysis.linear_model import transfer_function
from servo_models.analysis.linearise import linearise
from servo_models.analysis.simulate import simulate
from servo_models.analysis.sine_test import SineTest
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.validation.cases import grid
from servo_models.validation.rows import Row, figure, not_reproducible
from servo_models.validation.torque_motor import reference
from servo_models.validation.torque_motor.cases import NO_STOPS

IDENTIFIED = "identified"
DEGREE = 180.0 / math.pi
CONSTANTS = {
    "torque_constant": ("K_t", 5.23, 0.005, "N.m/A"),
    "back_emf_constant": ("K_b", 0.08, 0.005, "V.s/rad"),
    "inductance": ("L", 29.9, 0.05, "H"),
    "friction_coefficient": ("K_f", 2.7e-4, 0.05e-4, "N.m.s/rad"),
}
"""Table 2: symbol, printed value, half a unit of its last digit, unit."""


def rows() -> list[Row]:
    """Return the figures of eq. 12, Table 2, the steps and the frequency response."""
    return [*_equation_12(), _stiffness(), *_table_2(), *_steps(), *_frequencies(), *_waveforms()]


def eq_12_at(frequency: float) -> complex:
    """Angle over voltage [rad/V] of eq. 12 with its delay at ``frequency`` [Hz]."""
    s = 2j * math.pi * frequency
    gain, (_, s2, s1, s0) = reference.EQ_12
    return gain * cmath.exp(-reference.DELAY * s) / (s**3 + s2 * s**2 + s1 * s + s0)


def current_at(frequency: float) -> complex:
    """Current over voltage [A/V] at ``frequency`` [Hz], by eq. 7."""
    s, k = 2j * math.pi * frequency, reference.IDENTIFIED
    return eq_12_at(frequency) * (k.j * s**2 + k.k_f * s + k.k_s) / k.k_t


def _equation_12() -> list[Row]:
    linear = linearise(model("torque_motor", IDENTIFIED, NO_STOPS))
    system = linear.channel("voltage", "angle")
    gain, poles = transfer_function(system)
    where = ("torque_motor", IDENTIFIED, "state space of the flattened model")
    printed, (_, *coefficients) = reference.EQ_12
    note = "to 1 part in a million"
    made = [
        figure(where, "eq. 12, numerator", gain, 0.24, "rad/(V.s3)", printed=printed, note=note)
    ]
    units = ("1/s", "1/s2", "1/s3")
    for k, (want, unit) in enumerate(zip(coefficients, units)):
        quantity = f"eq. 12, coefficient of s^{2 - k}"
        made.append(
            figure(where, quantity, poles[k + 1], 1e-6 * want, unit, printed=want, note=note)
        )
    pair = max(np.linalg.eigvals(system[0]), key=lambda pole: abs(pole.imag))
    recomputed = reference.EQ_12[1][1] - 120.0
    made.append(
        not_reproducible(
            where,
            "eq. 12, factored form, s in the second factor",
            float(-2.0 * pair.real),
            "1/s",
            printed=3356.5,
            recomputed=recomputed,
            note="misprint: (s + 120)(s^2 + 372 s + 1537600) expands to the expanded form",
        )
    )
    return made


def _stiffness() -> Row:
    return not_reproducible(
        ("torque_motor", "measured", "eq. 10"),
        "stiffness K_s per degree",
        model("torque_motor", "measured").values["stiffness"] / DEGREE,
        "N.m/deg",
        printed=0.01921,
        recomputed=reference.TABLE_1.k_s / DEGREE,
        note="1.1 N m/rad is 0.01920 N m/deg: the last printed digit is off by one",
    )


def _table_2() -> list[Row]:
    where = ("torque_motor", "estimated", "eq. 12 solved for the constants")
    got = grey_box(*EQ_12)
    recomputed = {
        "torque_constant": reference.IDENTIFIED.k_t,
        "back_emf_constant": reference.IDENTIFIED.k_b,
        "inductance": reference.IDENTIFIED.l,
        "friction_coefficient": reference.IDENTIFIED.k_f,
    }
    return [
        figure(
            where,
            f"Table 2, {symbol}",
            got[name],
            within,
            unit,
            printed=printed,
            recomputed=recomputed[name],
            note="ill-conditioned" if symbol == "K_b" else "",
        )
        for name, (symbol, printed, within, unit) in CONSTANTS.items()
    ]


def _steps() -> list[Row]:
    times = grid(0.3, 1e-4)
    free = simulate(model("torque_motor", IDENTIFIED, NO_STOPS), times, {"voltage": 40.0})
    where = ("torque_motor", IDENTIFIED, "40 V step, stops off")
    step = {"voltage": np.full(len(times), 40.0), "load_torque": np.zeros(len(times))}
    exact = reference.Equation12()(times, step)["angle"]
    final = 40.0 * eq_12_at(0.0).real
    made = [
        figure(
            where,
            "resting angle",
            float(DEGREE * free["angle"][-1]),
            0.005,
            "deg",
            printed=3.0,
            recomputed=DEGREE * final,
            note="the sweep of the whole range, +/- 3 deg",
        )
    ]
    for part in (0.1, 0.632, 0.9):
        got = time_to(times, free["angle"], part, final=final)
        made.append(
            figure(
                where,
                f"time to {100.0 * part:g} %",
                got and 1e3 * got,
                0.005,
                "ms",
                recomputed=1e3 * (time_to(times, exact, part, final=final) or math.nan),
                note="not printed in the paper: eq. 12 with its delay",
            )
        )
    return [*made, *_into_the_stop(times)]


def _into_the_stop(times: Array) -> list[Row]:
    stopped = simulate(model("torque_motor", IDENTIFIED), times, {"voltage": 50.0})
    step = {"voltage": np.full(len(times), 50.0), "load_torque": np.zeros(len(times))}
    free = reference.Equation12()(times, step)["angle"]
    touch = float(times[np.argmax(stopped["at_stop"] > 0.0)])
    table_1 = model("torque_motor", "measured", NO_STOPS)
    resting = simulate(table_1, times, {"voltage": 30.0})["angle"][-1]
    k = reference.TABLE_1
    where = ("torque_motor", IDENTIFIED, "50 V step into the stop")
    return [
        figure(
            where,
            "resting angle",
            float(DEGREE * stopped["angle"][-1]),
            1e-9,
            "deg",
            printed=3.0,
            recomputed=3.0,
        ),
        figure(
            where,
            "first contact",
            1e3 * touch,
            0.1,
            "ms",
            recomputed=1e3 * (time_to(times, free, 1.0, final=reference.STOP) or math.nan),
            note="when eq. 12 reaches 3 deg; within one communication step",
        ),
        figure(
            ("torque_motor", "measured", "30 V step, stops off"),
            "static gain of Table 1",
            float(DEGREE * resting / 30.0),
            5e-5,
            "deg/V",
            recomputed=DEGREE * k.k_t / (k.r * k.k_s),
            note="eq. 9 at s = 0",
        ),
    ]


def _frequencies() -> list[Row]:
    made = []
    static = abs(eq_12_at(0.0))
    for frequency in (10.0, 50.0, 100.0, 187.8):
        where = ("torque_motor", IDENTIFIED, f"{frequency:g} Hz sine, 40 V, stops off")
        exact = eq_12_at(frequency)
        got = _gain(frequency, "angle")
        note = "not printed in the paper: eq. 12 with its delay"
        for quantity, value, want, within, unit in (
            ("gain of the angle", _decibel(got / static), _decibel(exact / static), 0.005, "dB"),
            ("phase of the angle", _degrees(got), _degrees(exact), 0.05, "deg"),
        ):
            made.append(figure(where, quantity, value, within, unit, recomputed=want, note=note))
    return made


def _waveforms() -> list[Row]:
    """Amplitudes and phases of Fig. 6: 10 Hz, 40 V peak."""
    where = ("torque_motor", IDENTIFIED, "10 Hz sine, 40 V, stops off")
    got = {"angle": _gain(10.0, "angle"), "current": _gain(10.0, "current")}
    exact = {"angle": eq_12_at(10.0), "current": current_at(10.0)}
    note = "the waveform of Fig. 6; not printed as a number"
    scale = {"angle": (40.0 * DEGREE, "deg", 0.005), "current": (4e4, "mA", 0.005)}
    made = []
    for name, (by, unit, within) in scale.items():
        peak = by * abs(got[name])
        want = by * abs(exact[name])
        made.append(
            figure(where, f"peak of the {name}", peak, within, unit, recomputed=want, note=note)
        )
    lag, want = _degrees(got["current"]), _degrees(exact["current"])
    made.append(figure(where, "phase of the current", lag, 0.05, "deg", recomputed=want, note=note))
    return made


def _gain(frequency: float, output: str) -> complex:
    """Complex gain [SI] from the voltage to an output, at 40 V peak."""
    chosen = model("torque_motor", IDENTIFIED, NO_STOPS)
    return SineTest(chosen, "voltage", output, 40.0).response(frequency)


def _decibel(gain: complex) -> float:
    return 20.0 * math.log10(abs(gain))


def _degrees(gain: complex) -> float:
    """Phase [deg], a lag of more than half a turn included."""
    return DEGREE * cmath.phase(gain) - (360.0 if gain.imag > 0.0 else 0.0)
