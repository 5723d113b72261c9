"""An FMU for co-simulation as a box, FMI 2.0 or 3.0, whoever made it.

Its parameters are those that are tunable or fixed real numbers with a start; each run is one of a
new instance, in a process of its own within limits of time and memory.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.fmu.child import Pool
from servo_models.fmu.fmu import Fmu
from servo_models.foreign.box import Signal, name_of
from servo_models.units import factor

STEP, STOP = 1e-3, 1.0  # s, where the description has no default experiment
FULL = {"rad": np.pi / 2.0, "deg": 90.0, "rad/s": 10.0, "m": 0.1, "V": 12.0, "N.m": 1.0}
"""Full scales of signals whose description states no nominal value and no range, by unit."""


class FmuBox:
    """See ``box.Box``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        fmu = self._unpacked()
        self._fmus = Pool(self._unpacked, fmu)
        described = fmu.description
        self.title = fmu.title
        self.name = name_of(described.modelName, "fmu")
        experiment = described.defaultExperiment
        self.stop_time = _number(experiment, "stopTime") or STOP
        self.step = _number(experiment, "stepSize") or STEP
        self.any_step = fmu.any_step
        real = [one for one in described.modelVariables if fmu.variables[one.name].real]
        self.inputs = tuple(_signal(one) for one in real if one.causality == "input")
        self.outputs = tuple(_signal(one) for one in real if one.causality == "output")
        self.parameters = tuple(
            _signal(one, parameter=True)
            for one in real
            if one.causality == "parameter" and one.variability in ("fixed", "tunable")
        )
        self._names = {name_of(one.name): one.name for one in real}
        for kind, found in (("input", self.inputs), ("output", self.outputs)):
            if not found:
                raise UserError(
                    f"FMU '{path}' has no real {kind}: nothing can be compared with a log"
                )

    def run(self, parameters: Mapping[str, float], times: Array, inputs: Array) -> Array:
        """See ``box.Box.run``; the FMU is stepped at even times where it wants even steps."""
        last = np.append(np.diff(times) > 0.0, True)  # of equal times the last counts
        points, columns = times[last], inputs[last]
        even = points
        if not self.any_step and len(points) > 1:
            count = int(np.ceil((points[-1] - points[0]) / self.step - 1e-9))
            even = points[0] + self.step * np.arange(count + 1.0)
            columns = columns[np.maximum(np.searchsorted(points, even + 1e-12, "right") - 1, 0)]
        named = {self._names[one.name]: columns[:, k] for k, one in enumerate(self.inputs)}
        start = {self._names[name]: value for name, value in parameters.items()}
        outputs = [self._names[one.name] for one in self.outputs]
        with self._fmus.one() as fmu:
            found = fmu.simulate(even, named, outputs, start)
        if not np.isfinite(found).all():
            row = int(np.argmin(np.isfinite(found).all(axis=1)))
            raise UserError(f"FMU '{self.path.name}' gives no number at t = {even[row]:g} s")
        return np.column_stack([np.interp(times, even, column) for column in found.T])

    def _unpacked(self) -> Fmu:
        fmu = Fmu(self.path)
        weakref.finalize(self, fmu.close)  # its process and its unpacked files
        return fmu


def _signal(variable: Any, parameter: bool = False) -> Signal:
    unit = variable.unit or (variable.declaredType.unit if variable.declaredType else "") or "1"
    try:
        factor(unit, unit)
    except UserError:
        unit = "1"  # a unit that nobody knows here is a number of its own
    low, high = (_number(variable, key) for key in ("min", "max"))
    start, nominal = _number(variable, "start") or 0.0, _number(variable, "nominal")
    span = max(abs(it) for it in (low or 0.0, high or 0.0))
    size = start if parameter else nominal or span or FULL.get(unit, 1.0)
    return Signal(
        name_of(variable.name),
        unit,
        size,
        -np.inf if low is None else low,
        np.inf if high is None else high,
        (variable.description or "").strip(),
        0.0 if parameter or variable.causality == "output" else start,
    )


def _number(owner: Any, key: str) -> float | None:
    text = getattr(owner, key, None)
    return None if text in (None, "") else float(text)
