"""The claim *model*: responses against independent references, blocks as plain functions, cost.

The references of ``validation/<actuator>`` judge the physics of the catalogue.  An actuator of
one's own has none; there at least what is printed and compiled of its blocks, for the simulation
and for the FMU, is judged by something that prints nothing, with each effect switched on in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from time import perf_counter

import numpy as np

from servo_models.analysis.compare import StepMetrics, max_error, nrmse, step_metrics, tube
from servo_models.catalogue import model
from servo_models.core.plant import Parameter
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.validation.cases import Case
from servo_models.validation.fmu_subject import Subject
from servo_models.validation.implementation import input_signals
from servo_models.validation.plain_integration import Course, integrate
from servo_models.validation.rows import MODEL, CostCurve, CostPoint, Row, failure, judged

Run = Callable[[Model, Array, Array], Array]  # model, times, inputs -> outputs

TIME_MARGIN = 10.0
"""Mean slope of the rise over the slope at the flattest place where a time is read: the error of
a time is that of the curve over its slope."""

FACTORS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # internal steps tried, over the default
REPEATS = 5  # runs that are timed
LONGER = 10  # length of a timed run, in cases

FINER = 10  # steps of the plain integration in an internal step
STEPS = (1.0, 2.5, 0.4, 7.3, 1.0, 3.7, 5.0, 1.1, 2.0, 10.0) * 3
"""Communication steps over the internal step: together a hundred internal steps."""
HELD = 6  # communication steps from one jump of the inputs to the next
FLOOR = 1e-4  # least tolerance over the range of an output, as for the references
SAFETY = 2.0
"""Tolerance over the change of the plain integration from one step in an internal step to
``FINER``: a model that locates its jumps, or does not, differs by no more than that change."""
LOOSE = 0.05  # change of the plain integration, over the range, beyond which nothing is compared
JUMP = 0.5  # part of the change in two internal steps that one plain step makes at a jump
TOGETHER = 0.5  # size of all effects at once over their typical ones


def response_rows(case: Case, model: Model, run: Run, subject: str = "") -> list[Row]:
    """Run a case and judge it; ``subject`` names the FMU that is run, "" in this process."""
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


def _timed(tried: Model, case: Case, columns: Array) -> tuple[float, Array]:
    """Shortest time [s] of the case and its outputs.

    The timed run holds the case many times over, so that the cost of starting a run does
    not count; the first run, which may compile, is not timed.
    """
    out = tried.run(case.times, columns)
    step = case.times[1] - case.times[0]
    times = step * np.arange(LONGER * len(case.times), dtype=float)
    inputs = np.tile(columns, (LONGER, 1))
    shortest = float("inf")
    for _ in range(REPEATS):
        begun = perf_counter()
        tried.run(times, inputs)
        shortest = min(shortest, perf_counter() - begun)
    return shortest / LONGER, out


def effects_off(model: Model) -> dict[str, list[Parameter]]:
    """Return the switches of every effect that is off, by effect."""
    switches_of: dict[str, list[Parameter]] = {}
    for parameter in model.plant.parameters.values():
        if parameter.param.switch:
            switches_of.setdefault(parameter.owner, []).append(parameter)
    return {
        owner: switches
        for owner, switches in switches_of.items()
        if all(model.values[switch.name] == 0.0 for switch in switches)
    }


def switched_on(model: Model, switches: list[Parameter], share: float = 1.0) -> Model:
    """Return the model with these switches at a share of their typical sizes."""
    return replace(model, values=model.values | {s.name: _size(s, share) for s in switches})


def _size(switch: Parameter, share: float) -> float:
    param = switch.param
    typical = param.typical or param.low + 0.1 * (param.high - param.low) or param.high
    return min(max(share * typical, param.low), param.high)


def plain_row(subject: Subject, chosen: Model, name: str) -> Row:
    """Compare the simulation and the FMU with the plain integration of ``chosen``, its model, with
    the effects to look at."""
    where = (chosen.actuator.name, chosen.variant, f"blocks as plain functions: {name}")
    times = chosen.values["internal_step"] * np.cumsum((0.0, *STEPS))
    inputs = input_signals(chosen, times, held=HELD)
    try:
        coarse, fine = (
            integrate(chosen.plant, chosen.values, times, inputs, finer) for finer in (1, FINER)
        )
        runs = [run(chosen, times, inputs) for run in (Model.run, subject.run)]
    except UserError as error:
        return failure(MODEL, where, str(error), subject.name)
    except Exception as error:  # a block is anybody's Python
        reason = f"a block fails: {type(error).__name__}: {error}"
        return failure(MODEL, where, reason, subject.name)
    value, limit, until = _compared(coarse, fine, runs, chosen.values["internal_step"])
    quantity = "largest difference of any output"
    note = f"plain integration at 1/{FINER} of the internal step"
    if until < len(times):
        note += f"; to t = {times[until - 1]:g} s only, beyond it depends on the step by itself"
    if until < HELD:
        return judged(MODEL, where, quantity, value, None, "1", note, subject.name)
    if not value <= limit:
        note += "; try a shorter internal_step: if that does not help, the printed text is wrong"
    return judged(MODEL, where, quantity, value, limit, "1", note, subject.name)


def _compared(
    coarse: Course, fine: Course, responses: list[Array], step: float
) -> tuple[float, float, int]:
    """Largest difference and its limit, both over the range of an output, and the rows compared."""
    expected = fine.outputs[fine.rows]
    scale = np.ptp(fine.outputs, axis=0)
    scale[scale == 0.0] = np.maximum(np.abs(expected[0]), 1.0)[scale == 0.0]
    change = np.max(np.abs(coarse.outputs[coarse.rows] - expected) / scale, axis=1)
    unsure = np.flatnonzero(~(change <= LOOSE))
    until = int(unsure[0]) if len(unsure) else len(change)
    low, high = _tube(fine, step)
    off = [np.maximum(np.maximum(low - got, got - high), 0.0) / scale for got in responses]
    off += [np.where(np.isfinite(got), 0.0, np.nan) for got in responses]
    value = float(np.max(np.array(off)[:, :until])) if until else 0.0
    return value, FLOOR + SAFETY * float(np.max(change[:until], initial=0.0)), until


def _tube(fine: Course, step: float) -> tuple[Array, Array]:
    """Least and largest value that each output may have at each communication point.

    They are equal unless the output jumps within an internal step of that point: then
    every value from one such step before it to one after passes, as jumps may be early or late.
    """
    at_rows = fine.outputs[fine.rows]
    low, high = at_rows.copy(), at_rows.copy()
    for k, time in enumerate(fine.times[fine.rows]):
        near = np.searchsorted(fine.times, (time - step, time + step))
        around = fine.outputs[near[0] : near[1] + 1]
        if len(around) < 2:
            continue
        jumps = np.max(np.abs(np.diff(around, axis=0)), axis=0) > JUMP * np.ptp(around, axis=0)
        low[k, jumps] = around.min(axis=0)[jumps]
        high[k, jumps] = around.max(axis=0)[jumps]
    return low, high


def named_cases(chosen: Model, in_turn: bool) -> Mapping[str, Model]:
    """Return the models to look at, by name: as it is, with every effect in turn where that is
    asked for, and with all of them at once."""
    off = effects_off(chosen)
    models = {"as it is": chosen}
    if in_turn:
        models |= {f"{owner} on": switched_on(chosen, switches) for owner, switches in off.items()}
    if off:
        every = [switch for switches in off.values() for switch in switches]
        models["all effects on"] = switched_on(chosen, every, TOGETHER)
    return models
