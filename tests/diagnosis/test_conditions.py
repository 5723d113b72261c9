"""Logs under several conditions: what carries over to one that was left out."""

from __future__ import annotations

from dataclasses import replace

import pytest

from servo_models.core.simulate import simulate
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.candidates import candidates
from servo_models.diagnosis.fitting.conditions import carried_over, conditions
from servo_models.diagnosis.fitting.explanation import Bench
from tests.support.diagnoses import made
from tests.support.logs import changed

RESISTANCES = (1500.0, 3600.0, 9000.0)


def under(effects: dict[str, float]) -> Bench:
    """The rig of ``made``, driven through three resistances that its logs tell."""
    bench, _ = made(effects)
    (log,) = bench.logs
    noise = log.outputs["angle"] - _angle(bench, log, {"torque_constant": 5.5, **effects})
    logs = []
    for resistance in RESISTANCES:
        values = {"torque_constant": 5.5, "resistance": resistance, **effects}
        angle = _angle(bench, log, values) + noise
        constants = {"resistance": resistance}
        logs.append(replace(log, outputs={"angle": angle}, constants=constants))
    return replace(bench, logs=logs)


def _angle(bench: Bench, log: Log, values: dict[str, float]) -> Array:
    rig = changed(bench.model, values)
    return simulate(rig, log.times, log.inputs)["angle"]


def test_logs_are_grouped_by_what_was_constant() -> None:
    logs = under({}).logs
    assert [len(group) for group in conditions([*logs, logs[0]])] == [2, 1, 1]


def test_two_conditions_say_nothing() -> None:
    bench = under({})
    bench = replace(bench, logs=bench.logs[:2])
    assert carried_over(bench, bench.fit((), ())) == 0.0


def test_the_cause_carries_over_and_what_imitates_it_does_not() -> None:
    bench = under({"coulomb_friction.level": 2e-3})
    lost = {}
    for one in candidates(bench.model, bench.logs):
        if one.name in ("coulomb_friction", "viscous_friction", "hysteresis"):
            lost[one.name] = carried_over(
                bench, bench.fit((one.name,), one.at(one.trial_values[0]))
            )
    truth = lost.pop("coulomb_friction")
    samples = sum(len(log.times) for log in bench.logs)
    assert truth == pytest.approx(samples, rel=0.1)  # the noise, which is one floor
    assert all(it > 1.5 * truth for it in lost.values())
