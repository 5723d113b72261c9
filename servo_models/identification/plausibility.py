"""Whether the numbers of a description make sense beside its actuator: units, signs, priors.

A column in another unit than is said is off by a large known factor.  Two things tell: the
nominal model then moves otherwise than the log, and moves as the log does once the unit is
another; or the motion leaves the full scale of the actuator.  A judgement takes both sides, so
that a poor model alone is no reason for a warning.  What is asked of a log is then tried: all logs
of one recorder are read as it says, parameters are re-tuned, and what is left decides.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from servo_models.analysis.experiment import in_time
from servo_models.analysis.simulate import simulate
from servo_models.analysis.statistics import rms
from servo_models.core.bounds import is_outside
from servo_models.core.plant import Plant, Wire
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.core.workers import ALONE, Workers
from servo_models.data.audit import Audit, audits, noise_floors
from servo_models.data.description import Description
from servo_models.data.log import Channel, Log
from servo_models.data.mistakes import Mistake
from servo_models.data.outliers import POSITIONS
from servo_models.data.schema import named
from servo_models.data.sensor import outliers
from servo_models.data.signals import moved
from servo_models.errors import UserError
from servo_models.identification.optimise import descend
from servo_models.identification.problem import Problem, prior_parameters
from servo_models.identification.simulation import InternalSteps, prepared
from servo_models.identification.starts import with_starts
from servo_models.units import factor, fitting_unit, other_units, parse

TIME = "time"
UNLIKE = 0.5  # misfit of another motion: 4 of 42 real outputs reach it; a factor of 6 makes 0.68
CLOSE = 0.05  # difference of misfits that count as alike
FAR = 4.0  # ratio of two motions from which one of them is not scaled
FOLLOWS = 0.8  # correlation with the model from which a reading is its output, scaled or turned
DRIFT_DEGREE = 2  # degree of the drift taken off: what a constant torque gives a free motor
ELSEWHERE = 0.5  # distance to the model over its range from which the zero of a reading is off
STEADY = 3.0  # distance over its standard deviation, from which it is in all rows
BEYOND = 3.0  # full scales of a load that no actuator carries
MOST_SUPPLY = 2.0  # supply over the one of a variant above which no motor stands it
LEAST_SUPPLY = 0.2  # supply ratio below which none turns
MOST_PRIOR = 3.0  # standard deviation over a positive value: more says less than no prior
LEAST_DURATION = 0.1  # duration of a log over the response time
NO_BETTER = 0.8  # error of logs as they would be right over that as they stand, if nothing is asked
FAR_BETTER = 0.5  # the same, or the misfit of one log, from which it is surely so
COST_TOLERANCE = 1e-3  # relative decrease of the cost that ends a trial
ALIKE = 1.0 + 10.0 * COST_TOLERANCE  # errors of trials in this ratio are the same
MOST_STEPS = 5  # of a trial
PARTS_OF_ROW = 5  # parts of a row after which an output may have been read
MOST_ROWS = 20  # rows by which an output is looked for earlier or later
LEAST_ROWS = 50  # rows of a log below which chance may prefer others
ANSWERED = 0.05  # distance from the end of a step response over the whole, at which it is answered


@dataclass(frozen=True)
class Correction:
    """Another unit or scale for columns; ``ratio`` is by what their SI values are multiplied."""

    columns: tuple[str, ...]
    ratio: float
    unit: str

    def of(self, log: Log) -> Log:
        """Return the log as it would be read; the time it is held at rest for follows."""
        inputs, outputs = dict(log.inputs), dict(log.outputs)
        for values in (inputs, outputs):
            for name in self.columns:
                if name in values:
                    values[name] = self.ratio * values[name]
        scale = self.ratio if TIME in self.columns else 1.0
        return replace(log, times=scale * log.times, inputs=inputs, outputs=outputs)


def implausible(described: Description, columns: bool = True) -> tuple[str, ...]:
    """Return what makes no sense beside the actuator, one sentence each with the value that would;
    ``columns`` that contradict the model as well, untried.

    Example:
        ``implausible(read_description("mine.toml"))`` is empty where all is well.
    """
    model = described.model
    said = list(_about_priors(described))
    answer = answer_time(model)
    for log in described.logs:
        texts = list(_about_held_inputs(model, log))
        texts += mistaken_columns(model, log, answer) if columns else ()
        said += [f"log '{log.name}': {text}" for text in texts]
    return tuple(said)


def mistaken_columns(model: Model, log: Log, answer: float) -> Iterator[Mistake]:
    """Yield which columns contradict the nominal model by their sign, unit, scale or zero.  The log
    begins as it shows; ``answer`` is the ``answer_time`` of the model [s]."""
    pairs = _compared(model, log)
    against = _against(model, log, pairs)
    told = [*_about_signs(model, log, against)]
    for name in against:
        log = _reread(model, log, name, np.negative)
    pairs = _compared(model, log) if against else pairs
    told += [*_about_rates(model, log, pairs), *_about_units(model, log, pairs, answer)]
    told += _about_zeros(model, log, pairs)
    yield from (it for it in told if not it.is_settled(log))


def implausible_clocks(described: Description) -> tuple[str, ...]:
    """Return which logs are too slow or short for the step response.

    Nothing of the log is simulated, so that it is told before days of simulation begin.
    """
    answer = answer_time(described.model)
    return tuple(
        f"log '{log.name}': {it}"
        for log in described.logs
        for it in _about_clock(described.model, log, answer)
        if not it.is_settled(log)
    )


def _about_clock(model: Model, log: Log, answer: float) -> Iterator[Mistake]:
    interval, most = log.interval, answer / 2.0  # a sample as it moves, and one at the end
    slow, short = interval > most, log.duration < LEAST_DURATION * answer
    if not (slow or short):
        return
    told = _channel(log, TIME).told[1]
    unit = fitting_unit(
        "s",
        told,
        lambda it: it * interval <= most and it * log.duration >= LEAST_DURATION * answer,
    )
    lasts = f"is sampled every {interval:.3g} s" if slow else f"lasts {log.duration:.3g} s"
    cure = "no sample shows how it moves: log faster" if slow else "log longer"
    if unit:
        cure = f'{unit} would make sense: give it time.unit = "{unit}"'
    yield Mistake(
        f"{_column(log, TIME)} is read in {told}, so the log {lasts},"
        f" while '{model.actuator.name}' answers a step in {answer:.3g} s; {cure}",
        [TIME],
    )


# Priors


def _about_priors(described: Description) -> Iterator[str]:
    plant, values = described.model.plant, described.model.values
    texts = named(described.document.section("uncertainty"), "parameter", plant.parameters).content
    for name in texts:
        size, param = described.uncertainty[name], plant.parameters[name].param
        low, high = described.bounds.get(name, (param.low, param.high))
        value = abs(values[name])
        told = f"[uncertainty] {name} = a standard deviation of {size:.4g} {param.unit}"
        cure = f"write a share such as {_share(texts[name])}"
        if size > high - low:
            yield (
                f"{told}, but '{name}' lies between {low:g} and {high:g} {param.unit}: {cure}, or a"
                " size within these bounds"
            )
        elif value and low >= 0.0 and not param.switch and size > MOST_PRIOR * value:
            yield (
                f"{told}, {size / value:.3g} times its value of {value:.4g} {param.unit}: {cure};"
                " leave it out if nothing is known, and name it under free"
            )


def _share(text: object) -> str:
    """The number of an uncertainty as the share that was meant."""
    number = re.match(r"\s*([\d.eE+-]+)", str(text))
    try:
        size = parse(number[1], "1") if number else math.nan
    except UserError:
        size = math.nan
    return f'"{size:g} %"' if 1.0 <= size <= 100.0 else '"30 %"'


# Inputs that stay: supply and load


def _about_held_inputs(model: Model, log: Log) -> Iterator[str]:
    main = model.step[0]
    for wire in model.plant.inputs:
        values = log.inputs.get(wire.name, log.constants.get(wire.name))
        if wire.name == main or wire.flag or values is None or not isinstance(wire.rest, float):
            continue
        level, stated = float(np.median(values)), wire.name in log.constants
        if wire.rest:
            yield from _about_supply(model, log, wire, level)
        elif stated and _is_declared(wire) and abs(level) > BEYOND * wire.scale:
            yield (
                f"'{wire.name}' = {level:g} {wire.unit} is {abs(level) / wire.scale:.3g} times the"
                f" full scale of '{model.actuator.name}', {wire.scale:g} {wire.unit}: give what"
                " the rig has, with its unit"
            )


def _about_supply(model: Model, log: Log, wire: Wire, level: float) -> Iterator[str]:
    rest = float(wire.rest)
    if LEAST_SUPPLY * rest <= level <= MOST_SUPPLY * rest:
        return
    told = log.channels[wire.name].told[1] if wire.name in log.channels else wire.unit
    unit = fitting_unit(
        wire.unit, told, lambda it: LEAST_SUPPLY * rest <= it * level <= MOST_SUPPLY * rest
    )
    cure = f"read in {unit} it would make sense" if unit else f"about {rest:g} makes sense"
    what = "no motor stands that" if level > rest else "that moves no motor"
    yield (
        f"{_column(log, wire.name)} is {level:.4g} {wire.unit}, {level / rest:.3g} times the"
        f" {rest:g} {wire.unit} that variant '{model.variant}' is for: {what}; {cure}"
    )


# Signs of columns


def _against(model: Model, log: Log, pairs: Mapping[str, _Pair]) -> list[str]:
    """Outputs that move as the model does, the other way round."""
    unlike, ways = _unlike(pairs), [pairs]
    # a fitted start hides the sign, so as settled and from rest instead
    if unlike and log.start and log.start.fitted:
        settled = replace(log, start=None)
        ways = [_compared(model, way) for way in (settled, replace(settled, settle=0.0))]
    return [
        name
        for name in unlike
        if any(_follows(way[name].measured, -way[name].response) for way in ways)
    ]


def _follows(measured: Array, response: Array) -> bool:
    return _correlation(measured, response) > FOLLOWS


def _correlation(measured: Array, response: Array) -> float:
    """How well two signals go together, whatever drift an unknown load gives a free motor."""
    drift = np.vander(np.linspace(-1.0, 1.0, len(measured)), DRIFT_DEGREE + 1)
    both = np.column_stack([measured, response])
    both = both - drift @ np.linalg.lstsq(drift, both, rcond=None)[0]
    if not np.all(np.std(both, axis=0)):
        return 0.0
    return float(np.corrcoef(both[:, 0], both[:, 1])[0, 1])


def _about_signs(model: Model, log: Log, against: Sequence[str]) -> Iterator[Mistake]:
    moving = [name for name, values in log.inputs.items() if np.ptp(values) > 0.0]
    for name in against:
        cure = "give it sign = -1"
        if _channel(log, name).scale < 0.0:
            cure = "leave out its sign = -1, or the minus of its scale"
        every = len(against) == sum(not model.plant.wire[it].flag for it in log.outputs)
        if every and len(moving) == 1:
            cure += f"; or turn the sign of {_column(log, moving[0])}"
        turned = partial(_reread, model, name=name, change=np.negative)
        text = f"{_column(log, name)} goes against the command: {cure}"
        yield Mistake(text, [name], turned, everywhere=True)


def _reread(model: Model, log: Log, name: str, change: Callable[[Array], Array]) -> Log:
    """The log with an output read otherwise, and with the start that it then shows."""
    return _begun(model, replace(log, outputs={**log.outputs, name: change(log.outputs[name])}))


def _begun(model: Model, log: Log) -> Log:
    """The log with the start that its changed columns show."""
    if log.start and log.start.fitted:
        (log,) = with_starts(model, [replace(log, start=None, assumed=True)])
    return log


# Columns of something else


def _about_rates(model: Model, log: Log, pairs: Mapping[str, _Pair]) -> Iterator[Mistake]:
    """Readings that go together with the rate of what they are read as, rather than with it."""
    for name in _unlike(pairs):
        measured, response, rate = pairs[name]
        if _correlation(measured, rate) > max(_correlation(measured, response), 0.0):
            yield Mistake(
                f"{_column(log, name)} moves as the rate of '{name}' does: read it as a rate,"
                " or read the column that was measured",
                [name],
                partial(_summed, model, name=name),
                everywhere=True,
            )


def _summed(model: Model, log: Log, name: str) -> Log:
    """The log with an output summed up over time, from where the model is."""
    rates, response = log.outputs[name], _compared(model, log)[name].response
    steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(log.times)
    sums = np.concatenate([[0.0], np.cumsum(steps)])
    sums += np.median(response) - np.median(sums)
    return replace(log, outputs={**log.outputs, name: sums})


def _about_zeros(model: Model, log: Log, pairs: Mapping[str, _Pair]) -> Iterator[Mistake]:
    """Positions with another zero than the model's, that move alike; a load moves that of a drive
    and of its current."""
    for name, pair in pairs.items():
        si, unit = model.plant.wire[name].unit, _channel(log, name).told[1]
        apart = pair.measured - pair.response
        off = float(np.median(apart))
        least = max(ELSEWHERE * np.ptp(pair.response), STEADY * np.std(apart))
        if si in POSITIONS and pair.misfit < UNLIKE and abs(off) > least:
            to_unit = factor(si, unit)
            offset = (_channel(log, name).offset - off) * to_unit
            yield Mistake(
                f"{_column(log, name)} moves as the model does, but {off * to_unit:.4g} {unit} off:"
                f" its zero is elsewhere; give it offset = {offset:.4g}",
                [name],
                partial(_reread, model, name=name, change=partial(np.add, -off)),
                everywhere=True,
            )


# Units of columns


def _about_units(
    model: Model, log: Log, now: Mapping[str, _Pair], answer: float
) -> Iterator[Mistake]:
    """A sentence on the columns whose unit or scale makes no sense."""
    wires = model.plant.wire
    sensible: list[tuple[float, float, Correction]] = []
    for correction in _corrections(model, log, now, answer) if now else ():
        changed = correction.of(log)
        if any(is_outside(it, wires[name]).any() for name, it in changed.inputs.items()):
            continue
        then = _compared(model, changed)
        if _makes_sense(log, correction, now, then):
            sensible.append((_misfit(then), _strangeness(model.plant, changed), correction))
    if not sensible:
        return
    counts = [one for *_, one in sensible if not one.unit and TIME not in one.columns]
    # a unit is a better cure than a figure
    sensible = [row for row in sensible if row[2] not in counts] or sensible
    least = min(misfit for misfit, *_ in sensible)
    alike = [row for row in sensible if row[0] <= least + CLOSE]
    alike.sort(key=lambda row: row[1])
    told = [correction for *_, correction in alike]

    def mended(log: Log) -> Log:
        return _begun(model, told[0].of(log))

    yield Mistake(_sentence(log, told, counts), told[0].columns, mended, everywhere=True)


def _sentence(log: Log, corrections: Sequence[Correction], counts: Sequence[Correction]) -> str:
    """The first correction, one of other columns that would do as well, and one by a figure."""
    first, *others = corrections
    other = next((one for one in others if not set(one.columns) & set(first.columns)), None)
    texts = [_cure(log, one) for one in ((first, other) if other else (first,))]
    count = next((one for one in counts if one.columns == first.columns and first.unit), None)
    if count:
        told, unit = _channel(log, count.columns[0]).told
        size = f"scale = {count.ratio * told:.4g}"
        texts.append(f"{size} in {unit or 'SI'} where its numbers are counts")
    return ", or else ".join(texts) + "; as it stands the log contradicts the model and its scale"


def _cure(log: Log, correction: Correction) -> str:
    names = " and ".join(_column(log, name) for name in correction.columns)
    channel = _channel(log, correction.columns[0])
    verb, them = ("is", "it") if len(correction.columns) == 1 else ("are", "them")
    if correction.unit:
        key = "time.unit" if TIME in correction.columns else "unit"
        return (
            f"{names} {verb} read in {channel.told[1]}, but {correction.unit} would make sense:"
            f' give {them} {key} = "{correction.unit}"'
        )
    told, unit = channel.told
    if TIME in correction.columns:
        return (
            f"{names} runs about {1.0 / correction.ratio:.2g} times too slowly for the model, as"
            " the number of a row may: read the column with the times"
        )
    return (
        f"{names} {verb} not scaled: the model moves {correction.ratio:.3g} times as far; give"
        f" {them} scale = {correction.ratio * told:.4g} ({unit or 'SI units'} per count)"
    )


def _column(log: Log, name: str) -> str:
    channel = log.channels.get(name)
    return f"column '{channel.column}' ('{name}')" if channel else f"'{name}'"


def _channel(log: Log, name: str) -> Channel:
    return log.channels.get(name, Channel(name, name, "s" if name == TIME else ""))


def _corrections(
    model: Model, log: Log, now: Mapping[str, _Pair], answer: float
) -> Iterator[Correction]:
    """What else the columns could be, the cheap ones first."""
    unlike = _unlike(now)
    every = {
        name: other_units(model.plant.wire[name].unit, _channel(log, name).told[1])
        for name in (*log.inputs, *log.outputs)
        if not model.plant.wire[name].flag
    }
    singles = [*(name for name in log.inputs if name in every and unlike), *unlike]
    for name in singles:
        for unit, ratio in every[name]:
            yield Correction((name,), ratio, unit)
    yield from _unscaled({name: now[name] for name in unlike})
    if unlike:
        yield from _together(model.plant, every)
    yield from _other_times(log, _misfit(now), answer)


def _together(
    plant: Plant, every: Mapping[str, Sequence[tuple[str, float]]]
) -> Iterator[Correction]:
    """Columns of one quantity that could all be in another unit, such as degrees."""
    sharing: dict[tuple[str, float], list[tuple[str, str]]] = {}
    for name, units in every.items():
        for unit, ratio in units:
            sharing.setdefault((plant.wire[name].unit, ratio), []).append((name, unit))
    for (_, ratio), columns in sharing.items():
        if len(columns) > 1:
            shared = '" and "'.join(dict.fromkeys(unit for _, unit in columns))
            yield Correction(tuple(name for name, _ in columns), ratio, shared)


def _unscaled(pairs: Mapping[str, _Pair]) -> Iterator[Correction]:
    """Outputs that follow the model but are larger or smaller by any factor."""
    for name, (measured, response, _) in pairs.items():
        if np.std(measured) and _follows(measured, response):
            ratio = float(np.std(response) / np.std(measured))
            if not 1.0 / FAR < ratio < FAR:
                yield Correction((name,), ratio, "")


def _other_times(log: Log, misfit: float, answer: float) -> Iterator[Correction]:
    """Shorter ones, and longer ones where the log is over at once."""
    for unit, ratio in other_units("s", _channel(log, TIME).told[1]):
        longer = log.duration < answer and misfit > UNLIKE
        if (ratio < 1.0 or longer) and 2.0 * ratio * log.interval < answer:
            yield Correction((TIME,), ratio, unit)
    ratio = 1.0 / (2.0 * FAR)  # four times slower may be a rig
    while ratio * log.duration > answer:
        yield Correction((TIME,), ratio, "")
        ratio /= 2.0


def _makes_sense(
    log: Log, correction: Correction, now: Mapping[str, _Pair], then: Mapping[str, _Pair]
) -> bool:
    """Whether a log fits far better with a correction."""
    first, *others = correction.columns
    touched = list(now) if others or first not in log.outputs else [first]
    before = float(np.mean([now[name].misfit for name in touched]))
    after = float(np.mean([then[name].misfit for name in touched]))
    known = after < UNLIKE if TIME in correction.columns else before > UNLIKE
    return known and after < FAR_BETTER * before


def _is_declared(wire: Wire) -> bool:
    """Whether somebody has said how large a signal is at full scale; 1 in SI is nobody's word."""
    return wire.scale != Wire.scale


