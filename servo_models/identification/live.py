"""Logs for a panel that simulates in the reader's browser, beside their model."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from servo_models.analysis.live import live_model
from servo_models.core.simulate import Model
from servo_models.data.log import Log
from servo_models.identification.simulation import Run, prepared
from servo_models.report.live import LiveModel, LiveRun, encoded

MOST_NUMBERS = 120_000  # of all logs on a page, which then has 1 MB at most
HELD_OUT = "held out"
MOVE = (
    "Simulated in this page: move a parameter or switch an effect, and see the measured curve met"
    " or missed. Drag across the curves to zoom."
)


def live_logs(
    model: Model,
    logs: Sequence[Log],
    sets: Mapping[str, Mapping[str, float]],
    errors: Mapping[str, float],
    shown: Collection[str],
    floors: Mapping[str, float],
) -> tuple[LiveModel, ...]:
    """Return a model with its logs for a panel; none where a block has no form in JavaScript.

    Args:
        model, sets, errors, shown, floors: see ``analysis.live.live_model``.
        logs: as measured.
    """
    runs = live_runs(model, logs, [model.values, *sets.values()])
    try:
        return (live_model(model, sets, errors, shown, runs, floors),) if runs else ()
    except ValueError:
        return ()


def live_runs(
    model: Model, logs: Sequence[Log], sets: Iterable[Mapping[str, float]]
) -> tuple[LiveRun, ...]:
    """Return logs for a panel, as many rows as a page holds.

    Args:
        model: nominal.
        logs: as measured.
        sets: values [SI] of the panel's sets, in their order, the nominal one first.
    """
    found: list[LiveRun] = []
    left = MOST_NUMBERS
    values = [dict(it) for it in sets]
    for log in logs:
        each = 2 + len(model.plant.inputs) + len(log.outputs)
        rows = min(len(log.times), left // each)
        if rows < min(len(log.times), 2):
            break
        found.append(_run(prepared(model, log), rows, values))
        left -= rows * each
    missing = len(logs) - len(found)
    if missing and found:
        note = f"{missing} more logs are not on this page."
        found = [replace(run, note=f"{run.note} {note}".strip()) for run in found]
    return tuple(found)


def _run(run: Run, rows: int, sets: Sequence[Mapping[str, float]]) -> LiveRun:
    log, inputs = run.log, run.inputs[-len(run.log.times) :]
    cut = rows < len(log.times)
    held, placed = _beginnings(run, sets)
    counted = np.ones(len(log.times)) if log.skipped is None else np.where(log.skipped, 0.0, 1.0)
    return LiveRun(
        name=log.name,
        times=encoded(log.times[:rows]),
        inputs=encoded(inputs[:rows].ravel()),
        measured={name: encoded(values[:rows]) for name, values in log.outputs.items()},
        counted=encoded(counted[:rows]),
        begin=log.begin,
        settle=log.settle,
        held=held,
        placed=placed,
        constants={n: v for n, v in log.constants.items() if n in run.model.values},
        stretches=tuple(_stretches(log, rows)),
        note=f"The first {log.times[rows - 1]:.4g} s of {log.duration:.4g} s." if cut else "",
    )


def _beginnings(
    run: Run, sets: Sequence[Mapping[str, float]]
) -> tuple[tuple[tuple[float, ...], ...], tuple[tuple[tuple[int, float], ...], ...]]:
    """Inputs held before the log, and where the state is put, for each set of values."""
    if not run.beginning:
        return ((tuple(run.inputs[0].tolist()),) if run.log.settle > 0.0 else ()), ()
    begun = [run.begun(values) for values in sets]
    return tuple(tuple(held.tolist()) for held, _ in begun), tuple(it for _, it in begun)


def _stretches(log: Log, rows: int) -> Iterator[tuple[str, float, float]]:
    """Parts of a log that a reader may want to see, with the times of the file."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], log.held_out[:rows], [False]])))
    for k, (first, after) in enumerate(zip(edges[::2], edges[1::2])):
        name = f"{HELD_OUT} {k + 1}" if len(edges) > 2 else HELD_OUT
        yield name, float(log.stamps[first]), float(log.stamps[after - 1])
