"""Fit the native parameters of a law to what the diagnosed model does."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from servo_models.analysis.statistics import rms
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.simulators.servo import Run
from servo_models.simulators.simulator import DELAY, Field, Motion, Simulator

FREQUENCIES = np.geomspace(2.0, 300.0, 9)  # rad/s
RATIOS = (0.5, 1.0, 3.0)  # damping ratios from which searches start
DELAYS_S = (0.0, 0.01, 0.03, 0.1)  # delays from which searches start
BEST_STARTS = 3  # starts that are searched from, for each set of fields
MOST_EVALUATIONS = 60  # gradients in a search at most
DIFFERENCE = 1e-3  # relative step of a difference quotient
EARNED = 0.05  # part of the cost by which a field has to lower it, or it is left out
MOST_STEPS = 5e6  # time steps of all logs at most, minutes of work
LARGEST_ERROR = 1e6  # rad, error of a law that diverges


class Fit:
    """Errors of a law against runs, for values of its fields."""

    def __init__(self, simulator: Simulator, runs: Sequence[Run], step: float, inertia: float):
        self.simulator, self.runs, self.step, self.inertia = simulator, runs, step, inertia
        self.grids = [
            np.arange(0.0, run.times[-1] - run.times[0] + step, step) + run.times[0] for run in runs
        ]
        rows = [
            np.searchsorted(run.times, grid + 1e-9 * step, side="right") - 1
            for run, grid in zip(runs, self.grids)
        ]
        self.goals = [run.goal[row] for run, row in zip(runs, rows)]
        self.loads = [run.load[row] for run, row in zip(runs, rows)]

    def angles(self, values: Mapping[str, float]) -> list[Array]:
        """Return the angles [rad] of the law at the rows of each run."""
        responses = []
        for run, grid, goal, load in zip(self.runs, self.grids, self.goals, self.loads):
            late = delayed(goal, values[DELAY])
            start = float(run.angle[0])
            angle = self.simulator.angles(values, self.step, late, load, self.inertia, start)
            responses.append(np.interp(run.times, grid, angle))
        return responses

    def errors(self, values: Mapping[str, float]) -> Array:
        """Return the errors [rad] at all rows that count."""
        parts = [
            (angle - run.angle)[run.counted] for run, angle in zip(self.runs, self.angles(values))
        ]
        errors = np.concatenate(parts)
        return np.clip(np.nan_to_num(errors, nan=LARGEST_ERROR), -LARGEST_ERROR, LARGEST_ERROR)

    def cost(self, values: Mapping[str, float]) -> float:
        """Return the RMS error [rad]."""
        return rms(self.errors(values))

    def searched(self, begin: Mapping[str, float], fixed: Sequence[str] = ()) -> dict[str, float]:
        """Return the least-squares values of a search; a field that begins at 0 stays off."""
        fields = [
            field
            for field in self.simulator.fields
            if begin[field.name] != 0.0 and field.name not in (*fixed, *self.simulator.taken)
        ]
        if not fields:
            return dict(begin)
        low, high = (np.array([_coded(f, end) for f in fields]) for end in (-np.inf, np.inf))
        first = np.array([_coded(field, begin[field.name]) for field in fields])

        def values(code: Array) -> dict[str, float]:
            return {**begin, **{field.name: _decoded(field, x) for field, x in zip(fields, code)}}

        optimum = least_squares(
            lambda code: self.errors(values(code)),
            np.clip(first, low + 1e-9, high - 1e-9),
            bounds=(low, high),
            x_scale="jac",
            diff_step=DIFFERENCE,
            max_nfev=MOST_EVALUATIONS,
        )
        return values(optimum.x)


def _linear(field: Field) -> bool:
    """Whether a field is searched as it is, not by its log: a delay, or if it can be negative."""
    return field.low <= 0.0


def _coded(field: Field, value: float) -> float:
    inside = min(max(value, field.low), field.high)
    return inside if _linear(field) else float(np.log(inside))


def _decoded(field: Field, code: float) -> float:
    return float(code) if _linear(field) else float(np.exp(code))


def delayed(goal: Array, steps: float) -> Array:
    """Return a goal some time steps later, interpolated between two steps."""
    whole = int(steps)
    part = steps - whole
    late = np.concatenate([np.full(whole + 1, goal[0]), goal])
    count = len(goal)
    return np.asarray((1.0 - part) * late[1 : 1 + count] + part * late[:count])


def refitted(
    simulator: Simulator,
    runs: Sequence[Run],
    step: float,
    inertia: float,
    ours: Mapping[str, float],
) -> tuple[dict[str, float], Fit]:
    """Return the fields that fit the diagnosed model best, by name, and the fit that judged them.

    Searches start from the best of a grid of motions; then the delay is rounded, and a field that
    lowers the error by less than a twentieth is left out.  ``ours`` are parameters of the model
    [SI], of which the simulator takes some as they are.
    """
    lasts = sum(float(run.times[-1] - run.times[0]) for run in runs)
    if lasts > MOST_STEPS * step:
        raise UserError(
            f"the logs last {lasts:.3g} s, more than {MOST_STEPS:.0e} steps of {step:.3g} s: give"
            " shorter ones, or a longer --time-step"
        )
    fit = Fit(simulator, runs, step, inertia)
    speed = max(
        float(np.max(np.abs(np.diff(run.angle) / np.diff(run.times)), initial=1e-3)) for run in runs
    )
    taken = {name: ours.get(parameter, 0.0) for name, parameter in simulator.taken.items()}
    guesses = [
        {**start, **taken}
        for frequency, ratio, delay in itertools.product(FREQUENCIES, RATIOS, DELAYS_S)
        for start in simulator.starts(Motion(frequency, ratio, speed, inertia, delay / step + 0.5))
    ]
    best: list[dict[str, float]] = []
    for shape in {tuple(name for name, value in it.items() if value) for it in guesses}:
        alike = [it for it in guesses if tuple(n for n, value in it.items() if value) == shape]
        best += sorted(alike, key=fit.cost)[:BEST_STARTS]
    values = min((fit.searched(begin) for begin in best), key=fit.cost)
    values = _whole(fit, values)
    return _simplified(fit, values), fit


def _whole(fit: Fit, values: Mapping[str, float]) -> dict[str, float]:
    """Values with a delay of whole steps, the better of the two neighbours."""
    ends = {float(np.floor(values[DELAY])), float(np.ceil(values[DELAY]))}
    tried = [fit.searched({**values, DELAY: end}, (DELAY,)) for end in sorted(ends)]
    return min(tried, key=fit.cost)


def _simplified(fit: Fit, values: dict[str, float]) -> dict[str, float]:
    """Values without the fields that hardly lower the error; a delay may replace one."""
    for field in fit.simulator.fields:
        if field.optional and values[field.name] != 0.0 and field.name not in fit.simulator.taken:
            without = {**values, field.name: 0.0}
            if field.name != DELAY:
                without = _whole(fit, fit.searched({**without, DELAY: values[DELAY] + 0.5}))
            if fit.cost(without) <= (1.0 + EARNED) * fit.cost(values):
                values = without
    return values