def _strangeness(plant: Plant, log: Log) -> float:
    """How far the columns are from the full scale of their signals, in orders of e."""
    columns = {**log.inputs, **log.outputs}
    wires = [plant.wire[name] for name in columns if not plant.wire[name].flag]
    spans = [(float(np.ptp(columns[wire.name])), wire.scale) for wire in wires]
    return sum(abs(math.log(span / scale)) for span, scale in spans if span > 0.0)


# When outputs were read


def _about_instants(model: Model, log: Log) -> Iterator[Mistake]:
    """Outputs that were read with another command of their row, or late beside the position; of
    the instants that are possible, those that leave less beside the nominal model.

    They are many, and to be tried.
    """
    wires, position = model.plant.wire, model.plant.wire[model.plant.outputs[0]]
    pairs = _compared(model, log)
    if not pairs:
        return
    first = min(pairs, key=lambda name: wires[name].unit != position.unit)
    lead = _late(log, first, pairs[first])
    for name, pair in pairs.items():
        # a position that was read later is one of a model that is slower
        parts = np.arange(1 if name == first else PARTS_OF_ROW) / PARTS_OF_ROW
        for after in (None, *(float(it) for it in log.interval * parts)):
            read = partial(_read, name=name, after=after)
            if _compared(model, read(log))[name].misfit < NO_BETTER * pair.misfit:
                said, cure = "before", "leave out its after_command"
                if after is not None:
                    said, cure = "after", f'give it after_command = "{1e3 * after:.4g} ms"'
                text = f"moves as if it was read {said} the command of its row was written: {cure}"
                yield Mistake(f"{_column(log, name)} {text}", [name], read, everywhere=True)
        late = _late(log, name, pair)
        # early by a part of a row is read after its command; of a delay, all outputs are late
        if -log.interval < late <= 0.0 or late * (late - 2.0 * lead) <= 0.0:
            continue
        channel, rows = _channel(log, name), late / log.interval
        possible = math.floor(rows) + np.arange(PARTS_OF_ROW + 1) / PARTS_OF_ROW
        for each in possible[possible != 0.0]:
            since = (channel.after_command or 0.0) / log.interval - each  # the command of its row
            by, part = math.floor(since) * log.interval, (since % 1.0) * log.interval
            off = f"{in_time(abs(each * log.interval))} {'early' if each < 0.0 else 'late'}"
            cure = f'give it shift = "{1e3 * (channel.shift + by):.4g} ms"'
            exact = part == 0.0 and channel.after_command is None
            cure += "" if exact else f' and after_command = "{1e3 * part:.4g} ms"'
            yield Mistake(
                f"{_column(log, name)} is {off}, while '{first}' is not: {cure}",
                [name],
                partial(_read, name=name, after=None if exact else part, by=by),
                everywhere=True,
            )


