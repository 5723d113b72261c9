"""Logs that begin in another state than the model that is to imitate them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.identification.run import Run

FIRST = 3
"""Samples that are the beginning of a log."""
OFF = 0.02
"""Error there over the range of an output, from which it may have begun in another state."""
LATER = 5.0
"""Error there over that of the second half of a log, from which it surely has."""


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
        first, later = _rms(errors[:FIRST]), _rms(errors[len(errors) // 2 :])
        if first > max(OFF, LATER * later):
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
