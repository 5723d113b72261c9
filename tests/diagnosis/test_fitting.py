"""Logs under several conditions: what carries over to one that was left out."""

from __future__ import annotations

from dataclasses import replace

import pytest

from servo_models.analysis.simulate import simulate
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.fitting import Fitter, conditions, leave_one_condition_out
from tests.support.diagnoses import made
from tests.support.logs import changed

RESISTANCES = (1500.0, 3600.0, 9000.0)


def under(effects: dict[str, float]) -> Fitter:
    """The rig of ``made``, driven through three resistances that its logs tell."""
    fitter, _ = made(effects)
    (log,) = fitter.logs
    noise = log.outputs["angle"] - _angle(fitter, log, {"torque_constant": 5.5, **effects})
    logs = []
    for resistance in RESISTANCES:
        values = {"torque_constant": 5.5, "resistance": resistance, **effects}
        angle = _angle(fitter, log, values) + noise
        constants = {"resistance": resistance}
        logs.append(replace(log, outputs={"angle": angle}, constants=constants))
    return replace(fitter, logs=logs)


def _angle(fitter: Fitter, log: Log, values: dict[str, float]) -> Array:
    rig = changed(fitter.model, values)
    return simulate(rig, log.times, log.inputs)["angle"]


def test_logs_are_grouped_by_what_was_constant() -> None:
    logs = under({}).logs
    assert [len(group) for group in conditions([*logs, logs[0]])] == [2, 1, 1]


def test_two_conditions_say_nothing() -> None:
    fitter = under({})
    fitter = replace(fitter, logs=fitter.logs[:2])
    assert leave_one_condition_out(fitter, fitter.fit((), ())) == 0.0


def test_the_cause_carries_over_and_what_imitates_it_does_not() -> None:
    fitter = under({"coulomb_friction.level": 2e-3})
    lost = {}
    for one in candidates(fitter.model, fitter.logs):
        if one.name in ("coulomb_friction", "viscous_friction", "hysteresis"):
            lost[one.name] = leave_one_condition_out(
                fitter, fitter.fit((one.name,), one.at(one.trial_values[0]))
            )
    truth = lost.pop("coulomb_friction")
    samples = sum(len(log.times) for log in fitter.logs)
    assert truth == pytest.approx(samples, rel=0.1)  # the noise, which is one floor
    assert all(it > 1.5 * truth for it in lost.values())