def _read(log: Log, name: str, after: float | None, by: float = 0.0) -> Log:
    """The log with an output that was read at another time in its row, and with stamps that are so
    much earlier [s]; see ``Channel``."""
    channel = replace(_channel(log, name), after_command=after)
    values = moved(by, log.times, log.outputs[name], hold=False)
    outputs, channels = {**log.outputs, name: values}, {**log.channels, name: channel}
    return replace(log, outputs=outputs, channels=channels)


def _late(log: Log, name: str, pair: _Pair) -> float:
    """By how many seconds an output is late beside the model, 0 where it is then hardly nearer."""
    times = log.times[outliers(log.outputs[name]) == 0.0]

    def left(rows: float) -> float:
        values = moved(-rows * log.interval, times, pair.measured, hold=False)
        return rms(values - pair.response)

    errors = np.array([left(row) for row in range(-MOST_ROWS, MOST_ROWS + 1)])
    best = int(np.argmin(errors))
    if len(log.times) < LEAST_ROWS or not 0 < best < 2 * MOST_ROWS:
        return 0.0
    before, least, after = errors[best - 1 : best + 2] ** 2
    between = 0.5 * (before - after) / (before - 2.0 * least + after)  # vertex of a parabola
    rows = min(best - MOST_ROWS, best - MOST_ROWS + between, key=left)
    return float(rows * log.interval) if left(rows) < NO_BETTER * errors[MOST_ROWS] else 0.0


