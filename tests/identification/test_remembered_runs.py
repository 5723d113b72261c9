"""Simulations that go on at once, and those that are remembered: the same as new ones, whoever
asks, and nobody's to change."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref

import numpy as np
import pytest

from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.core.workers import Workers
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.simulation import prepared
from tests.support.logs import changed, log_of

TIMES = 1e-3 * np.arange(300.0)


def log(voltage: Array) -> Log:
    return log_of(TIMES, {"voltage": voltage}, {"angle": 1e-3 * np.sin(TIMES)})


def test_what_is_remembered_is_what_a_new_run_gives() -> None:
    """Of another log, other values and another model with the same values, in any order."""
    chosen = model("torque_motor", "measured")
    logs = [log(10.0 * np.sign(np.sin(40.0 * k * TIMES))) for k in (1.0, 2.0)]
    other = changed(chosen, {"resistance": 20.0})
    asked = [
        (logs[0], chosen, {}),
        (logs[1], chosen, {}),
        (logs[0], chosen, {"resistance": 20.0}),
        (logs[0], other, {}),
        (logs[0], other, {"resistance": chosen.values["resistance"]}),
        (logs[0], chosen, {}),
    ]
    for one, from_, values in asked:
        found = prepared(from_, one).simulate(values)
        run = prepared(from_, one)
        new = changed(from_, values).run(run.times, run.inputs)
        np.testing.assert_array_equal(found, new)


def test_what_is_remembered_cannot_be_changed() -> None:
    run = prepared(model("torque_motor", "measured"), log(np.full(len(TIMES), 5.0)))
    with pytest.raises(ValueError, match="read-only"):
        run.simulate({})[0] = 1.0
    outputs = run.outputs({})
    outputs[:] = 0.0  # a copy, and the caller's own
    assert np.any(run.outputs({}))


@pytest.mark.thorough
def test_what_is_remembered_keeps_no_log_alive_and_is_not_given_to_the_next() -> None:
    """The next one may lie where the last one did."""
    chosen = model("torque_motor", "measured")
    for volts in np.linspace(1.0, 10.0, 6):
        one = log(np.full(len(TIMES), volts))
        run = prepared(chosen, one)
        np.testing.assert_array_equal(run.simulate({}), chosen.run(run.times, run.inputs))
        gone = weakref.ref(one)
        del one, run
        gc.collect()
        assert gone() is None


NESTED = """
import threading
from servo_models.core.workers import Workers
with Workers(2) as workers:
    def sums(n): return sum(workers.map(lambda k: n * k, range(5)))
    assert list(workers.map(sums, range(8))) == [10 * n for n in range(8)]
assert threading.active_count() == 1, "threads outlive their with"
assert list(workers.map(sums, range(8))) == [10 * n for n in range(8)]
"""


def test_tasks_that_have_tasks_of_their_own_do_not_wait_for_each_other() -> None:
    """In a process of its own: threads that wait for each other cannot be ended otherwise."""
    subprocess.run([sys.executable, "-c", NESTED], check=True, timeout=30)


def test_there_is_one_worker_at_least() -> None:
    with pytest.raises(UserError, match="jobs -1"):
        Workers(-1)
