"""The claim *model*: responses against independent references."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from servo_models.analysis.compare import StepMetrics, max_error, nrmse, step_metrics, tube
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.validation.cases import Case
from servo_models.validation.rows import MODEL, Row, judged

Run = Callable[[Model, Array, Array], Array]
"""``run(model, times, inputs)`` gives the outputs, as ``Model.run`` does."""

TIME_MARGIN = 10.0
"""A time is read off a curve: its error is that of the curve over its slope, which is a
tenth of the mean slope of the rise at the flattest place where a time is read."""


def response_rows(case: Case, model: Model, run: Run, subject: str = "") -> list[Row]:
    """Run a case and judge it.

    Args:
        case: see ``cases``.
        model: with the parameters of the case.
        run: how; the model in this process or an FMU.
        subject: name of the FMU that is run, "" in this process.
    """
    columns = input_columns(case, model)
    out = run(model, case.times, columns)
    got = {name: out[:, k] for k, name in enumerate(model.plant.outputs)}
    width = model.values["internal_step"]
    fine, expected = _reference(case, model, columns, width)
    rows_of_case = np.searchsorted(fine, case.times)
    where = (case.actuator, case.variant, case.name)
    note = f"reference: {case.method}"
    flags = {wire.name for wire in model.plant.wire.values() if wire.flag}
    rows: list[Row] = []
    outside = 0.0
    for name, curve in expected.items():
        bar, at_rows = case.bar(name), curve[rows_of_case]
        scale = float(np.max(np.abs(curve)))
        amplitude = 0.0 if name in flags else bar * scale
        outside += tube(fine, curve, got[name], width, amplitude, case.times).outside_share
        if name not in flags:
            error = max_error(at_rows, got[name])
            rows.append(
                judged(MODEL, where, f"{name}: largest error", error, bar, "1", note, subject)
            )
    main = case.main
    error = nrmse(expected[main][rows_of_case], got[main])
    rows.append(judged(MODEL, where, f"{main}: NRMSE", error, case.bar(main), "1", note, subject))
    rows.append(judged(MODEL, where, "points outside the tube", outside, 0.0, "1", note, subject))
    if case.is_step:
        reference = step_metrics(case.times, expected[main][rows_of_case])
        measured = step_metrics(case.times, got[main], final=reference.final)
        rows += _measures(where, main, case.bar(main), reference, measured, note, subject)
    return rows


def input_columns(case: Case, model: Model) -> Array:
    """Return the inputs of a case, shape (n, inputs), SI."""
    wires = model.plant.inputs
    values = [case.inputs.get(wire.name, float(wire.rest)) for wire in wires]
    return np.column_stack([np.broadcast_to(v, case.times.shape) for v in values]).astype(float)


def _reference(
    case: Case, model: Model, columns: Array, width: float
) -> tuple[Array, dict[str, Array]]:
    """The reference at the case's rows and ``width`` before and after each, for the tube."""
    end = case.times[-1]
    fine = np.union1d(case.times, np.clip(case.times[:, None] + [-width, width], 0.0, end))
    held = columns[np.searchsorted(case.times, fine, side="right") - 1]
    inputs = {wire.name: held[:, k] for k, wire in enumerate(model.plant.inputs)}
    return fine, case.reference(fine, inputs)


def _measures(
    where: tuple[str, str, str],
    main: str,
    bar: float,
    reference: StepMetrics,
    measured: StepMetrics,
    note: str,
    subject: str,
) -> list[Row]:
    rise = reference.rise or 0.0
    rows = []
    for name, title, limit, unit in (
        ("delay", "error of the delay (50 %)", TIME_MARGIN * bar * rise, "s"),
        ("rise", "error of the rise time (10 to 90 %)", TIME_MARGIN * bar * rise, "s"),
        ("overshoot", "error of the overshoot", TIME_MARGIN * bar, "1"),
        ("settling_2", "error of the settling time (2 %)", TIME_MARGIN * bar * rise, "s"),
        ("settling_5", "error of the settling time (5 %)", TIME_MARGIN * bar * rise, "s"),
    ):
        wanted, got = getattr(reference, name), getattr(measured, name)
        error = 0.0 if wanted == got else None
        if wanted is not None and got is not None:
            error = abs(got - wanted)
        stands = "never" if wanted is None else f"{wanted:.6g} {unit.replace('1', '')}".strip()
        rows.append(
            judged(
                MODEL, where, f"{main}: {title}", error, limit, unit, f"{note}, {stands}", subject
            )
        )
    return rows