# The nominal model beside a log


class _Pair(NamedTuple):
    """Readings of an output and what the nominal model gives, without outliers, shapes (n,)."""

    measured: Array
    response: Array
    rate: Array

    @property
    def misfit(self) -> float:
        """Mean squared difference over the power of both, each without its mean.

        0 for the same motion, near 1 where one hardly moves beside the other, whichever that is.
        """
        measured, response, _ = (values - np.mean(values) for values in self)
        power = float(np.mean(measured**2) + np.mean(response**2))
        misfit = float(np.mean((measured - response) ** 2)) / power if power != 0.0 else 0.0
        return misfit if math.isfinite(misfit) else math.inf


def _compared(model: Model, log: Log) -> dict[str, _Pair]:
    """Outputs that are no flags; NaN where the model cannot be simulated."""
    try:
        outputs = prepared(model, log).outputs_or_nan({})
    except UserError:
        outputs = np.full((len(log.times), len(log.outputs)), np.nan)
    pairs = {}
    for (name, measured), response in zip(log.outputs.items(), outputs.T):
        if not model.plant.wire[name].flag:
            usual, rate = outliers(measured) == 0.0, np.gradient(response, log.times)
            pairs[name] = _Pair(measured[usual], response[usual], rate[usual])
    return pairs


def _unlike(pairs: Mapping[str, _Pair]) -> list[str]:
    return [name for name, pair in pairs.items() if pair.misfit > UNLIKE]


