"""A torque motor with some effects under steps and a chirp, ready to be diagnosed."""

from __future__ import annotations

import numpy as np

from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import Candidate, candidates
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.identification.problem import free_parameter
from tests.support.logs import changed, measured

FLOOR = 1e-5
PRIORS = {"torque_constant": 1.0, "friction_coefficient": 1e-4}


def made(
    effects: dict[str, float], noise: float = FLOOR, sweep: float = 500.0
) -> tuple[Fitter, dict[str, Candidate]]:
    """A torque motor with some effects, without stops, under steps and a chirp.

    ``sweep`` is half the rate [Hz/s] of the chirp.
    """
    nominal = model("torque_motor", "measured", {"end_stops.half_range": 0.0})
    times: Array = 2.5e-4 * np.arange(1200.0)
    steps = np.repeat([0.0, 12.0, 0.0, -20.0, 26.0, -26.0], 100)
    t = times[:600]
    volts = np.concatenate([steps, 15.0 * np.sin(2.0 * np.pi * (5.0 * t + sweep * t**2))])
    rig = changed(nominal, {"torque_constant": 5.5, **effects})
    log = measured(rig, times, {"voltage": volts}, {"angle": noise}, seed=3)
    parameters = nominal.plant.parameters
    free = tuple(
        free_parameter(parameters[name], nominal.values[name], prior)
        for name, prior in PRIORS.items()
    )
    fitter = Fitter(nominal, [log], free, {"angle": noise})
    return fitter, {one.name: one for one in candidates(nominal, [log])}


HOLD = "sample_hold"


def with_hold(truth: dict[str, float], period: float) -> FittedModel:
    """A rig, and what a hold of this period would explain of it."""
    fitter, every = made(truth, 2e-5)
    return fitter.at_values((HOLD,), every[HOLD].free, _values(period))


def _values(period: float) -> dict[str, float]:
    nominal = {"torque_constant": 5.5, "friction_coefficient": made({})[0].nominal[1].nominal}
    return {**nominal, f"{HOLD}.period": period, f"{HOLD}.jitter": 0.0}
