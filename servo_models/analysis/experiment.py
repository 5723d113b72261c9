"""A step on a model; units in which a person reads its signals."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.simulate import Result, simulate
from servo_models.core.plant import Wire, check_known
from servo_models.core.simulate import Model
from servo_models.errors import UserError, told_at
from servo_models.report.numbers import Quantity
from servo_models.units import factor, parse

LONGEST = 10_000_000  # communication points of a step at most; more is a wrong unit


def step(
    chosen: Model,
    inputs: Mapping[str, float | str] | None = None,
    stop: float | str | None = None,
    dt: float | str | None = None,
) -> Result:
    """Simulate the response to inputs that step from rest at time 0.

    Args:
        chosen: from ``model``.
        inputs: values after the step by name, numbers in SI or strings such as ``"2 ms"``;
            default the standard step of the variant.
        stop, dt: end of the run and communication step, in s or with a unit; default the
            actuator's.

    Raises:
        UserError: an unknown input, a wrong unit, a value outside its bounds, a time that
            is not positive.
    """
    actuator = chosen.actuator
    given = dict(inputs or [chosen.step])
    wires = {wire.name: wire for wire in chosen.plant.settable}
    check_known("input", given, wires, f"actuator '{actuator.name}'")
    values = {name: _input(wires[name], value) for name, value in given.items()}
    end = _positive("stop", chosen.stop_time if stop is None else stop)
    size = _positive("dt", chosen.step_size if dt is None else dt)
    return simulate(chosen, _grid(end, size), values)


def _input(wire: Wire, value: float | str) -> float:
    with told_at(f"input '{wire.name}'"):
        number = parse(value, wire.unit)
    low = -math.inf if wire.low is None else wire.low
    high = math.inf if wire.high is None else wire.high
    if not low <= number <= high:
        example = f", with its unit if it is not {wire.unit}" if wire.display else ""
        raise UserError(
            f"input '{wire.name}' = {number:g} is outside [{low:g}, {high:g}] {wire.unit}:"
            f" choose a value inside{example}"
        )
    return number


def _positive(name: str, value: float | str) -> float:
    with told_at(name):
        number = parse(value, "s")
    if number <= 0.0:
        raise UserError(f"{name} = {number:g} s: give a time above 0")
    return number


def _grid(stop: float, dt: float) -> NDArray[np.float64]:
    """Multiples of ``dt`` [s] up to ``stop`` [s], which is the last point in any case."""
    count = stop / dt
    if count > LONGEST:
        raise UserError(f"{count:.2g} steps are too many: choose a longer dt or a shorter stop")
    return np.append(dt * np.arange(math.ceil(count - 1e-9)), stop)


def display(wire: Wire) -> tuple[float, str]:
    """Return the factor from SI to the unit that a person reads, and that unit, "" for none."""
    unit = wire.display or wire.unit
    return (factor(wire.unit, unit) if wire.display else 1.0), "" if unit == "1" else unit


def shown(wire: Wire, value: float, digits: int = 4) -> Quantity:
    """Return a value [SI] of a signal as a person reads it."""
    scale, unit = display(wire)
    return Quantity(scale * value, unit, digits=digits)


def in_time(value: float) -> str:
    """Return a time [s] as a person reads it."""
    return f"{1e3 * value:.3g} ms" if value < 0.9995 else f"{value:.3g} s"