def _misfit(pairs: Mapping[str, _Pair]) -> float:
    return float(np.mean([pair.misfit for pair in pairs.values()]))


def answer_time(model: Model) -> float:
    """Time [s] in which the first output answers the standard step; that of its run at most."""
    name, size = model.step
    times = np.linspace(0.0, model.stop_time, 1001)  # a time is needed to a percent
    try:
        response = simulate(model, times, {name: size})[model.plant.outputs[0]]
    except UserError:
        return model.stop_time
    whole = float(np.ptp(response))
    late = np.flatnonzero(np.abs(response - response[-1]) > ANSWERED * whole)
    return float(times[late[-1] + 1]) if whole > 0.0 and len(late) else model.stop_time


# Mistakes that are tried: all logs of one recorder are read as one says, and parameters re-tuned

Tried = Mapping[Mistake, float]
"""By mistake the error that re-tuned parameters leave of the logs as they would be right."""


def questions(told: Description) -> tuple[Audit, ...]:
    """Audits of the logs, with the columns that contradict the model among the mistakes."""
    model, answer = told.model, answer_time(told.model)

    def asked(log: Log) -> Iterator[Mistake]:
        yield from mistaken_columns(model, log, answer)
        yield from (it for it in _about_instants(model, log) if not it.is_settled(log))

    return tuple(
        replace(it, mistakes=(*it.mistakes, *asked(it.log)))
        for it in audits(told.logs, model.plant)
    )


