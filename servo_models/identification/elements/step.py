"""First order from the record of a speed step.

From any row after the step on, speed = final + (first - final) exp(-(t - t_first)/T): time
constant and final speed are found there by least squares, whenever exactly the step was.
Source: SG90 paper sec. 5.2 (model 2); Ljung, System Identification, 2nd ed., sec. 10.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import (
    Estimate,
    LeastSquares,
    at_optimum,
    combined,
    exactly,
    is_correlated,
)

LEAST_ROWS = 6
BEGUN = 0.1
"""Share of the change from which the step counts as made, where no voltage tells it."""
LEAST_SPAN = 1.0
"""Time constants that the rows must span, or the final speed is a guess."""


@dataclass(frozen=True)
class FirstOrder:
    """A motor of first order.

    Attributes:
        time_constant: [s].
        gain: change of speed per change of voltage [rad/s/V]; None without the voltage.
        correlated: residuals follow their neighbours, so that it is not quite first order.
    """

    time_constant: Estimate
    gain: Estimate | None
    correlated: bool


def first_order(times: Array, speeds: Array, voltages: Array | None = None) -> FirstOrder:
    """Estimate time constant and gain from one step, up or down.

    Args:
        times, speeds: rows [s], [rad/s], shape (n,).
        voltages: [V], shape (n,), constant but for one step; without a step in it the
            motor stood still without voltage before the record.

    Raises:
        UserError: fewer than ``LEAST_ROWS`` rows after the step, a second step, or a record
            that ends before the time constant shows.
    """
    first = _begun(speeds) if voltages is None else _stepped(voltages)
    rows = slice(first, None)
    if len(times[rows]) < LEAST_ROWS:
        raise UserError(
            f"{len(times[rows])} rows after the step: give at least {LEAST_ROWS}, until the speed"
            " settles"
        )
    fit = _exponential(times[rows] - times[first], speeds[rows])
    time_constant = fit.estimate(2)
    if time_constant.low <= 0.0 or time_constant.value * LEAST_SPAN > times[-1] - times[first]:
        raise UserError(
            "the speed does not settle as that of a first order does; record until it stays"
        )
    gain = None if voltages is None else _gain(fit, speeds[:first], voltages[0], voltages[first:])
    return FirstOrder(time_constant, gain, is_correlated(fit.residuals))


def _begun(speeds: Array) -> int:
    """First row from which the speed has covered ``BEGUN`` of its change for good."""
    change = float(speeds[-1] - speeds[0])
    before = np.flatnonzero((speeds - speeds[0]) * math.copysign(1.0, change) < BEGUN * abs(change))
    return int(before[-1]) + 1 if len(before) > 1 else 0


def _stepped(voltages: Array) -> int:
    """Row at which the voltage changes, 0 if it never does."""
    low, high = float(np.min(voltages)), float(np.max(voltages))
    above = voltages > 0.5 * (low + high)
    changes = np.flatnonzero(np.diff(above)) + 1
    if len(changes) > 1:
        raise UserError("the voltage changes more than once; cut the record to one step")
    return int(changes[0]) if len(changes) else 0


def _exponential(since: Array, speeds: Array) -> LeastSquares:
    """Fit of final speed, change to come and time constant."""
    from scipy import optimize

    def decay(unknowns: Array) -> Array:
        return np.asarray(np.exp(-since / unknowns[2]))

    def residuals(unknowns: Array) -> Array:
        return np.asarray(speeds - unknowns[0] - unknowns[1] * decay(unknowns))

    def slopes(unknowns: Array) -> Array:
        left = decay(unknowns)
        return np.column_stack(
            [np.ones(len(since)), left, unknowns[1] * left * since / unknowns[2] ** 2]
        )

    final = float(np.mean(speeds[-max(len(speeds) // 10, 1) :]))
    covered = np.abs(speeds - speeds[0]) >= (1.0 - math.exp(-1.0)) * abs(final - speeds[0])
    start = np.array([final, speeds[0] - final, max(since[np.argmax(covered)], since[1])])
    found = optimize.least_squares(
        residuals,
        start,
        lambda unknowns: -slopes(unknowns),
        bounds=([-np.inf, -np.inf, 1e-3 * since[1]], [np.inf, np.inf, 1e3 * since[-1]]),
        x_scale="jac",
        xtol=1e-12,
    ).x
    return at_optimum(found, slopes(found), residuals(found), speeds)


def _gain(fit: LeastSquares, before: Array, old: float, after: Array) -> Estimate:
    """Change of speed per change of voltage; the speed before is 0 if no row shows it."""
    size, start = float(np.mean(after)), exactly(0.0)
    if len(before):
        mean, error = float(np.mean(before)), fit.scatter / math.sqrt(len(before))
        size, start = size - old, Estimate(mean, error, mean - 2.0 * error, mean + 2.0 * error)
    if size == 0.0:
        raise UserError("the voltage is 0 throughout; leave its column out, or correct it")
    return combined((1.0 / size, fit.estimate(0)), (-1.0 / size, start))
