"""How large a gap is: by output, before and after, on blocks that a fit left out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.statistics import rms
from servo_models.core.types import Array
from servo_models.data.sensor import RESIDUAL, difference_noise
from servo_models.diagnosis.search.crossval import CLEAR, CrossValidation, closed
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.selection import Selection
from servo_models.identification.problem import Problem

STAGES = ("before", "retuned", "after")
DRAWS = 400  # draws of the block bootstrap (Kuensch, Annals of Statistics 17 (1989))
SHIFTS = 30  # most steps to the equivalent delay
CONVERGED = 0.9999  # squared error over that before from which another step is none


@dataclass(frozen=True)
class GapSummary:
    """How far a gap closes: RMS errors on blocks that the fit of each stage left out.

    Attributes:
        rms: by stage: ``"before"``, ``"retuned"``, ``"after"``.
        intervals: 95 % interval of each.
        floor: noise floor, in the same unit.
        closed: share of the reducible gap that is closed, with its interval; None where
            there is nothing to reduce.
    """

    rms: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    floor: float
    closed: tuple[float, float, float] | None


@dataclass(frozen=True)
class Gap(GapSummary):
    """The gap of one output [SI].

    Attributes:
        output: its name.
        origin: where its noise floor is from.
        full_scale: largest less smallest measured value.
        worst: log and time [s] of the largest error before.
        delay: shift [s] of the simulation that would take most of the gap before away.
        motion: noise that the method of the floor sees in the simulation after, which has none;
            0 where differences of neighbouring samples are not that method.
    """

    output: str
    origin: str
    full_scale: float
    worst: tuple[str, float]
    delay: float
    motion: float

    @property
    def nrmse(self) -> float:
        """Error before over the measured range [1], NaN where that is 0."""
        return self.rms["before"] / self.full_scale if self.full_scale else math.nan


def gaps(
    selection: Selection, floors: dict[str, float], origins: dict[str, str], seed: int
) -> tuple[Gap, ...]:
    """Return the gap of every output that a fit may see."""
    problem, stages = selection.retuned.problem, _stages(selection)
    return tuple(
        _gap(name, rows, selection, stages, floors[name], origins[name], seed)
        for name, rows in rows_of(problem).items()
    )


def whole_gap(selection: Selection, seed: int) -> GapSummary:
    """Return the gap of all outputs together, in noise floors."""
    stages = _stages(selection)
    return _gap_summary(np.arange(len(selection.before.unseen)), stages, 1.0, 1.0, seed)


def _stages(selection: Selection) -> dict[str, CrossValidation]:
    return dict(
        zip(STAGES, (selection.before, selection.retuned.evidence, selection.taken.evidence))
    )


def rows_of(problem: Problem) -> dict[str, NDArray[np.int64]]:
    """Return which weighted errors belong to each output that a fit may see, by name."""
    rows: dict[str, list[NDArray[np.int64]]] = {}
    for (_, name), record in problem.records.items():
        if record.start < record.stop:
            rows.setdefault(name, []).append(np.arange(record.start, record.stop))
    return {name: np.concatenate(parts) for name, parts in rows.items()}


def not_followed(model: FittedModel, least: float = 0.0) -> tuple[str, ...]:
    """Return outputs that a fitted model hardly follows, missed by ``least`` noise floors."""
    problem, names = model.problem, []
    for name, rows in rows_of(problem).items():
        readings = [log.outputs[name][log.fitted] for log in problem.logs if name in log.outputs]
        motion = float(np.std(np.concatenate(readings))) / problem.sigma[name]
        left = rms(model.evidence.unseen[rows])
        if left > max(model.settings.followed_share * motion, least):
            names.append(name)
    return tuple(names)


def _gap(
    name: str,
    rows: NDArray[np.int64],
    selection: Selection,
    stages: dict[str, CrossValidation],
    floor: float,
    origin: str,
    seed: int,
) -> Gap:
    problem = selection.retuned.problem
    scale = problem.sigma[name]
    logs = [log for log in problem.logs if name in log.outputs]
    measured = np.concatenate([log.outputs[name][log.fitted] for log in logs])
    errors = stages["before"].errors[rows]
    return Gap(
        **vars(_gap_summary(rows, stages, scale, floor, seed)),
        output=name,
        origin=origin,
        full_scale=float(np.ptp(measured)),
        worst=_worst(problem, name, errors),
        delay=_delay(problem, name),
        motion=_motion(selection.taken, name) if origin == RESIDUAL else 0.0,
    )


def _gap_summary(
    rows: NDArray[np.int64],
    stages: dict[str, CrossValidation],
    scale: float,
    floor: float,
    seed: int,
) -> GapSummary:
    """RMS of some weighted errors by stage; ``scale`` is one of them in the unit of ``floor``."""
    counts = np.bincount(stages["before"].parts[rows]).astype(float)
    used = counts > 0.0  # blocks of logs without this output know nothing of it
    counts = counts[used]
    losses = {
        stage: np.bincount(evidence.parts[rows], (scale * evidence.unseen[rows]) ** 2)[used]
        for stage, evidence in stages.items()
    }
    random = np.random.default_rng(seed)
    draws = random.integers(0, len(counts), (DRAWS, len(counts)))
    drawn = {
        s: np.sqrt(v[draws].sum(axis=1) / counts[draws].sum(axis=1)) for s, v in losses.items()
    }
    rms = {s: float(np.sqrt(v.sum() / counts.sum())) for s, v in losses.items()}
    intervals = {s: _interval(v) for s, v in drawn.items()}
    return GapSummary(rms, intervals, floor, _closed(rms, drawn, floor))


def _interval(values: Array) -> tuple[float, float]:
    low, high = np.quantile(values, (0.025, 0.975))
    return float(low), float(high)


def _closed(
    rms: dict[str, float], drawn: dict[str, Array], floor: float
) -> tuple[float, float, float] | None:
    """(before - after) / (before - floor), and its interval."""
    share = closed(rms["before"], rms["after"], floor)
    if share is None:
        return None
    beyond = np.maximum(drawn["before"] - floor, CLEAR * floor)
    low, high = _interval((drawn["before"] - drawn["after"]) / beyond)
    return share, min(low, 1.0), min(high, 1.0)


def _worst(problem: Problem, name: str, errors: Array) -> tuple[str, float]:
    logs = [log for log in problem.logs if name in log.outputs]
    stamps = [(log.name, stamp) for log in logs for stamp in log.stamps[log.fitted].tolist()]
    return stamps[int(np.argmax(np.abs(errors)))]


def _motion(taken: FittedModel, name: str) -> float:
    """Of the log that has the floor: one that moves more has not, or its own would be larger."""
    runs = [run for run in taken.problem.runs if name in run.log.outputs]
    noisiest = max(runs, key=lambda run: difference_noise(run.log.readings.outputs[name]))
    log, column = noisiest.log, list(noisiest.log.outputs).index(name)
    simulated = noisiest.outputs_or_nan(taken.values)[:, column]
    return difference_noise(simulated if log.between is None else simulated[~log.between])


def _delay(problem: Problem, name: str) -> float:
    """Shift of the simulation to which least squares go from no shift; positive: the rig lags.

    Gauss-Newton on the simulated rate: the measured one would carry the noise, which hides a
    part of the delay.
    """
    responses = problem.responses(problem.nominal)
    runs = [
        (log, response[name])
        for log, response in zip(problem.logs, responses)
        if name in log.outputs
    ]
    measured = np.concatenate([log.outputs[name][log.fitted] for log, _ in runs])

    def late(shift: float) -> tuple[Array, Array]:
        """Errors that a shift [s] leaves, and the shifted rate."""
        at = [(log.times[log.fitted] - shift, log.times, values) for log, values in runs]
        values = np.concatenate([np.interp(*one) for one in at])
        rates = [np.interp(t, times, np.gradient(one, times)) for t, times, one in at]
        return values - measured, np.concatenate(rates)

    best = shift = 0.0
    least = math.inf
    for _ in range(SHIFTS):
        errors, rate = late(shift)
        left, power = float(errors @ errors), float(rate @ rate)
        if power == 0.0 or left >= CONVERGED * least:
            break
        best, least = shift, left
        shift += float(errors @ rate) / power
    return best