def tried(
    told: Description, asked: Sequence[Audit], workers: Workers = ALONE, columns: bool = False
) -> Tried:
    """Try every mistake of which another reading is known, or those of whole ``columns``; what is
    asked of several logs, once."""
    return {
        mistake: _retuned(told, partial(mended, told.logs, asked, mistake), workers)
        for mistake in dict.fromkeys(it for audit in asked for it in audit.mistakes)
        if mistake.mended and (mistake.everywhere or not columns)
    }


def likely(
    told: Description, asked: Sequence[Audit], workers: Workers = ALONE
) -> tuple[Audit, ...]:
    """Audits without what is asked of a whole column though the logs are no better read otherwise.

    What is asked of single rows stays: without them nothing says how well they would fit.
    """
    errors = tried(told, asked, workers, columns=True)
    most = NO_BETTER * _retuned(told, lambda: told.logs, workers) if errors else np.inf

    def kept(audit: Audit) -> Iterator[Mistake]:
        """Of several readings of a column, the first of those that leave the least."""
        said: set[tuple[str, ...]] = set()
        for it in audit.mistakes:
            rivals = [errors[m] for m in audit.mistakes if m in errors and m.columns == it.columns]
            if it not in errors:
                yield it
            elif errors[it] <= min(most, ALIKE * min(rivals)) and it.columns not in said:
                said.add(it.columns)
                yield it

    return tuple(replace(it, mistakes=tuple(kept(it))) for it in asked)


