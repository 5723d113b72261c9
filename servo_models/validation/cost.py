"""Accuracy against cost: error and run time over the internal step."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.compare import max_error
from servo_models.core.simulate import Model, model
from servo_models.validation.cases import Case
from servo_models.validation.responses import input_columns
from servo_models.validation.rows import CostCurve, CostPoint

FACTORS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
"""Internal steps that are tried, in default ones, as far as the bounds allow."""
REPEATS, LONGER = 5, 10


def cost_curve(case: Case) -> CostCurve:
    """Return errors of ``case.cost`` against the reference, and run times.

    The time is the least of five runs of the compiled simulation.
    """
    chosen = model(case.actuator, case.variant, case.parameters)
    columns = input_columns(case, chosen)
    inputs = {wire.name: columns[:, k] for k, wire in enumerate(chosen.plant.inputs)}
    expected = case.reference(case.times, inputs)
    parameter = chosen.plant.parameters["internal_step"].param
    default = chosen.values["internal_step"]
    points = []
    for factor in FACTORS:
        step = factor * default
        if parameter.low <= step <= parameter.high:
            tried = model(case.actuator, case.variant, {**case.parameters, "internal_step": step})
            seconds, out = _timed(tried, case, columns)
            got = {name: out[:, k] for k, name in enumerate(tried.plant.outputs)}
            error = {name: max_error(expected[name], got[name]) for name in case.cost}
            points.append(CostPoint(step, error, seconds / float(case.times[-1])))
    return CostCurve(case.actuator, case.variant, case.name, default, tuple(points))


def _timed(
    tried: Model, case: Case, columns: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """Shortest time [s] of the case and its outputs.

    Timed is the case many times over in one run, so that what a run costs at its begin does
    not count; the first run, which may compile, is not timed.
    """
    out = tried.run(case.times, columns)
    step = case.times[1] - case.times[0]
    times = step * np.arange(LONGER * len(case.times), dtype=float)
    inputs = np.tile(columns, (LONGER, 1))
    shortest = float("inf")
    for _ in range(REPEATS):
        begun = time.perf_counter()
        tried.run(times, inputs)
        shortest = min(shortest, time.perf_counter() - begun)
    return shortest / LONGER, out
