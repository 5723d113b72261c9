"""Commands that changed while no row was logged: when they did is not known, and counts as that.

A command is held from its row on.  Where rows are missing, it may have changed any time before the
next row, and what follows is another motion, an open loop's for good.  The difference that it makes
if it changed at once is simulated, one for each change; how much of it is there is anything from
none to all.  Errors are weighed by the inverse of the covariance that this gives them.
Source: Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), sec. 2.7 (linear
nuisance terms as part of the covariance).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from threading import Lock
from weakref import ref

import numpy as np
from cachetools import LRUCache, cached

from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.audit import lost_rows
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.simulation import prepared

MOST_LOST_SHARE = 0.1
"""Of the rows: where more are far apart, rows are uneven, and none is known to be lost."""
MOST_CHANGES = 60
"""In a log: of more only the largest, since each is a simulation."""
MEAN_SQUARE_SHARE = 1.0 / 3.0
"""Of a share that is anything from 0 to 1."""


def with_lost_rows(
    model: Model, logs: Sequence[Log], values: Mapping[str, float]
) -> tuple[Log, ...]:
    """Return logs that know what commands between lost rows may have done to their outputs.

    Args:
        model: simulated with these ``values`` [SI].
        logs: those without lost rows stay as they are.
        values: of parameters.
    """
    return tuple(_with_lost_rows(model, log, values) for log in logs)


def _with_lost_rows(model: Model, log: Log, values: Mapping[str, float]) -> Log:
    before = lost_rows(log)
    if not 0 < len(before) <= MOST_LOST_SHARE * len(log.times):
        return log
    sizes = np.zeros(len(before))
    for held in log.inputs.values():
        sizes += np.abs(held[before + 1] - held[before]) / (np.ptp(held) or 1.0)
    changed = before[np.argsort(-sizes)[: min(MOST_CHANGES, np.count_nonzero(sizes))]]
    try:
        usual = prepared(model, log).outputs(values)
        moved = [prepared(model, _at_once(log, k)).outputs(values) - usual for k in changed]
    except UserError:
        return log
    if not moved:
        return log
    unsure = np.stack(moved, axis=-1)
    return replace(log, unsure={name: unsure[:, i] for i, name in enumerate(log.outputs)})


def _at_once(log: Log, row: int) -> Log:
    """The log with its next commands in this row already."""
    inputs = {name: values.copy() for name, values in log.inputs.items()}
    for values in inputs.values():
        values[row] = values[row + 1]
    return replace(log, inputs=inputs)


@cached(LRUCache(64), key=lambda log, sigma: (ref(log), sigma), lock=Lock())
def nuisances(log: Log, sigma: tuple[float, ...]) -> tuple[Array, Array]:
    """Return directions of weighted errors in which lost rows may have moved them, shape (m, k),
    and by which share the covariance takes each away, shape (k,).

    Args:
        log: with ``unsure``.
        sigma: weight [SI] of each of its outputs.
    """
    assert log.unsure
    parts = [log.unsure[name][log.fitted] / size for name, size in zip(log.outputs, sigma)]
    spread = np.sqrt(MEAN_SQUARE_SHARE) * np.concatenate(parts)
    left, singular, _ = np.linalg.svd(spread, full_matrices=False)
    return left, 1.0 - 1.0 / np.sqrt(1.0 + singular**2)
