"""Whether a log begins as its description says, beside what its first samples show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.simulation import OFF_AT_FIRST, prepared
from servo_models.identification.starts import listed, with_starts

WORSE_SQUARES = 4.0
"""Ratio of squared errors, from the stated start over from the one that the first samples show, at
which the stated one is wrong.  A poor model leaves much from either."""
OTHER_ANGLE = 0.05
"""Of the way of the shaft in the first part of a log: the least by which another start is off."""
OTHER_RATE = 0.3
"""The same of its fastest rate; readings that begin to move seem to have one at once."""


def false_statements(model: Model, logs: Sequence[Log]) -> dict[str, tuple[str, Log]]:
    """Return what is wrong with stated starts, by the name of the log.

    Args:
        model: nominal values.
        logs: measured runs, as their description has them.

    Returns:
        a sentence with its cure, and the log as its first samples show that it begins.
    """
    found = {}
    for log in logs:
        if log.assumed or not log.outputs or (log.start is not None and log.start.fitted):
            continue
        (shown,) = with_starts(model, [replace(log, start=None, assumed=True, notes=())])
        if shown.start == log.start and shown.settle == log.settle:
            continue
        stated, likely = _first_part(model, log), _first_part(model, shown)
        worse = _is_worse(log, stated, likely, model.plant.outputs)
        if worse and _is_another(model, stated[0], shown, likely):
            found[log.name] = _sentence(model, log, shown), shown
    return found


def _first_part(model: Model, log: Log) -> Array:
    """All outputs [SI] in the first part of a log, shape (n, outputs); NaN where there are none."""
    early = int(np.searchsorted(log.times, model.stop_time, side="right"))
    try:
        return prepared(model, log).simulate({})[:early]
    except UserError:
        return np.full((early, len(model.plant.outputs)), np.nan)


def _is_worse(log: Log, stated: Array, likely: Array, outputs: Sequence[str]) -> bool:
    """Whether readings contradict the one start, and far less the other."""
    for name, measured in log.outputs.items():
        reach = float(np.ptp(measured)) or 1.0
        now, then = (
            float(np.mean(((it[:, outputs.index(name)] - measured[: len(it)]) / reach) ** 2))
            for it in (stated, likely)
        )
        if not now <= max(OFF_AT_FIRST**2, WORSE_SQUARES * then):  # NaN is worse than all
            return True
    return False


def _is_another(model: Model, first: Array, shown: Log, likely: Array) -> bool:
    """Whether the shaft is elsewhere, or turns otherwise, in a first row than readings show."""
    shaft, outputs = model.shaft, model.plant.outputs
    seen = shown.start.shaft if shown.start else {}
    angle = shaft.angle if shaft else outputs[0]
    angles = likely[:, outputs.index(angle)]
    off = abs(first[outputs.index(angle)] - seen.get(angle, angles[0]))
    is_near = bool(off <= OTHER_ANGLE * float(np.ptp(angles)))  # never of NaN
    if shaft is None or not is_near:
        return not is_near
    rates = likely[:, outputs.index(shaft.rate)]
    off = abs(first[outputs.index(shaft.rate)] - seen.get(shaft.rate, rates[0]))
    return not off <= OTHER_RATE * float(np.abs(rates).max())


def _sentence(model: Model, log: Log, shown: Log) -> str:
    wires = model.plant.wire
    if log.start:
        told = f"is at {listed(log.start.shaft, wires)} by its 'start'"
    else:
        told = "is settled at its first row" if log.settle else "begins at rest"
    if not shown.start:
        seen = "that it is settled at its first row" if shown.settle else "that it begins at rest"
    elif shown.start.before:
        seen = f"that about {listed(shown.start.before, wires)} had been held before"
    else:
        seen = f"about {listed(shown.start.shaft, wires)}"
    return (
        f"log '{log.name}' begins in another state than the model, which {told}: its first samples"
        f" show {seen}; correct 'start', or leave it out"
    )
