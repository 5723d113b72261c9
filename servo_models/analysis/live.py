"""Panels that simulate in the reader's browser: a model, an actuator driven by hand, an effect."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from servo_models.analysis.demonstration import Demonstration, demonstrate
from servo_models.analysis.diagram import diagram
from servo_models.analysis.experiment import display
from servo_models.analysis.explain import (
    display_scale,
    display_unit,
    effect_name,
    explain,
    is_actuator,
)
from servo_models.analysis.pictures import characteristic
from servo_models.analysis.simulate import Result
from servo_models.catalogue import actuator as find_actuator
from servo_models.catalogue import model
from servo_models.core.flat import Flat
from servo_models.core.js_text import js_model
from servo_models.core.plant import Parameter, Wire
from servo_models.core.simulate import Model
from servo_models.errors import UserError
from servo_models.report.live import (
    Live,
    LiveModel,
    LiveParameter,
    LiveRun,
    LiveSignal,
    encoded,
)
from servo_models.report.result import Report
from servo_models.report.sections import Picture, Section
from servo_models.units import WRITTEN_IN, factor

NOMINAL = "nominal"
SWEEP = 0.5  # reach of a slider to either side, over its value
SWEEP_ERRORS = 5.0  # reach of a slider to either side in standard errors, if that is further
SWEEP_TYPICAL = 3.0  # end of the slider of an effect that is off, in typical values
DRIVE = "Simulated in this page: drive it, move a parameter, or switch an effect."
COMPARE = "Simulated in this page: the same run without the effect, dashed, and with it."


def explained(name: str, variant: str | None = None) -> Report:
    """Return ``explain`` with a panel: an actuator that one drives, or an effect that one moves.

    An actuator is also shown as a block diagram.

    Raises:
        UserError: see ``explain``.

    Example:
        >>> explained("backlash").panels[0].models[0].sets.keys()
        dict_keys(['nominal', 'backlash'])
    """
    sheet = explain(name, variant)
    if not is_actuator(name):
        effect = effect_name(name)
        return demonstrated(effect, demonstrate(effect))
    actuator = find_actuator(name)
    chosen = actuator.variant(variant).name
    others = [it.name for it in actuator.variants if it.name != chosen]
    models = tuple(live_model(model(actuator, it)) for it in (chosen, *others))
    drawn = diagram(actuator, chosen)
    sheet = replace(sheet, sections=(Section(drawn.title, pictures=(drawn,)), *sheet.sections))
    return with_panel(sheet, Live("Drive it", DRIVE, models))


def demonstrated(effect: str, shown: Demonstration) -> Report:
    """Return ``explain`` of an effect with its demonstration as a panel, and its characteristic."""
    panel = Live("Drive it", COMPARE, (_effect(effect, shown),))
    return _with_law(with_panel(explain(effect), panel), shown)


def with_panel(report: Report, live: Live) -> Report:
    """Return a report that begins with a panel."""
    return replace(report, sections=(Section(live.title, live=live), *report.sections))


def _with_law(report: Report, shown: Demonstration) -> Report:
    """A report that begins with the characteristic of an effect, where it has one."""
    law = shown.law
    if not law:
        return report
    drawn = Picture(
        f"{shown.place.name} of {shown.place.actuator.name}",
        lambda panels: characteristic(panels[0], law),
        f"{shown.values}. Dashed: without the effect." if law.over is law.wire else shown.values,
    )
    section = Section("Characteristic", pictures=(drawn,))
    return replace(report, sections=(section, *report.sections))


def _effect(effect: str, shown: Demonstration) -> LiveModel:
    """The run in which an effect can be seen, without and with it."""
    plain = model(shown.place.actuator, None, shown.neutral)
    run = _run("a step, then a slow way back", shown.without)
    return live_model(plain, {effect: shown.active}, shown={shown.place.name}, runs=(run,))


def _run(name: str, result: Result) -> LiveRun:
    inputs = np.column_stack(list(result.inputs.values()))
    counted = encoded(np.ones(len(result.times)))
    return LiveRun(name, encoded(result.times), encoded(inputs.ravel()), {}, counted)


def live_model(
    model: Model,
    sets: Mapping[str, Mapping[str, float]] | None = None,
    errors: Mapping[str, float] | None = None,
    shown: Collection[str] = (),
    runs: tuple[LiveRun, ...] = (),
    floors: Mapping[str, float] | None = None,
) -> LiveModel:
    """Return a model for a panel.

    Args:
        model: whose values are the nominal ones.
        sets: further sets of values [SI], by name; values not given are nominal.  The panel
            begins with the last.
        errors: standard errors [SI] of parameters.
        shown: parameters, and effects, that stand first.
        runs: logs; without any the standard step drives it.
        floors: noise floors [SI] by output.

    Raises:
        UserError: a block has no form in JavaScript, or the model is a simulation that is not ours.
    """
    plant, actuator = model.plant, model.actuator
    if actuator.inner:
        raise UserError(
            f"'{actuator.name}' is a simulation that is not ours, and no page can hold it: see the"
            " pictures of a report"
        )
    try:
        program = js_model(model.flat)
    except ValueError as error:
        raise UserError(f"'{actuator.name}' cannot be shown in a page: {error}") from error
    every = {NOMINAL: model.values, **{n: {**model.values, **v} for n, v in (sets or {}).items()}}
    parameters = tuple(
        _parameter(
            plant.parameters[name],
            [values[name] for values in every.values()],
            (errors or {}).get(name),
            bool({name, plant.parameters[name].owner} & {*shown}),
        )
        for name in model.values
    )
    name, size = model.step
    driven = plant.wire[name]
    return LiveModel(
        name=f"{actuator.name}, {model.variant}",
        program=program,
        actuator=actuator.key,
        variant=model.variant,
        parameters=parameters,
        effects={
            owner: plant.main(owner).effect.about.split("\n", 1)[0] for owner in model.flat.switches
        },
        inputs=tuple(_signal(wire, None) for wire in plant.inputs),
        outputs=tuple(_signal(plant.wire[it], (floors or {}).get(it)) for it in plant.outputs),
        faults=_faults(model.flat),
        sets={title: tuple(values[it] for it in model.values) for title, values in every.items()},
        runs=runs,
        driven=(name, size - float(driven.rest)),
        step=model.step_size,
        duration=model.stop_time,
    )


def _signal(wire: Wire, floor: float | None) -> LiveSignal:
    scale, unit = display(wire)
    rest = float(wire.rest) if isinstance(wire.rest, float | int) else 0.0
    low, high = (
        -math.inf if wire.low is None else wire.low,
        math.inf if wire.high is None else wire.high,
    )
    units = tuple((it, factor(it, wire.unit)) for it in WRITTEN_IN.get(wire.unit, (wire.unit,)))
    return LiveSignal(
        wire.name, wire.about, unit or "1", scale, floor, rest, low, high, wire.scale, units
    )


def _parameter(
    parameter: Parameter, values: list[float], error: float | None, shown: bool
) -> LiveParameter:
    param = parameter.param
    if error is not None and not 0.0 < error < math.inf:  # on a bound, or not determined
        error = None
    return LiveParameter(
        name=parameter.name,
        about=param.about,
        unit=display_unit(parameter),
        scale=display_scale(parameter),
        low=param.low,
        high=param.high,
        slider=_ends(parameter, values, error or 0.0),
        si=param.unit,
        effect=parameter.owner,
        switch=param.typical if parameter.owner and param.switch else None,
        error=error,
        shown=shown,
    )


def _ends(parameter: Parameter, values: list[float], error: float) -> tuple[float, float]:
    """Ends of a slider: around its values, within the bounds."""
    param = parameter.param
    wide = [max(SWEEP * abs(value), SWEEP_ERRORS * error) for value in values]
    low = min(value - width for value, width in zip(values, wide))
    high = max(value + width for value, width in zip(values, wide))
    if param.switch and parameter.owner:
        low, high = min(low, 0.0), max(high, SWEEP_TYPICAL * param.typical)
    if low == high:  # nothing is known but its bounds
        low, high = param.low, param.high
    ends = np.clip([low, high], param.low, param.high)
    return float(ends[0]), float(ends[1])


def _faults(flat: Flat) -> dict[str, str]:
    """Faults that may end a run, by their codes."""
    told = {str(-1 - k): f"{owner}: {text}" for k, (_, owner, text) in enumerate(flat.faults)}
    told[str(flat.too_fast)] = "these values need a shorter internal step"
    told[str(flat.too_long)] = "these values make it too stiff for a page"
    return told
