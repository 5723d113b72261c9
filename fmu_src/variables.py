"""The variables of an FMU in the order of their value references."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.bounds import is_outside
from servo_models.core.plant import Parameter, Wire
from servo_models.core.simulate import Model


@dataclass(frozen=True)
class Variable:
    """What the model description and the slave say about one variable, in SI.

    Attributes:
        causality: ``input``, ``output`` or ``parameter``.
        start: value at the start; None for an output, which is calculated.
        low, high: inclusive bounds, None for none.
        fixed: a parameter that cannot be set once a run has begun.
        flag: it is Boolean; only an output may be.
    """

    name: str
    about: str
    causality: str
    unit: str
    display: str | None
    nominal: float
    start: float | None = None
    low: float | None = None
    high: float | None = None
    fixed: bool = False
    flag: bool = False


def variables(model: Model) -> list[Variable]:
    """Return inputs, outputs, parameters; the index of each is its value reference.

    The variant's command starts at its standard step, if that is inside its bounds, and the others
    at rest, as ``simulate`` leaves them: in a host that sets no input something moves.
    """
    plant = model.plant
    return [
        *(_of_wire(_told(wire, model), "input", start_of(wire, model)) for wire in plant.inputs),
        *(_of_wire(plant.wire[name], "output") for name in plant.outputs),
        *(_of_parameter(p, model.values[name]) for name, p in plant.parameters.items()),
    ]


def start_of(wire: Wire, model: Model) -> float:
    """Return the start value of an input [SI]."""
    name, value = model.step
    stepped = wire.name == name and not is_outside(np.array([value]), wire).any()
    return value if stepped else float(wire.rest)


def _told(wire: Wire, model: Model) -> Wire:
    """Return an input that says so where it is the command of other variants only."""
    actuator = model.actuator
    commands = {actuator.step[0], *(variant.command for variant in actuator.variants)}
    if wire.name not in commands - {model.step[0]}:
        return wire
    clause = f"not the command of variant '{model.variant}': starts at rest"
    return replace(wire, about=f"{wire.about}; {clause}")


def _of_wire(wire: Wire, causality: str, start: float | None = None) -> Variable:
    return Variable(
        wire.name,
        wire.about,
        causality,
        wire.unit,
        wire.display,
        wire.scale,
        start=start,
        low=wire.low,
        high=wire.high,
        flag=wire.flag and causality == "output",  # the slave takes Real only
    )


def _of_parameter(parameter: Parameter, value: float) -> Variable:
    param = parameter.param
    return Variable(
        parameter.name,
        param.about + ("; 0 is neutral" if param.switch else ""),
        "parameter",
        param.unit,
        param.display,
        abs(value) or param.typical or max(abs(param.low), abs(param.high)),
        start=value,
        low=param.low,
        high=param.high,
        fixed=param.fixed,
    )
