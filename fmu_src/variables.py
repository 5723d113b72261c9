"""The variables of an FMU in the order of their value references."""

from __future__ import annotations

from dataclasses import dataclass

from servo_models.actuator import Parameter, Wire
from servo_models.simulate import Model


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
    """Return inputs, outputs, parameters; the index of each is its value reference."""
    plant = model.plant
    return [
        *(_of_wire(wire, "input") for wire in plant.inputs),
        *(_of_wire(plant.wire[name], "output") for name in plant.outputs),
        *(_of_parameter(p, model.values[name]) for name, p in plant.parameters.items()),
    ]


def _of_wire(wire: Wire, causality: str) -> Variable:
    return Variable(
        wire.name,
        wire.about,
        causality,
        wire.unit,
        wire.display,
        wire.scale,
        start=float(wire.rest) if causality == "input" else None,
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
