"""The lag of a reading behind its command, found where it is known."""

from __future__ import annotations

import numpy as np
import pytest

from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.arrays import describe
from servo_models.data.lag import Lag, lags
from servo_models.data.log import Log

STEP = 0.02
TIMES = np.arange(0.0, 12.0, STEP)
BUS = model("second_order_servo", "bus")


def wave(times: Array) -> Array:
    return np.sin(1.7 * times) + 0.6 * np.sin(4.1 * times + 1.0)


def log(reading: Array, name: str = "a") -> tuple[Log, ...]:
    columns = {"time": "t", "goal": "u", "angle_reading": "y"}
    return describe(BUS, {name: {"t": TIMES, "u": wave(TIMES), "y": reading}}, columns).logs


def found(*logs: Log) -> Lag:
    (one,) = lags(logs, BUS.plant)
    return one


@pytest.mark.parametrize("late", [0.0, 0.05, 0.147, 0.4])
def test_a_delay_is_found_whatever_the_offset(late: float) -> None:
    noise = 0.01 * np.random.default_rng(2).standard_normal(len(TIMES))
    lag = found(*log(wave(TIMES - late) + 0.3 + noise))
    assert (lag.output, lag.command) == ("angle_reading", "goal")
    assert lag.explained > 0.99
    assert lag.time == pytest.approx(late, abs=3e-3)
    assert lag.rows == pytest.approx(late / STEP, abs=0.15)
    assert lag.left == pytest.approx(0.01, rel=0.15)
    assert "follows goal" in lag.sentence(BUS.plant.wire["angle_reading"])


@pytest.mark.parametrize("share", [0.9, 0.4])
def test_it_says_how_much_of_the_motion_the_lag_explains(share: float) -> None:
    """A wave that the command does not have beside one that it has, of known variances."""
    followed = wave(TIMES - 0.1)
    other = np.sin(11.0 * TIMES)
    other *= np.std(followed) * np.sqrt((1.0 - share) / share) / np.std(other)
    lag = found(*log(followed + other))
    assert lag.explained == pytest.approx(share, abs=0.05)
    sentence = lag.sentence(BUS.plant.wire["angle_reading"])
    assert f"follows goal {1e3 * lag.time:.3g} ms" in sentence
    assert f"{lag.explained:.0%} of its variance" in sentence


def test_what_does_something_else_does_not_follow() -> None:
    lag = found(*log(np.sin(11.0 * TIMES)))
    assert lag.explained < 0.0
    assert "does not follow goal" in lag.sentence(BUS.plant.wire["angle_reading"])


def test_signals_of_different_units_have_no_lag() -> None:
    motor = model("torque_motor")
    table = {"t": TIMES, "u": wave(TIMES), "y": 0.1 * wave(TIMES)}
    logs = describe(motor, {"a": table}, {"time": "t", "voltage": "u", "angle": "y"}).logs
    assert not list(lags(logs, motor.plant))
