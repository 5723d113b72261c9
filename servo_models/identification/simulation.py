"""A log as a simulation takes it: from its own inputs, after its settling time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import Lock
from typing import Protocol
from weakref import ref

import numpy as np
from cachetools import LRUCache, cached
from numpy.typing import NDArray

from servo_models.core.simulate import Model, check_grid
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.errors import UserError

FIRST_SAMPLES = 3
"""The beginning of a log."""
OFF_AT_FIRST = 0.02  # of the range of an output
"""Error at the beginning from which a log may have begun in another state."""
OFF_LATER = 5.0  # times the error of the second half
"""Error at the beginning from which it surely has."""
STEP = "internal_step"
REMEMBERED = 12_000_000
"""Bytes of the latest simulations that are kept: a search comes back to a tenth of them."""


class Steps(Protocol):
    """Says how long the internal step of a run may be, see ``internal_step.InternalSteps``."""

    def longest(self, run: Run, names: Iterable[str]) -> float:
        """Return the step [s] for a run in which these parameters may be anything."""


@dataclass(frozen=True, eq=False)
class Run:
    """A log as the simulation takes it: the settling time in front, inputs as a matrix.

    With ``steps`` these choose the internal step, not the model.
    """

    log: Log
    model: Model
    times: Array
    inputs: Array
    columns: tuple[int, ...]
    steps: Steps | None = None
    _chosen: dict[tuple[str, ...], float] = field(default_factory=dict, init=False, repr=False)

    def outputs(self, values: Mapping[str, float]) -> Array:
        """Measured outputs simulated with these parameters, shape (n, outputs of the log)."""
        return np.asarray(self.simulate(values)[:, self.columns])

    def outputs_or_nan(self, values: Mapping[str, float]) -> Array:
        """The same, NaN where the model cannot be simulated: parameters that some logs ask for may
        run away in one that no fit has seen."""
        try:
            return self.outputs(values)
        except UserError:
            return np.full((len(self.log.times), len(self.columns)), np.nan)

    def with_constants(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return all parameters [SI] with these values: what the log states stays as it states it,
        also where other logs leave it open."""
        stated = self.log.constants
        own = {name: value for name, value in values.items() if name not in stated}
        return {**self.model.values, **own}

    def simulate(self, values: Mapping[str, float]) -> Array:
        """All outputs of the plant with these parameters, shape (n, outputs of the plant).

        What the log states as a constant stays, see ``with_constants``.
        """
        vector, stated = self._base.copy(), self.log.constants
        if self.steps and STEP not in stated:
            vector[self._places[STEP]] = self._step(self.steps, tuple(values))
        for name, value in values.items():
            if name not in stated:
                vector[self._places[name]] = value
        return _simulated(self, vector)[-len(self.log.times) :]

    def _step(self, steps: Steps, names: tuple[str, ...]) -> float:
        """The internal step while these parameters change."""
        if names not in self._chosen:
            self._chosen[names] = steps.longest(self, names)
        return self._chosen[names]

    def errors(self, values: Mapping[str, float]) -> Array:
        """Simulated less measured [SI] at samples that a fit sees, shape (outputs of the log, n).

        Raises:
            UserError: a run that leaves the finite numbers.
        """
        errors = np.asarray(self.simulate(values).take(self._seen))
        errors -= self.measured
        return errors

    @cached_property
    def measured(self) -> Array:
        """Measured outputs [SI] at samples that a fit sees, shape (outputs of the log, n)."""
        return np.array([values[self._rows] for values in self.log.outputs.values()])

    @cached_property
    def _base(self) -> Array:
        return self.model.vector

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.model.values)}

    @cached_property
    def _rows(self) -> NDArray[np.int64]:
        return np.flatnonzero(self.log.fitted)

    @cached_property
    def _seen(self) -> NDArray[np.int64]:
        """Places of these samples in what a simulation returns, row by row."""
        width = len(self.model.plant.outputs)
        return np.asarray(self._rows * width + np.array(self.columns)[:, None])


@cached(
    LRUCache(REMEMBERED, getsizeof=lambda found: found.nbytes),
    # a dead log equals itself only, so that no other one is given what was its own
    key=lambda run, vector: (ref(run.log), ref(run.model.plant), vector.tobytes()),
    lock=Lock(),
)
def _simulated(run: Run, vector: Array) -> Array:
    """All outputs with a parameter vector [SI], to be read only: others will be given the same."""
    found = run.model.from_rest(vector, run.times, run.inputs)
    found.flags.writeable = False
    return found


def prepared(model: Model, log: Log, steps: Steps | None = None) -> Run:
    """Return a log as a simulation takes it; what its constants name is set for it alone.

    Raises:
        UserError: inputs outside their bounds or not finite.
    """
    plant = model.plant
    inputs = {wire.name: np.full(len(log.times), float(wire.rest)) for wire in plant.inputs}
    parameters: dict[str, float] = {}
    for name, value in log.constants.items():
        if name in inputs:
            inputs[name] = np.full(len(log.times), value)
        else:
            parameters[name] = value
    inputs |= log.inputs
    matrix = np.column_stack([inputs[wire.name] for wire in plant.inputs])
    times = log.times
    if log.settle > 0.0:
        times = np.concatenate([[0.0], times + log.settle])
        matrix = np.vstack([matrix[:1], matrix])
    chosen = replace(model, values={**model.values, **parameters})
    check_grid(times, matrix, plant.inputs, chosen.values[STEP])
    columns = tuple(plant.outputs.index(name) for name in log.outputs)
    return Run(log, chosen, times, np.ascontiguousarray(matrix), columns, steps)


def false_starts(runs: Iterable[Run], values: Mapping[str, float]) -> list[str]:
    """Return in words which logs begin in another state than the model, each with its cure.

    A wrong position shows at once and is forgotten; what else a model lacks shows when it moves.

    Args:
        runs: logs with their model.
        values: parameters [SI] of the model, by name.
    """
    return [text for run in runs for text in _of(run, values)]


def _of(run: Run, values: Mapping[str, float]) -> Iterator[str]:
    log, wires = run.log, run.model.plant.wire
    unit = wires[run.model.plant.outputs[0]].unit
    for name, simulated in zip(log.outputs, run.outputs_or_nan(values).T):
        if wires[name].unit != unit:
            continue  # a drive or a current may jump at the first command
        measured = log.outputs[name]
        reach = float(np.ptp(measured))
        errors = (simulated - measured) / (reach or 1.0)
        first, later = _rms(errors[:FIRST_SAMPLES]), _rms(errors[len(errors) // 2 :])
        if first > max(OFF_AT_FIRST, OFF_LATER * later):
            yield (
                f"log '{log.name}' begins in another state than the model, {_state(log)}: '{name}'"
                f" is off by {first:.2g} of its range at first, by {later:.1g} in its second half;"
                " begin the log at rest ('window'), or say how long its first row had been held"
                " ('settle')"
            )


def _state(log: Log) -> str:
    """The state in which the model begins a log, in words."""
    if log.settle:
        return f"for which its first row is held for {log.settle:.3g} s before"
    return "which begins at rest"


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))
