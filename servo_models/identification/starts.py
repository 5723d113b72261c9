"""How a log begins: at rest, settled at its first row, as the command steps, or in motion.

A description may say it (``start``).  Else the first samples do: a log begins at rest, or settled
where its first row is not at rest, as long as they agree.  Where they are somewhere else, or move,
the other ways are simulated, and the simplest one that meets the first part of the log is taken.
What a model lacks shows when it moves, so only readings decide that a log begins otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from servo_models.analysis.experiment import shown
from servo_models.core.bounds import inside
from servo_models.core.plant import Wire
from servo_models.core.simulate import Model, Shaft
from servo_models.core.types import Array
from servo_models.data.audit import audits
from servo_models.data.log import Log, Start
from servo_models.errors import UserError
from servo_models.identification.simulation import (
    OFF_AT_FIRST,
    Run,
    begins_elsewhere,
    prepared,
)

SLOPE_SAMPLES = 6  # fewest readings of which a parabola tells the rate at first
SLOPE_SPAN = 0.2  # the most that they take, over the response time
STRAIGHT = 1.5  # noise floors that a parabola may leave; where it leaves more, a shorter one
SURE_SIGMAS = 5.0  # standard errors of a rate from which a log begins in motion
MOVED = 0.1  # least move in a response time over the range of a reading, of a log in motion
TURNS_ON = (0.5, 1.1)  # mean over last rate, second half of a hold: 0.75 speeds up, 1 full speed
SIMPLER_SQUARES = 1.3  # squared errors over the least, up to which a simpler start is taken
NO_STEP_SQUARES = 0.5  # squared errors from rest over settled ones, below which it begins at rest
STILL = 1e-3  # part of full scale up to which a shaft stands still, or an angle does not answer
NOTHING = 1e-6  # part of full scale up to which a start is told as 0
WORSE_SQUARES = 4.0  # squared errors from the stated start over the seen one, at which it is wrong
OTHER_ANGLE = 0.05  # least distance of another start over the way of the shaft in the first part
OTHER_RATE = 0.3  # least difference over its fastest rate: readings that begin to move seem fast


def with_starts(model: Model, logs: Sequence[Log]) -> tuple[Log, ...]:
    """Return logs that say how they begin, found from their first samples where nobody has said it.

    What is found otherwise than at rest or settled at the first row stands in their ``notes``.
    ``model`` has nominal values.
    """
    return tuple(_with_start(model, log) for log in logs)


def _with_start(model: Model, log: Log) -> Log:
    asked = log.start is not None and log.start.fitted and not (log.start.shaft or log.start.before)
    if not (asked or log.assumed) or not log.outputs:
        return log
    if asked:
        ways = list(_fitted(model, log))
    elif _begins_otherwise(model, log):
        ways = [log, _plain(model, log), *_fitted(model, log)]
    elif log.settle > 0.0 and not _seen(model, log):
        ways = [_plain(model, log)]
        if _squares(model, ways[0]) >= NO_STEP_SQUARES * _squares(model, log):
            return log
    else:
        return log
    # the first way, from simple to fitted, that is hardly worse than the best one
    squares = [_squares(model, way) for way in ways]
    most = SIMPLER_SQUARES * min(squares)
    taken = next(way for way, it in zip(ways, squares) if it <= most)
    if taken is log:
        return log
    return replace(taken, notes=(*log.notes, _words(model, taken, asked)))


def _squares(model: Model, log: Log) -> float:
    """Squares of the errors over the ranges of readings, in the first part of a log."""
    run = prepared(model, log)
    early = log.times <= model.stop_time
    try:
        simulated = run.outputs({})[early]
    except UserError:
        return np.inf
    measured = np.column_stack(list(log.outputs.values()))
    reach = np.ptp(measured, axis=0)
    reach[reach == 0.0] = 1.0
    return float(np.sum(((simulated - measured[early]) / reach) ** 2))


# What the first samples say


def _seen(model: Model, log: Log) -> str:
    """The output that reads where the shaft is, "" for none."""
    wires = model.plant.wire
    unit = wires[model.plant.outputs[0]].unit
    return next((name for name in log.outputs if wires[name].unit == unit), "")


def _begins_otherwise(model: Model, log: Log) -> bool:
    """Whether the first readings are elsewhere than the model, or move, or it settles nowhere."""
    run = prepared(model, log)
    if _turns_on(run) or begins_elsewhere(run, {}):
        return True
    name = _seen(model, log)
    if not name:
        return False
    rate, error = _first_rate(model, log, name)
    far = abs(rate) * model.stop_time > MOVED * np.ptp(log.outputs[name])
    return bool(far and abs(rate) > SURE_SIGMAS * error)


def _turns_on(run: Run) -> bool:
    """Whether a model for which the first row is held turns on and on, as a free motor does."""
    plant, shaft, hold = run.model.plant, run.model.shaft, run.log.settle
    if shaft is None or hold <= 0.0:
        return False
    times = np.array([0.0, 0.5, 1.0]) * hold
    rows = np.repeat(run.inputs[:1], len(times), axis=0)
    out = run.model.from_rest(run.model.vector, times, rows)
    _, middle, end = out[:, plant.outputs.index(shaft.angle)]
    steady = 0.5 * hold * out[-1, plant.outputs.index(shaft.rate)]
    moves = abs(steady) > STILL * plant.wire[shaft.angle].scale
    least, most = TURNS_ON  # one that slows down has more, one that swings about a place less
    return bool(moves and least < (end - middle) / steady < most)


def _first_rate(model: Model, log: Log, output: str) -> tuple[float, float]:
    """Slope [SI/s] of a reading as a log begins, and its standard error."""
    (audit,) = audits([log], model.plant)
    noise = next(it.floor.value for it in audit.readings if it.name == output)
    count = int(np.searchsorted(log.times, SLOPE_SPAN * model.stop_time))
    while True:
        count = min(max(count, SLOPE_SAMPLES), len(log.times))
        design = np.vander(log.times[:count] / log.times[count - 1], 3, increasing=True)
        readings = log.outputs[output][:count]
        coefficients, *_ = np.linalg.lstsq(design, readings, rcond=None)
        left = float(np.sqrt(np.sum((readings - design @ coefficients) ** 2) / (count - 3)))
        if left <= STRAIGHT * noise or count <= SLOPE_SAMPLES:
            break
        count //= 2
    spread = noise * float(np.sqrt(np.linalg.inv(design.T @ design)[1, 1]))
    return float(coefficients[1]) / log.times[count - 1], spread / log.times[count - 1]


# The ways in which it may begin


def _plain(model: Model, log: Log) -> Log:
    """At rest where it was taken as settled, or the other way round."""
    hold = 0.0 if log.settle > 0.0 else min(model.stop_time, log.duration)
    return replace(log, settle=hold, start=None)


def _fitted(model: Model, log: Log) -> Iterator[Log]:
    """As a command steps that was held before, and in motion; either is fitted."""
    hold = log.settle or min(model.stop_time, log.duration)
    shaft = model.shaft
    if shaft is None:
        return
    seen = _seen(model, log)
    before = _held_before(model, log, shaft, hold) if seen else {}
    if before:
        yield replace(log, settle=hold, start=Start(before=before, fitted=True))
    motion = {shaft.angle: 0.0, shaft.rate: 0.0, **dict.fromkeys(shaft.carried, 0.0)}
    if seen:
        motion[shaft.angle] = float(log.outputs[seen][0])
        motion[shaft.rate], _ = _first_rate(model, log, seen)
    yield replace(log, settle=hold, start=Start(shaft=motion, fitted=True))


def _held_before(model: Model, log: Log, shaft: Shaft, hold: float) -> dict[str, float]:
    """The command at which the model settles where the log begins; none if it settles nowhere."""
    command, size = model.step
    if command not in log.inputs:
        return {}
    wire = model.plant.wire[command]
    run = prepared(model, replace(log, settle=hold, start=None))
    ends = {value: _settled(run, shaft, command, value) for value in (float(wire.rest), size)}
    (low, at_low), (high, at_high) = ends.items()
    full = model.plant.wire[shaft.angle].scale
    if at_low is None or at_high is None or abs(at_high - at_low) < STILL * full:
        return {}
    first = float(log.outputs[_seen(model, log)][0])
    value = low + (first - at_low) / (at_high - at_low) * (high - low)
    return {command: inside(value, wire)}


def _settled(run: Run, shaft: Shaft, command: str, value: float) -> float | None:
    """The angle at which the model settles at a command; None where it goes on."""
    plant = run.model.plant
    row = run.inputs[0].copy()
    row[[wire.name for wire in plant.inputs].index(command)] = value
    times = np.array([0.0, run.log.settle])
    out: Array = run.model.from_rest(run.model.vector, times, np.array([row, row]))[-1]
    angle, rate = (out[plant.outputs.index(name)] for name in (shaft.angle, shaft.rate))
    moves = abs(rate) > STILL * plant.wire[shaft.rate].scale
    return None if moves else float(angle)


# What a description states, beside what the first samples show


def false_statements(model: Model, logs: Sequence[Log]) -> dict[str, tuple[str, Log]]:
    """Return what is wrong with stated starts, by the name of the log.

    Returns:
        a sentence with its cure, and the log as its first samples show that it begins.
    """
    wrong = {}
    for log in logs:
        if log.assumed or not log.outputs or (log.start is not None and log.start.fitted):
            continue
        (shown,) = with_starts(model, [replace(log, start=None, assumed=True, notes=())])
        if shown.start == log.start and shown.settle == log.settle:
            continue
        stated, likely = _first_part(model, log), _first_part(model, shown)
        worse = _is_worse(log, stated, likely, model.plant.outputs)
        if worse and _is_another(model, stated[0], shown, likely):
            wrong[log.name] = _sentence(model, log, shown), shown
    return wrong


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
    checks = [(shaft.angle if shaft else outputs[0], OTHER_ANGLE * np.ptp(likely, axis=0))]
    checks += [(shaft.rate, OTHER_RATE * np.abs(likely).max(axis=0))] if shaft else []
    for name, least in checks:
        column = outputs.index(name)
        off = abs(first[column] - seen.get(name, likely[0, column]))
        if not off <= least[column]:  # NaN is another as well
            return True
    return False


def _sentence(model: Model, log: Log, shown: Log) -> str:
    wires = model.plant.wire
    told = _plainly(log)
    if log.start:
        told = f"is at {_listed(log.start.shaft, wires)} by its 'start'"
    if not shown.start:
        seen = f"that it {_plainly(shown)}"
    elif shown.start.before:
        seen = f"that about {_listed(shown.start.before, wires)} had been held before"
    else:
        seen = f"about {_listed(shown.start.shaft, wires)}"
    return (
        f"log '{log.name}' begins in another state than the model, which {told}: its first samples"
        f" show {seen}; correct 'start', or leave it out"
    )


# Words


def _words(model: Model, log: Log, asked: bool) -> str:
    """How a log was found to begin; that it may be wrong, unless it was ``asked`` for."""
    wires, cure = model.plant.wire, "" if asked else "; state it by 'start' if that is wrong"
    if log.start is None:
        return f"its first samples show that it {_plainly(log)}{cure}"
    if log.start.before:
        held = _listed(log.start.before, wires)
        begins = f"as the command steps: about {held} had been held before"
    else:
        begins = f"at about {_listed(log.start.shaft, wires)}"
    return (
        f"its first samples and the nominal parameters together say that it begins {begins}, which"
        f" every fit estimates{cure}"
    )


def _plainly(log: Log) -> str:
    """How a log without a start begins."""
    return "is settled at its first row" if log.settle else "begins at rest"


def _listed(values: Mapping[str, float], wires: Mapping[str, Wire]) -> str:
    """Values [SI] of signals, in units that a person reads."""
    told = []
    for name, value in values.items():
        size = value if abs(value) > NOTHING * wires[name].scale else 0.0
        told.append(f"{name} {shown(wires[name], size, 3)}")
    return " and ".join(told)
