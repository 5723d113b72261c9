"""Further sines of a ripple: their counts, and that there are no more than acted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lombscargle

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.harmonics import order_peaks, sine_powers
from servo_models.diagnosis.search.joint_fits import fit_with
from servo_models.diagnosis.search.screening import likeliest, screen
from servo_models.diagnosis.search.selection import SubsetSelection
from servo_models.identification.problem import free_parameter
from tests.support.logs import log_of

TIMES = 4e-3 * np.arange(1501)
NOISE = 1e-4  # rad
SINES = {7.0: (1e-4, 0.4), 28.0: (2e-4, -1.0), 15.0: (7e-5, 2.0)}
"""By periods in a turn: torque [N.m] and phase [rad]."""


def searched(sines: dict[float, tuple[float, float]]) -> tuple[SubsetSelection, FittedModel]:
    """A selection that has found the first sine of a motor turned slowly by its speed loop, and
    the model with it."""
    (count, (torque, phase)), *others = sines.items()
    true = {"cogging.torque": torque, "cogging.count": count, "cogging.phase": phase}
    for k, (count, (own, phase)) in enumerate(others, 2):
        more = {"share": own / torque, "count": count, "phase": phase}
        true |= {f"cogging.{key}_{k}": value for key, value in more.items()}
    command = {"speed_command": np.where(TIMES < 3.2, 1.1, -0.9)}
    run = simulate(model("dc_motor_speed", "direct", true), TIMES, command)
    noise = NOISE * np.random.default_rng(17).standard_normal(len(TIMES))
    log = log_of(TIMES, command, {"encoder_angle": run["encoder_angle"] + noise})
    plain = model("dc_motor_speed", "direct")
    nominal = {name: plain.values[name] for name in ("rotor_inertia", "speed_gain")}
    free = [
        free_parameter(plain.plant.parameters[name], value, 0.1 * value)
        for name, value in nominal.items()
    ]
    fitter = Fitter(plain, [log], tuple(free), {"encoder_angle": NOISE})
    retuned = fitter.fit((), ())
    (one,) = [it for it in candidates(plain, [log]) if it.name == "cogging"]
    results = screen((retuned.linearised,), [one])
    search = SubsetSelection(fitter, retuned, [one], results, lambda _: None)
    return search, fit_with(fitter, retuned, likeliest(results))


def counts_of(found: FittedModel) -> list[float]:
    keys = ("cogging.count", *(f"cogging.count_{k}" for k in (2, 3, 4)))
    return [found.values[key] for key in keys if key in found.values]


@pytest.mark.thorough
@pytest.mark.parametrize("number", [1, 2, 3])
def test_as_many_sines_are_found_as_acted(number: int) -> None:
    sines = dict(list(SINES.items())[:number])
    search, first = searched(sines)
    found = search.with_harmonics(first)
    assert sorted(counts_of(found)) == pytest.approx(sorted(sines), rel=0.01)
    torque = found.values["cogging.torque"]
    sizes = [torque, *(torque * v for key, v in found.values.items() if ".share" in key)]
    by_count = dict(zip(counts_of(found), sizes))
    for count, size in by_count.items():
        nearest = min(sines, key=lambda it: abs(it - count))
        assert size == pytest.approx(sines[nearest][0], rel=0.15)
    assert found.evidence.rms < 1.1


def test_the_spectrum_over_the_angle_has_a_peak_at_each_count() -> None:
    """However the speed changes: over time each sine would have two frequencies."""
    search, _ = searched(SINES)
    (one,), fitter = search.every, search.fitter
    nominal = fitter.at_values((), (), {it.name: it.nominal for it in fitter.nominal})
    peaks = order_peaks(nominal, one)[: len(SINES)]
    travelled = 3.5  # rad
    assert sorted(peaks) == pytest.approx(sorted(SINES), abs=1.0 / travelled)


def test_the_power_of_sines_is_that_of_lomb_and_scargle() -> None:
    random = np.random.default_rng(9)
    angle, counts = np.sort(random.uniform(0.0, 7.0, 300)), np.linspace(0.5, 40.0, 80)
    values = np.sin(11.0 * angle) + random.standard_normal(300)
    expected = lombscargle(angle, values, counts)
    np.testing.assert_allclose(sine_powers(angle, values, counts), expected, rtol=1e-9)


def test_a_spectrum_without_any_count_has_no_peak() -> None:
    """A motor that travels far between two samples: no period of a ripple has samples enough."""
    search, first = searched(dict(list(SINES.items())[:1]))
    (ripple,) = search.every
    far = replace(ripple, free=tuple(replace(free, high=0.5) for free in ripple.free))
    assert order_peaks(first, far) == []
