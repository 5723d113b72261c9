"""Mistakes of logging: what no actuator does to a column, but people and their tools do.

Each of them makes a diagnosis find a cause that is not there.  Everything is read off the log
alone, from what a sensor cannot do: noise that vanishes, a position that leaps, an answer that
comes before its command.  So each is a question until a model is fitted to the log as it would be
right (``identification.plausibility``); but for a copy, rows that repeat, a filter or an average:
the column shows these better than any model could.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.data.outliers import AFTER, BEFORE, POSITIONS, told
from servo_models.data.sensor import (
    difference_noise,
    median_deviation,
    off_neighbours,
    runs,
    usual_width,
)

LEAST_ROWS = 50  # rows below which chance looks like a mistake
EQUAL = 1e-9  # difference over the range up to which two readings are the same
REPEATS = 0.1  # share of rows that repeat the one before, up to which noise is seen in a reading
HELD_ROWS = 12  # rows for which a reading with noise does not repeat itself by chance
STEPS_OF_NOISE = 2.0  # noise over reading step from which readings change from row to row at rest
STUCK_SHARE = 0.1  # share of all rows at one value, in one piece, above which a reading is stuck
STRAIGHT = 1e-5  # distance over the range up to which readings lie on a line
BENT = 20.0  # second difference elsewhere over that on a line, above which rows were put between
LEAP_RATIO = 5.0  # size of a leap over the largest other step, or the reading step, at least
LEAST_LEAP = 0.1  # size of a leap over the range, at least
MOST_LEAPS = 40  # leaps in a log, at most: more are how it moves
MOST_RUNS = 2  # equal leaps that joined runs may have by chance: a coarse sensor makes more
ANSWERED = 0.3  # median response to jumps of a command over the largest, if leaps are answers
SAME_LEAP = 0.15  # deviation of leaps from their median, relative, up to which they are equal
WRAPPED = 0.6  # size of a leap over the range above which a counter begins anew
PLACEHOLDERS = 3  # rows of one number far outside the range of the others, if it is no reading
JUMP = 0.05  # change between two rows over the range above which a command jumps
AHEAD_ROWS = (64, 40, 24, 16, 10, 6, 4)  # rows before a jump in which an answer comes too early
LEAST_JUMPS = 2  # jumps of a command at which an answer before them is no accident
QUIET = 3  # rows before these for which the command stands, over their number
SUDDEN = 4.0  # motion ahead of jumps over that before it, and over its noise
LOADS = ("N", "N.m")  # units of inputs that are no command
AVERAGED = -0.35  # correlation of third differences below which readings are means; -1/2 in theory
ELSE_AVERAGED = 0.6  # correlation elsewhere over this one, at most, if readings are means
CLIPPING = "is clipped"
CLIPPED_NOISE = 3.0  # standard deviations to which third differences are cut: a jump counts little
NO_KINK = 0.8
"""Correlation of fourth differences from row to row from which there is no kink: -4/5 in white
noise, 0 at a kink, 2/3 behind a filter of second order."""
STANDS = 0.15  # share of rows at the end in which a reading stands though its command moves
STILL = 8.0  # width of a reading that stands over its noise, at most
LONGER = 5.0  # width of a reading over that at rest from which it has moved before
AS_FAR = 0.3  # range of the command meanwhile over that in the whole log, at least

Mend = Callable[[Log], Log]


class Mistake(str):
    """What may be wrong with a column, in a sentence with its cure: a question until it is tried.

    Attributes:
        columns: signals that it is about; none for whole rows.
        mended: returns the log as it would be right; None for what no reading of the log can try,
            since it alone shows what no actuator makes.
        everywhere: it holds for every log that reads these columns alike, not for rows of this one.
    """

    columns: tuple[str, ...]
    mended: Mend | None
    everywhere: bool

    def __new__(
        cls,
        text: str,
        columns: Iterable[str] = (),
        mended: Mend | None = None,
        everywhere: bool = False,
    ) -> Mistake:
        mistake = super().__new__(cls, f"{text}; if it is right as it stands, add checked = true")
        mistake.columns, mistake.mended, mistake.everywhere = tuple(columns), mended, everywhere
        return mistake

    def is_settled(self, log: Log) -> bool:
        """Whether the description says that these columns have been checked."""
        known = log.channels
        names = self.columns or (*log.inputs, *log.outputs)
        return all(name in known and known[name].checked for name in names)


def _without(rows: Mask) -> Mend:
    """The log without these rows in a fit."""

    def mended(log: Log) -> Log:
        skipped = ~log.counted
        skipped[log.read] |= rows
        return replace(log, skipped=skipped)

    return mended


def _with_output(name: str, values: Array) -> Mend:
    def mended(log: Log) -> Log:
        found = log.outputs[name].copy()
        found[log.read] = values
        return replace(log, outputs={**log.outputs, name: found})

    return mended


def _exchanged(output: str, command: str) -> Mend:
    """A log with the numbers of two columns exchanged."""

    def mended(log: Log) -> Log:
        one, two = log.channels[output], log.channels[command]
        read = (log.inputs[command] - two.offset) / two.scale * one.scale + one.offset
        sent = (log.outputs[output] - one.offset) / one.scale * two.scale + two.offset
        return replace(
            log,
            inputs={**log.inputs, command: sent},
            outputs={**log.outputs, output: read},
        )

    return mended


def mistakes(log: Log, plant: Plant, steps: Mapping[str, float]) -> Iterator[Mistake]:
    """Yield what is wrong with the columns of a log, one sentence each with its cure; ``steps``
    are the reading steps of outputs [SI], 0 for none.

    Example:
        >>> list(mistakes(log, plant, {}))
        ["'angle' reads -999 deg in 12 rows: it stands for no reading; ..."]
    """
    yield from (text for text in _doubled(log) if not text.is_settled(log))
    for name, values in log.outputs.items():
        wire = plant.wire[name]
        if wire.flag or len(values) < LEAST_ROWS or not np.ptp(values):
            continue
        told = [*_copied(log, name, values)]
        if not told and (told := [*_swapped(log, plant, name, values)]):
            # what else is wrong with the reading, its own column shows
            told += _held(log, name, log.inputs[told[0].columns[1]], 0.0)
        step = steps.get(name, 0.0)
        told = told or [*_placeholders(log, wire, values, step)]
        told = told or [*_leaps(log, wire, values, step), *_held(log, name, values, step)]
        told = told or [*_stands(log, plant, name, values)] or [*_straight(name, values)]
        if not told and name == next(iter(log.outputs)):
            if difference_noise(values) >= STEPS_OF_NOISE * step:  # codes say nothing of a filter
                told = [*_averaged(name, values)] or [*_without_kinks(log, plant, name, values)]
            told = told or [*_ahead(log, plant, name, values)]
        yield from (text for text in told if not text.is_settled(log))


def _doubled(log: Log) -> Iterator[Mistake]:
    """Every row is there twice, as a join of tables leaves them."""
    columns = [*log.inputs.values(), *log.outputs.values()]
    half = len(log.times) // 2
    if half < LEAST_ROWS:
        return
    pairs = [np.array_equal(it[: 2 * half : 2], it[1 : 2 * half : 2]) for it in columns]
    if all(pairs) and any(_repeats(it[::2]) < REPEATS for it in columns):
        yield Mistake("every row is there twice: keep one of each")


def _placeholders(log: Log, wire: Wire, values: Array, step: float) -> Iterator[Mistake]:
    """A number that stands for no reading, such as -999, many reading steps from all others."""
    for end in (np.min(values), np.max(values)):
        which = values == end
        others = values[~which]
        if which.sum() < PLACEHOLDERS or not len(others):
            continue
        apart = np.min(np.abs(others - end))
        if apart > max(np.ptp(others), LEAP_RATIO * step) and len(runs(which)[0]) >= PLACEHOLDERS:
            channel = log.channels[wire.name]
            number = (end - channel.offset) / channel.scale  # of the file
            yield Mistake(
                f"'{wire.name}' reads {told(wire, end)} in {which.sum()} rows, the first of them"
                f" row {log.rows[np.argmax(which)]}, far outside all others: it stands for no"
                f" reading; give it missing = {number:.10g}",
                [wire.name],
                _without(which),
            )


def _copied(log: Log, name: str, values: Array) -> Iterator[Mistake]:
    """A reading that is its command: nothing that moves follows without delay and noise."""
    for other, command in log.inputs.items():
        if not np.ptp(command):
            continue
        line = np.polyfit(command, values, 1)
        left = values - np.polyval(line, command)
        if np.max(np.abs(left)) < STRAIGHT * np.ptp(values):
            yield Mistake(
                f"'{name}' is a copy of '{other}', row by row: nothing that moves follows its"
                " command so; read the column that was measured",
                [name],
            )


def _swapped(log: Log, plant: Plant, name: str, values: Array) -> Iterator[Mistake]:
    """A reading that jumps and stays, as commands do, beside a command with noise."""
    if _repeats(values) < 1.0 - REPEATS:
        return
    for other, command in _commands(log, plant):
        inside = command[(command > np.min(command)) & (command < np.max(command))]  # unclipped
        if len(inside) >= LEAST_ROWS and _repeats(inside) < REPEATS:
            yield Mistake(
                f"'{name}' jumps and stays, as a command does, while '{other}' has noise, as a"
                " reading has: their columns are swapped",
                (name, other),
                _exchanged(name, other),
                everywhere=True,
            )


def _repeats(values: Array) -> float:
    """Share of rows that repeat the one before."""
    return float(np.mean(np.abs(np.diff(values)) <= EQUAL * np.ptp(values)))


def _leaps(log: Log, wire: Wire, values: Array, step: float) -> Iterator[Mistake]:
    """A position that leaps between two rows, by many reading steps: a counter begins anew, or
    another run does."""
    if wire.unit not in POSITIONS:
        return
    steps = np.diff(values - off_neighbours(values))  # single wild readings are told elsewhere
    sizes = np.sort(np.abs(steps))[::-1][: MOST_LEAPS + 1]
    ratios = sizes[:-1] / np.maximum(sizes[1:], max(step, EQUAL * np.ptp(values)))
    count = int(np.argmax(ratios)) + 1
    if ratios[count - 1] < LEAP_RATIO or sizes[count - 1] < LEAST_LEAP * np.ptp(values):
        return
    where = np.flatnonzero(np.abs(steps) >= sizes[count - 1])
    if any(_answers(command, steps, where) for command in log.inputs.values()):
        return
    size, first = float(np.median(np.abs(steps[where]))), int(log.rows[where[0] + 1])
    again = bool(np.all(np.abs(np.abs(steps[where]) - size) < SAME_LEAP * size))
    leaps = f"'{wire.name}' leaps by {told(wire, size)} in one row, the first time in row {first}"
    if again and size > WRAPPED * np.ptp(values):
        yield Mistake(
            f"{leaps}, from one end of its range to the other: its counter overflows, or it wraps"
            + (", or two runs were joined" if len(where) == 1 else "")
            + "; add what is lost after each leap",
            [wire.name],
            _with_output(wire.name, values - _leapt(np.diff(values), where)),
        )
    elif not again or len(where) <= MOST_RUNS:
        yield Mistake(
            f"{leaps}, {ratios[count - 1]:.2g} times as far as in any other: two runs were joined,"
            " or rows are missing; make each run a log of its own",
            [wire.name],
            _without(np.arange(len(values)) > where[0]),
        )


def _leapt(steps: Array, where: NDArray[np.int64]) -> Array:
    """How far a reading has leapt in all before each row, beyond its motion, shape (n,)."""
    leaps, last = np.zeros(len(steps) + 1), len(steps) - 1
    motion = (steps[np.maximum(where - 1, 0)] + steps[np.minimum(where + 1, last)]) / 2.0
    leaps[where + 1] = steps[where] - motion
    return np.cumsum(leaps)


def _answers(command: Array, steps: Array, where: NDArray[np.int64]) -> bool:
    """Whether leaps in these rows are answers: each is beside a jump of a command, and most other
    jumps move the reading as far, for their size."""
    jumps = _jumps(command) - 1
    beside = [np.any((jumps >= k - AFTER) & (jumps <= k + BEFORE)) for k in where]
    if not all(beside):
        return False
    gains = np.array([np.max(np.abs(steps[max(k - BEFORE, 0) : k + AFTER + 1])) for k in jumps])
    gains /= np.abs(np.diff(command))[jumps]
    return bool(np.median(gains) > ANSWERED * np.max(gains))


def _held(log: Log, name: str, values: Array, step: float) -> Iterator[Mistake]:
    """A reading whose noise vanishes at an end of its range, or for good.

    A reading in steps rests without noise anyway, as on a shaft that sticks.
    """
    starts, stops = runs(np.abs(np.diff(values)) <= EQUAL * np.ptp(values))
    lengths = stops - starts
    long = lengths >= HELD_ROWS
    held = np.zeros(len(values), dtype=bool)
    for begin, end in zip(starts[long], stops[long]):
        held[begin + 1 : end + 1] = True
    others = values[~held]
    if not long.any() or len(others) < HELD_ROWS or _repeats(others) > REPEATS:
        return
    if difference_noise(others) < STEPS_OF_NOISE * step:
        return
    ends = np.isin(values[starts], (np.min(values), np.max(values))) & long
    rows = int(lengths[ends].sum())
    if ends.sum() > 1:
        yield Mistake(
            f"'{name}' {CLIPPING}: it stays at an end of its range, without noise, in {rows} rows;"
            " log smaller moves, or with a wider range",
            [name],
            _without(held & np.isin(values, (np.min(values), np.max(values)))),
        )
        return
    longest = int(np.argmax(lengths))
    begin, end = int(starts[longest]), int(stops[longest])
    moving = any(np.ptp(it[begin:end]) > 0.0 for it in log.inputs.values())
    if end - begin > STUCK_SHARE * len(values) and moving:
        yield Mistake(
            f"'{name}' is stuck at the same value for {end - begin + 1} rows from row"
            f" {log.rows[begin]} on, without noise: the sensor was dead; end the log before",
            [name],
            _without(np.arange(len(values)) >= begin),
        )


def _stands(log: Log, plant: Plant, name: str, values: Array) -> Iterator[Mistake]:
    """A reading that stands at the end of a log, though its command goes on as before."""
    begin = len(values) - int(STANDS * len(values))
    still = STILL * difference_noise(values)
    if usual_width(values[begin:]) > still or usual_width(values) < LONGER * still:
        return
    for other, command in _commands(log, plant):
        far = AS_FAR * np.ptp(command)
        if not far or np.ptp(command[begin:]) < far:
            continue
        yield Mistake(
            f"'{name}' stands from row {log.rows[begin]} on at the latest, while '{other}' goes on:"
            " the drive was switched off, or the sensor was dead; end the log before",
            [name],
            _without(np.arange(len(values)) >= begin),
        )


def _straight(name: str, values: Array) -> Iterator[Mistake]:
    """A reading that runs in straight lines: most of its rows were interpolated."""
    bends = np.abs(np.diff(values, 2))
    moving = np.abs(values[2:] - values[:-2]) > 2.0 * STRAIGHT * np.ptp(values)
    if moving.sum() < LEAST_ROWS:
        return
    flat = STRAIGHT * np.ptp(values)
    straight = bends[moving] <= flat
    if straight.all():  # one ramp has no bends to tell
        return
    bent = float(np.median(bends[moving][~straight]))
    if np.median(bends[moving]) <= flat and bent > BENT * flat:
        every = round(1.0 / (1.0 - float(np.mean(straight))))
        yield Mistake(
            f"'{name}' runs in straight lines, with a bend about every {every} rows: it was read"
            " less often and resampled; log the rows that were read",
            [name],
        )


def _correlations(values: Array) -> Array:
    """Autocorrelation at lags of 0, 1, 2 ... rows."""
    power = np.abs(np.fft.rfft(values, 2 * len(values))) ** 2
    correlations = np.fft.irfft(power)[: len(values) // 3]
    return np.asarray(correlations / max(correlations[0], np.finfo(float).tiny))


def _averaged(name: str, values: Array) -> Iterator[Mistake]:
    """A reading that is a moving average: noise comes back inverted when it leaves the window."""
    order = 3
    third = np.diff(values, order)
    size = CLIPPED_NOISE * median_deviation(third)
    together = _correlations(np.clip(third, -size, size))
    together[: order + 1] = 0.0
    rows = int(np.argmin(together))
    least = float(together[rows])
    together[max(rows - order, 0) : rows + order + 1] = 0.0
    if least < AVERAGED and np.max(np.abs(together)) < -ELSE_AVERAGED * least:
        yield Mistake(
            f"'{name}' was averaged over {rows} rows: its noise goes together in so many and comes"
            " back the other way round; log it as it was read",
            [name],
        )


def _without_kinks(log: Log, plant: Plant, name: str, values: Array) -> Iterator[Mistake]:
    """A reading with neither noise nor the kink with which an answer begins."""
    if _correlations(np.diff(values, 4))[1] < NO_KINK:
        return
    for other, command in _commands(log, plant):
        if len(_jumps(command)) >= LEAST_JUMPS:
            yield Mistake(
                f"'{name}' has no noise from row to row, and no kink where '{other}' jumps: it was"
                " filtered forwards and backwards, or is no reading; log it as it was read",
                [name],
            )


def _ahead(log: Log, plant: Plant, name: str, values: Array) -> Iterator[Mistake]:
    """A reading that moves before its command jumps."""
    for other, command in _commands(log, plant):
        rows, many = _before_jumps(command, values)
        if rows:
            yield Mistake(
                f"'{name}' moves up to {rows} rows before '{other}' jumps, in {many} jumps: the"
                " command was logged late, or by another clock; log it as it is sent",
                [other],
                _earlier(other, rows),
                everywhere=True,
            )


def _earlier(command: str, rows: int) -> Mend:
    """A log whose command comes some rows earlier."""

    def mended(log: Log) -> Log:
        sent = log.inputs[command]
        late = np.minimum(np.arange(len(sent)) + rows, len(sent) - 1)
        return replace(log, inputs={**log.inputs, command: sent[late]})

    return mended


def _commands(log: Log, plant: Plant) -> list[tuple[str, Array]]:
    """Inputs that are neither a load nor a supply, which rests at a voltage."""
    wires = {name: plant.wire[name] for name in log.inputs}
    return [
        (name, log.inputs[name])
        for name, wire in wires.items()
        if wire.unit not in LOADS and not (wire.unit == "V" and wire.rest)
    ]


def _jumps(command: Array) -> NDArray[np.int64]:
    """Rows at which a command has jumped."""
    return np.flatnonzero(np.abs(np.diff(command)) > JUMP * np.ptp(command)) + 1


def _before_jumps(command: Array, values: Array) -> tuple[int, int]:
    """Rows by which a reading moves before its command jumps, 0 for none, and the number of these
    jumps."""
    steps, jumps = np.diff(command), _jumps(command)
    # noise that a sensor filters shows only between rows that are further apart
    noise = max(difference_noise(values[::apart]) for apart in (1, AHEAD_ROWS[-1]))
    for rows in AHEAD_ROWS:
        alone = [
            k
            for k in jumps
            if QUIET * rows + BEFORE <= k < len(values) - 2 * rows
            and not np.any(steps[k - BEFORE - QUIET * rows : k - 1])
        ]
        if len(alone) < LEAST_JUMPS:
            continue
        at = np.array(alone)
        ways = np.sign(steps[at - 1])
        # stamps may be late by a row or two
        places = [values[at - BEFORE - k * rows] for k in range(QUIET, -1, -1)]
        places.append(values[at + 2 * rows])
        moves = np.array([ways * (b - a) for a, b in pairwise(places)])
        before = np.max(np.abs(moves[:-2]), axis=0)
        calm = np.argsort(before)[: max(LEAST_JUMPS, (len(at) + 1) // 2)]  # others still answer
        ahead, answer = moves[-2:, calm]
        if np.median(answer) < 0.0:
            ahead, answer = -ahead, -answer
        usual = max(float(np.median(before[calm])), 2.0 * noise / np.sqrt(len(calm)))
        if np.median(ahead) > SUDDEN * usual:
            return rows, len(calm)
    return 0, 0