def mended(logs: Sequence[Log], asked: Sequence[Audit], mistake: Mistake) -> list[Log]:
    """The logs as they would be right: all that read the columns alike, or of whose rows something
    is asked in the same columns."""
    of = next(log for log, audit in zip(logs, asked) if mistake in audit.mistakes)

    def right(log: Log, audit: Audit) -> Log:
        alike = [of.channels.get(it) == log.channels.get(it) for it in mistake.columns]
        own = [it for it in audit.mistakes if it.mended and it.columns == mistake.columns]
        if log is of or (mistake.everywhere and all(alike)):
            own = [mistake]
        return own[0].mended(log) if own and own[0].mended else log

    return [right(log, audit) for log, audit in zip(logs, asked)]


def _retuned(told: Description, read: Callable[[], Sequence[Log]], workers: Workers) -> float:
    """Error that re-tuned parameters leave of logs, see ``error``; infinite where these cannot be
    so, or not be simulated."""
    try:
        model, logs = told.model, read()
        floors = noise_floors(audits(logs, model.plant))
        steps = InternalSteps(model, floors)
        problem = Problem(model, logs, prior_parameters(told), floors, workers, steps=steps)
        vector = problem.start
        if problem.free:
            vector, _, _ = descend(problem, vector, COST_TOLERANCE, MOST_STEPS)
        return error(problem, vector)
    except UserError:
        return np.inf


def error(problem: Problem, vector: Array) -> float:
    """RMS error over the standard deviation of the readings that a fit sees, over all outputs, so
    of any scale; infinite where such a log cannot be simulated."""
    parts: dict[str, list[Array]] = {}
    for run in problem.runs:
        seen, simulated = run.log.fitted, run.outputs_or_nan(problem.values(vector)).T
        for (name, measured), column in zip(run.log.outputs.items(), simulated):
            parts.setdefault(name, []).append(np.stack([measured[seen], column[seen]]))
    both = (np.concatenate(each, axis=1) for each in parts.values())
    shares = [rms(b - a) / float(np.std(a)) for a, b in both if len(a) and np.ptp(a) > 0.0]
    found = rms(np.array(shares)) if shares else np.inf
    return found if np.isfinite(found) else np.inf
