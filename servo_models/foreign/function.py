"""A Python function as a box: ``actuator = "sim.py:simulate"``.

    INPUTS = {"goal": "90 deg"}                 # full scale of each signal, with its unit
    OUTPUTS = {"angle": "90 deg"}
    PARAMETERS = {"natural_frequency": "40 rad/s", "damping_ratio": 0.7}
    STEP = 0.002                                # s, longest time between two points

    def simulate(parameters, times, inputs):    # SI; inputs[name][k] is held from times[k] on
        return {"angle": ...}                   # at times, from rest

``parameters`` is a dict of numbers, ``inputs`` one of arrays.  The function runs in a process of
its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from servo_models.core.own_actuator import executed
from servo_models.core.types import Array
from servo_models.errors import UserError, did_you_mean, told_at
from servo_models.files import read_regular
from servo_models.fmu.child import SECONDS, Child, Pool
from servo_models.foreign.box import Signal, name_of
from servo_models.units import base_unit, parse

STEP, STOP = 1e-3, 1.0  # s, where the file says nothing
TABLES = ("INPUTS", "OUTPUTS", "PARAMETERS")


class FunctionBox:
    """See ``box.Box``."""

    any_step = True

    def __init__(self, path: Path, name: str) -> None:
        self.path = path
        self._what = f"'{path.name}:{name}'"
        module = _module(path)
        if not callable(getattr(module, name, None)):
            known = [it for it, value in vars(module).items() if callable(value)]
            raise UserError(f"'{path}' has no function '{name}'; {did_you_mean(name, known)}")
        tables = {key: getattr(module, key, None) for key in TABLES}
        for key, table in tables.items():
            if not isinstance(table, Mapping) or (not table and key != "PARAMETERS"):
                raise UserError(
                    f"'{path}' has no {key}: set it to a dict such as"
                    f' {key} = {{"goal": "90 deg"}}, names with full scale and unit'
                )
        self.inputs, self.outputs, self.parameters = (
            tuple(_signal(path, key, *item) for item in table.items())
            for key, table in tables.items()
            if table is not None
        )
        self.title = f"{path.name}, {name}"
        self.name = name_of(path.stem, "simulation")
        self.step = _duration(path, "STEP", getattr(module, "STEP", STEP))
        self.stop_time = _duration(path, "STOP_TIME", getattr(module, "STOP_TIME", STOP))
        self._calls = Pool(partial(Child, _function, (path, name), SECONDS, self._what))

    def run(self, parameters: Mapping[str, float], times: Array, inputs: Array) -> Array:
        """See ``box.Box.run``."""
        columns = {one.name: inputs[:, k].copy() for k, one in enumerate(self.inputs)}
        with self._calls.one() as call:
            found = call(dict(parameters), times.copy(), columns)
        if not isinstance(found, Mapping):
            raise UserError(f"{self._what} returns no dict of arrays, but {found!r:.60}")
        return np.column_stack([self._output(found, one.name, len(times)) for one in self.outputs])

    def _output(self, found: Mapping[str, Any], name: str, count: int) -> Array:
        if name not in found:
            raise UserError(f"{self._what} returns no '{name}'; {did_you_mean(name, list(found))}")
        values = np.asarray(found[name], dtype=float)
        if values.shape != (count,):
            raise UserError(
                f"{self._what} returns '{name}' of shape {values.shape}: give ({count},)"
            )
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values)))
            raise UserError(f"{self._what} returns '{name}' that is no number in row {row}")
        return values


def _module(path: Path) -> ModuleType:
    try:
        return executed(read_regular(path).decode(), str(path))
    except UserError:
        raise
    except (Exception, SystemExit) as error:  # whatever a person's file may raise
        raise UserError(
            f"'{path}' does not run: {type(error).__name__}: {error}; correct it"
        ) from error


def _function(path: Path, name: str) -> Callable[..., Any]:
    found: Callable[..., Any] = getattr(_module(path), name)
    return found


def _duration(path: Path, name: str, told: Any) -> float:
    """A time [s] that the file states, more than 0."""
    with told_at(f"'{path}', {name}"):
        value = parse(told, "s")
    if value <= 0.0:
        raise UserError(f"'{path}', {name} = {told!r}: give a time of more than 0 s")
    return value


def _signal(path: Path, table: str, name: str, told: Any) -> Signal:
    """A signal from ``"90 deg"``, or a number without a unit."""
    with told_at(f"'{path}', {table}['{name}']", ValueError):
        unit = base_unit(str(told).strip().partition(" ")[2] or "1")
        return Signal(name, unit, parse(told, unit))
