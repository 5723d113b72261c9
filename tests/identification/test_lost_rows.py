"""Where rows of a log are missing, when the command changed is not known, and does not matter."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.identification.fit import fit
from servo_models.identification.problem import Problem, nuisances
from servo_models.identification.resolution import with_unsure_inputs
from tests.support.logs import log_of

PERIOD, NOISE = 2e-3, 1e-3
TIMES = PERIOD * np.arange(1500)
LOST = ((200, 206), (450, 453), (700, 708), (1100, 1104))
"""First and last of the rows that are missing."""


def volts() -> Array:
    return 6.0 * np.sin(2.0 * math.pi * 1.1 * TIMES) + 3.0 * np.sin(2.0 * math.pi * 2.7 * TIMES)


def recorded(lost: tuple[tuple[int, int], ...]) -> Log:
    """A log of a DC motor in an open loop, whose angle keeps every volt that it has seen."""
    motor = model("dc_motor", "direct")
    angle = simulate(motor, TIMES, {"voltage": volts()})["encoder_angle"]
    angle = angle + NOISE * np.random.default_rng(0).standard_normal(len(TIMES))
    kept = np.ones(len(TIMES), dtype=bool)
    for first, last in lost:
        kept[first : last + 1] = False
    return log_of(TIMES[kept], {"voltage": volts()[kept]}, {"encoder_angle": angle[kept]})


def floors_left(log: Log) -> float:
    """Root mean square of the weighted errors of the true model."""
    problem = Problem(model("dc_motor", "direct"), [log], [], {"encoder_angle": NOISE})
    return float(np.sqrt(np.mean(problem.residuals(np.empty(0)) ** 2)))


def test_the_true_model_leaves_noise_where_rows_are_lost() -> None:
    log = recorded(LOST)
    (known,) = with_unsure_inputs(model("dc_motor", "direct"), [log], {}, {"encoder_angle": NOISE})
    assert floors_left(log) > 50.0
    assert floors_left(known) < 2.0


def test_a_log_that_has_lost_nothing_stays_as_it_is() -> None:
    log = recorded(())
    (known,) = with_unsure_inputs(model("dc_motor", "direct"), [log], {}, {"encoder_angle": NOISE})
    assert known is log


@pytest.mark.parametrize("seed", range(3))
def test_uneven_rows_are_none_that_are_lost(seed: int) -> None:
    """Each command is held until its next row, however long that is."""
    steps = np.random.default_rng(seed).choice((1, 2, 3), 700)
    rows = np.concatenate([[0], np.cumsum(steps)])
    rows = rows[rows < len(TIMES)]
    log = recorded(())
    uneven = log_of(
        TIMES[rows],
        {"voltage": volts()[rows]},
        {"encoder_angle": log.outputs["encoder_angle"][rows]},
    )
    (known,) = with_unsure_inputs(
        model("dc_motor", "direct"), [uneven], {}, {"encoder_angle": NOISE}
    )
    assert known.unsure is None


@pytest.mark.parametrize("seed", range(3))
def test_the_true_model_leaves_noise_where_uneven_rows_are_lost(seed: int) -> None:
    """A row every one to three periods, as its command, and a few rows that were not written."""
    motor, random = model("dc_motor", "direct"), np.random.default_rng(seed)
    rows = np.cumsum(random.choice((1, 2, 3), 740))
    rows = rows[rows < len(TIMES)]
    held = np.searchsorted(rows, np.arange(len(TIMES)), "right") - 1
    sent = np.where(held < 0, 0.0, volts()[rows[np.maximum(held, 0)]])
    angle = simulate(motor, TIMES, {"voltage": sent})["encoder_angle"]
    angle = angle + NOISE * random.standard_normal(len(TIMES))
    kept = np.delete(rows, [*range(200, 205), *range(451, 458)])
    log = log_of(TIMES[kept], {"voltage": sent[kept]}, {"encoder_angle": angle[kept]})
    (known,) = with_unsure_inputs(motor, [log], {}, {"encoder_angle": NOISE})
    assert floors_left(log) > 20.0
    assert floors_left(known) < 2.0


def test_weighted_errors_are_those_of_the_covariance() -> None:
    """r' (I + S S')^-1 r, by a solver; directions that move less than noise are left out."""
    log = recorded(LOST)
    (known,) = with_unsure_inputs(model("dc_motor", "direct"), [log], {}, {"encoder_angle": NOISE})
    assert known.unsure
    along, share = nuisances(known, (NOISE,))
    changes = known.unsure["encoder_angle"] / NOISE
    errors = np.random.default_rng(1).standard_normal(len(changes))
    left = errors - along @ (share * (along.T @ errors))
    covariance = np.eye(len(errors)) + changes @ changes.T
    assert left @ left == pytest.approx(errors @ np.linalg.solve(covariance, errors), rel=1e-3)


def test_values_are_right_though_rows_are_lost() -> None:
    """The fit that takes held commands for true ones is off by hundreds of standard errors."""
    motor = model("dc_motor", "direct")
    nominal = replace(
        motor, values={**motor.values, "resistance": 1.2 * motor.values["resistance"]}
    )
    names = ("torque_constant", "resistance")
    found = fit(nominal, [recorded(LOST)], names)
    wrong = np.abs(found.values - [motor.values[name] for name in names])
    assert np.all(wrong < 4.0 * found.standard_errors)


@pytest.mark.parametrize("jump", [1, 4, 7])
def test_a_command_that_jumps_back_within_lost_rows_leaves_noise(jump: int) -> None:
    """Its instant moves a speed in a curve: a straight line through one of them would not do."""
    motor, floor = model("dc_motor_speed", "direct"), {"encoder_speed": 0.2}
    times = 0.002 * np.arange(600)
    sent = np.where(np.arange(600) < 300 + jump, -60.0, 60.0)
    speed = simulate(motor, times, {"speed_command": sent})["encoder_speed"]
    speed = speed + 0.2 * np.random.default_rng(jump).standard_normal(600)
    kept = np.delete(np.arange(600), np.arange(300, 309))
    log = log_of(times[kept], {"speed_command": sent[kept]}, {"encoder_speed": speed[kept]})
    (known,) = with_unsure_inputs(motor, [log], {}, floor)
    left = Problem(motor, [known], [], floor).residuals(np.empty(0))
    assert np.sqrt(np.mean(left**2)) < 1.2
