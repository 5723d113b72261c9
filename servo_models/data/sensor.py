"""What a sensor does to a reading: its steps, its noise, wild readings, clipping, stale values.

Every function takes the readings of one signal in the order of time, shape (n,), in one unit, and
knows nothing else of the log.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array, Mask
from servo_models.report.document import Document

ROUNDED = 1e-12  # difference over the largest reading up to which two are equal but for rounding
INNER = (1.0, 99.0)  # percentiles between which readings count: noise is 4.7 floors wide there


def usual_range(values: Array) -> tuple[float, float]:
    """Return the range of readings, single wild ones apart."""
    low, high = np.percentile(values, INNER)
    return float(low), float(high)


def usual_width(values: Array) -> float:
    """Return the width of ``usual_range``."""
    low, high = usual_range(values)
    return high - low


def runs(flags: Mask) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where runs of True begin, and the row after each."""
    edges = np.diff(np.concatenate([[0], flags.astype(int), [0]]))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


# Steps
#
# A step is told where all values of a log lie on a lattice, too well and too many of them for
# chance, and where a finer lattice would have shown values between.  Logs of one sensor share the
# step, each with an offset of its own; a log that does not lie on the step of the others is judged
# by itself.
# Source: code histogram test, IEEE Std 1241; here the step is unknown, so it is the common divisor
# of the distances between codes.  Chance: Rissanen, Automatica 14 (1978), two numbers told for each
# lattice.

ON_STEP = 0.1  # distance from a multiple of the step, in steps, below which a value is on it
FINEST = 24  # distance of the two closest values in steps, at most
REACHES = tuple(3.0**k for k in range(1, 16))
"""Distances in steps up to which codes are counted, in turn: each refines the step for the next."""
LANDINGS = 10  # codes and single steps, at least: chance leaves out every second code once in 2**10
CODES = 4  # different values that readings take, at least: three may be places of rest
EVEN = 0.2  # changes of speed per move, at least: samples of a ramp lie as far apart as codes
UNLIKELY = math.log(1e4)  # log-likelihood ratio of a lattice to chance, at least
RESAMPLED = 0.1  # share of readings that occur more than once, from which they are taken for codes
SETTLING = 0.4  # share near a code of the values between codes, above which a shaft rests there
EQUAL = 1e-6  # distance from a code, in steps, that interpolation between equal readings may leave
COARSER = 1.5  # step of repeated readings over that of all, above which a log may be resampled


@dataclass(frozen=True)
class Step:
    """The step of one log: ``size`` is 0 where it has none, ``between`` the share of its readings
    that lie between steps, which is not 0 where they were resampled."""

    size: float
    between: float = 0.0


NO_STEP = Step(0.0)


@dataclass(frozen=True, eq=False)
class _Record:
    """Values of a log in the order of time, and the different ones in ascending order."""

    values: Array
    codes: Array

    def residues(self, step: float, values: Array | None = None) -> Array:
        """Distance of values, else the different ones, from the lattice [steps]."""
        turns = self.codes / step
        return _off((turns if values is None else values / step) - phase_of_codes(turns))

    def lies_on(self, step: float) -> bool:
        return bool(np.max(self.residues(step)) < ON_STEP)


def reading_steps(records: Sequence[Array], least: int = CODES) -> list[Step]:
    """Return the step of each log of one sensor, shapes (n,), in their unit.

    ``least`` is how many different values tell a step.
    """
    seen = [_Record(values, _codes(values)[0]) for values in records]
    often = [_repeated(values) for values in records]
    sizes = _shared(seen, least)
    coarse = iter(_shared([one for one in often if one is not None], max(least, LANDINGS)))
    steps = []
    for values, size, repeated in zip(records, sizes, often):
        rough = next(coarse) if repeated is not None else 0.0
        if repeated is not None and _resampled(repeated, values, size, rough):
            off = repeated.residues(rough, values)
            steps.append(Step(rough, float(np.mean(off > ON_STEP))))
        else:
            steps.append(Step(size))
    return steps


def reading_step(values: Array, least: int = CODES) -> Step:
    """Return the step of a log by itself, see ``reading_steps``."""
    return reading_steps([values], least)[0]


def phase_of_codes(turns: Array) -> float:
    """Return where on its step a lattice lies [steps], from readings [steps] on or about it."""
    return float(np.angle(np.mean(np.exp(2j * np.pi * turns)))) / (2.0 * np.pi)


def _codes(values: Array) -> tuple[Array, Array]:
    """Different values but for rounding, ascending, and how often each occurs."""
    ordered = np.sort(values)
    new = np.diff(ordered, prepend=-math.inf) > _slack(values)
    starts = np.flatnonzero(new)
    return ordered[starts], np.diff(starts, append=len(values))


def _repeated(values: Array) -> _Record | None:
    """The readings that occur more than once, None for hardly any.

    A sensor without steps hardly gives a reading twice; in a file that was resampled these are
    what the sensor gave.
    """
    codes, counts = _codes(values)
    if counts[counts > 1].sum() < RESAMPLED * len(values):
        return None
    codes = codes[counts > 1]
    near = codes[np.minimum(np.searchsorted(codes, values - _slack(values)), len(codes) - 1)]
    return _Record(values[np.abs(values - near) <= _slack(values)], codes)


def _slack(values: Array) -> float:
    return ROUNDED * float(np.abs(values).max())


def _resampled(often: _Record, values: Array, fine: float, step: float) -> bool:
    """Whether a log is resampled from codes of the step of its repeated readings.

    Values between codes do not gather near them, as those of a shaft that comes to rest do; and
    where all lie on a finer step, most are on the codes.
    """
    if step <= COARSER * fine:
        return False
    off = often.residues(step, values)
    between = off[off > EQUAL]
    if not len(between) or np.mean(between < ON_STEP) > SETTLING:
        return False
    return fine == 0.0 or len(between) < 0.5 * len(values)


def _shared(records: Sequence[_Record], least: int) -> list[float]:
    """The step of each record, 0 for none: of the steps on which it lies, that of most records, and
    of several such the largest."""
    telling = [one for one in records if len(one.codes) > 1]
    sets = [telling] if len(telling) > 1 else []
    sizes = {_lattice(chosen, least) for chosen in [*sets, *([one] for one in telling)]} - {0.0}
    ranked = sorted(
        sizes, key=lambda size: (sum(one.lies_on(size) for one in telling), size), reverse=True
    )
    return [next((size for size in ranked if one.lies_on(size)), 0.0) for one in records]


def _lattice(records: Sequence[_Record], least: int) -> float:
    """The largest step on which all values of all records lie by no chance, 0 for none."""
    gaps = np.sort(np.concatenate([np.diff(one.codes) for one in records]))
    for parts in range(1, FINEST + 1):
        step = _refined(gaps, gaps[0] / parts)
        if np.max(_off(gaps[: 4 * FINEST] / step)) > 2.0 * ON_STEP:
            continue
        step = _line_through_codes(records, step)
        if _is_no_chance(records, step, least):
            return step
    return 0.0


def _refined(gaps: Array, step: float) -> float:
    """A step from all gaps, ascending, the smaller ones first."""
    for reach in REACHES:
        near = gaps[: np.searchsorted(gaps, reach * step)]
        if len(near):
            step = float(near.sum() / max(np.round(near / step).sum(), 1.0))
        if len(near) == len(gaps):
            break
    return step


def _line_through_codes(records: Sequence[_Record], step: float) -> float:
    """The slope of all codes over their numbers, each record with an offset of its own."""
    products, squares = 0.0, 0.0
    for record in records:
        number = np.concatenate([[0.0], np.cumsum(np.round(np.diff(record.codes) / step))])
        about = number - number.mean()
        products += float(about @ (record.codes - record.codes[0]))
        squares += float(about @ about)
    return products / squares if squares else step


def _is_no_chance(records: Sequence[_Record], step: float, least: int) -> bool:
    worst, values, landings, bends, travel, reach = 0.0, 0, 0, 0, 0, 1.0
    for record in records:
        worst = max(worst, float(np.max(record.residues(step))))
        values += len(record.codes) - 1
        moves = np.round(np.diff(record.values) / step)
        landings += int(np.count_nonzero(np.abs(moves) == 1.0))
        bends += int(np.count_nonzero(np.diff(moves)))
        travel += int(np.count_nonzero(moves))
        reach = max(reach, float(np.ptp(record.codes)) / step)
    if worst >= ON_STEP or values < least - 1 or values + landings < LANDINGS:
        return False
    if bends < EVEN * travel:
        return False
    # one value is spent on the step; as many steps as codes could have been tried
    return -(values - 1) * math.log(2.0 * worst + ROUNDED) > math.log(reach) + UNLIKELY


def _off(multiples: Array) -> Array:
    return np.asarray(np.abs(multiples - np.round(multiples)))


# Noise

ORDERS = (1, 2, 3)  # orders of differences
DITHERS = 8  # draws of dither: their scatter is then a third of what one draw adds
HARMONICS = 50  # harmonics of the rounding error: a thousandth of a step^2 is left of 1/12
SPAN = 4  # samples over which a speed is taken: rounding adds a tenth of a step a sample
QUANTUM = "reading step"
REPEATS = "repeated commands"
RESIDUAL = "fast residual"
FLAG = 1.0 / math.sqrt(12.0)  # noise floor of a flag: its step is 1


class Floor(Document, frozen=True):
    """Noise floor of an output [SI]: how far readings are from the motion, root mean square.

    A reading is off by noise and, independently, by the rounding to its step: their squares add.
    Repeats show both together, and count where they show more.

    Attributes:
        quantum: reading step over the root of 12 (Widrow, Kollar, Quantization Noise, 2008,
            ch. 5), 0 for none.
        repeats: spread of the responses to repeated identical commands, None without any.
        residual: noise before the rounding, from the differences of neighbouring samples.
    """

    quantum: float
    repeats: float | None
    residual: float

    @property
    def parts(self) -> dict[str, float]:
        """Each method's figure by name."""
        return {QUANTUM: self.quantum, REPEATS: self.repeats or 0.0, RESIDUAL: self.residual}

    @property
    def value(self) -> float:
        return max(math.hypot(self.quantum, self.residual), self.repeats or 0.0)

    @property
    def origin(self) -> str:
        """Name of the method that gave the floor, or most of it."""
        if self.repeats and self.repeats >= self.value:
            return REPEATS
        return QUANTUM if self.quantum >= self.residual else RESIDUAL


def median_deviation(values: Array) -> float:
    """Return the standard deviation of normal noise about 0, from its median size."""
    return 1.4826 * float(np.median(np.abs(values)))


def difference_noise(values: Array) -> float:
    """Return the standard deviation of white noise on a signal that is smooth between samples.

    Differences of order k remove a smooth signal and scale white noise by the root of
    (2k choose k); the least of three orders is the one that the signal inflates least, and
    the median keeps transients out.
    Source: Hall, Kay, Titterington, Biometrika 77 (1990); median: Rousseeuw, Croux, JASA 88
    (1993).
    """
    return min(
        median_deviation(np.diff(values, order)) / math.sqrt(math.comb(2 * order, order))
        for order in ORDERS
    )


def noise_floor(values: Array, step: float, command: Array) -> Floor:
    """Return the noise floor of readings with a step, 0 for none, that answer a command of shape
    (n, inputs)."""
    repeats = spread_of_repeats(values, command)
    return Floor(step / math.sqrt(12.0), repeats, noise_under_steps(values, step))


def noise_under_steps(values: Array, step: float) -> float:
    """Return the standard deviation of the white noise that a sensor of this step rounded.

    Quantised readings hide noise below half a step: differences show only the noise and rounding
    that change from sample to sample.  In a slow motion the mean rounding error at a place does not
    change.  Its variance is

        V = sum over k of exp(-4 pi^2 k^2 sigma^2) / (2 pi^2 k^2)  [steps^2],

    each term times the share that the motion leaves in phase.  So differences show
    sigma^2 + 1/12 - V, which is solved for sigma.  Uniform noise of one step, added beforehand and
    taken off again, makes the median of the differences one of a continuous distribution.
    Source: Widrow, Kollar, Quantization Noise (2008), ch. 4 and 19 (dither).
    """
    if not step:
        return difference_noise(values)
    turns = values / step
    random = np.random.default_rng(len(values))
    dithered = [
        difference_noise(turns + random.uniform(-0.5, 0.5, len(turns))) for _ in range(DITHERS)
    ]
    seen = float(np.mean(np.square(dithered))) - 1.0 / 12.0
    kept = _phases_kept(turns)

    def shown(sigma: float) -> float:
        return sigma**2 + 1.0 / 12.0 - float(np.sum(kept * _rounding_at_a_place(sigma)))

    if seen <= shown(0.0):
        return 0.0
    low, high = 0.0, math.sqrt(seen) + 1.0
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if shown(middle) < seen else (low, middle)
    return step * high


def _rounding_at_a_place(sigma: float) -> Array:
    """Variance of the mean error of rounding, by harmonic of the step, shape (HARMONICS,)."""
    k = np.arange(1.0, HARMONICS + 1.0)
    return np.asarray(np.exp(-4.0 * (np.pi * k * sigma) ** 2) / (2.0 * (np.pi * k) ** 2))


def _phases_kept(turns: Array) -> Array:
    """How much of each harmonic of the rounding the next sample still has, at most 1."""
    if len(turns) <= SPAN:
        return np.ones(HARMONICS)
    speed = (turns[SPAN:] - turns[:-SPAN]) / SPAN
    k = np.arange(1.0, HARMONICS + 1.0)
    return np.asarray(np.maximum(np.mean(np.cos(2.0 * np.pi * np.outer(k, speed)), axis=1), 0.0))


# Responses to the same commands

STILL = 0.01  # motion of a reading over its range up to which it is at rest
SAME_START = 0.05  # distance over the range up to which readings at rest begin a repetition alike
REST_SAMPLES = 5  # samples for which a command stands before a move that begins a repetition
REST_SHARE = 0.5  # last part of the stretch before such a move that is compared, over its length
REST_PARTS = 4  # pieces of that part whose means are compared


def spread_of_repeats(values: Array, command: Array) -> float | None:
    """Return the standard deviation of the responses to identical commands, None without any.

    A repetition lasts from a move after rest of the command, shape (n, inputs), to the next
    such move, and begins with a reading at rest.  It is compared with those that have the same
    command, in it and in the stretch before: play and friction remember that stretch.
    Source: Draper, Smith, Applied Regression Analysis, 3rd ed., sec. 2.1 (pure error).
    """
    still = STILL * float(np.ptp(values))
    moved = np.concatenate([[False], np.any(command[1:] != command[:-1], axis=1)])
    at = np.flatnonzero(moved)
    onsets = at[np.diff(at, prepend=0) > REST_SAMPLES]
    resting = {
        int(i)
        for begin, i in pairwise([0, *onsets])
        if np.ptp(values[i - REST_SAMPLES : i]) <= still and _settled(values[begin:i], still)
    }
    squares, freedom = 0.0, 0
    edges = [*map(int, onsets), len(values)]
    for same in _same_commands(command, edges, set(edges)):
        settled = [(start, stop) for start, stop in same if start in resting]
        begins = [values[start - 1] for start, _ in settled]
        alike = SAME_START * float(np.ptp(values))
        group = [one for one, at in zip(settled, begins) if abs(at - np.median(begins)) <= alike]
        if 2 * len(group) < len(same):
            continue  # the actuator does not settle before this command: a few pauses are chance
        length = min(stop - start for start, stop in group)
        responses = np.array([values[start : start + length] for start, _ in group])
        squares += float(np.sum((responses - responses.mean(axis=0)) ** 2))
        freedom += (len(group) - 1) * length
    return float(np.sqrt(squares / freedom)) if freedom else None


def _settled(stretch: Array, still: float) -> bool:
    """Whether the last part of a stretch stays; a delayed actuator also pauses where it turns."""
    last = stretch[-max(int(REST_SHARE * len(stretch)), REST_PARTS) :]
    return float(np.ptp([part.mean() for part in np.array_split(last, REST_PARTS)])) <= still


def _same_commands(
    command: Array, edges: Sequence[int], wanted: Container[int]
) -> list[list[tuple[int, int]]]:
    """Stretches (start, stop) between edges, from wanted starts, grouped by equal commands in them
    and in the stretch before."""
    groups: list[list[tuple[int, int]]] = []
    before: dict[int, int] = {start: begin for begin, start in pairwise(edges)}
    for start, stop in pairwise(edges):
        if start not in wanted or start not in before:
            continue
        for group in groups:
            first, last = group[0]
            length = min(stop - start, last - first)
            past = min(start - before[start], first - before[first])
            alike = (
                abs((stop - start) - (last - first)) <= LATE_SAMPLES
                and abs((start - before[start]) - (first - before[first])) <= LATE_SAMPLES
                and length > REST_SAMPLES
            )
            stretch = slice(start - past - 1, start + length)
            earlier = slice(first - past - 1, first + length)
            if alike and np.array_equal(command[stretch], command[earlier]):
                group.append((start, stop))
                break
        else:
            groups.append([(start, stop)])
    return [group for group in groups if len(group) > 1]


# Wild readings

WINDOW = 5  # readings of a running median; it passes over up to two neighbouring outliers
APART = 5.0  # distance of an outlier from its neighbours over that of other readings, or the step
LEAST_SHARE = 0.02  # distance of outliers over the range of most readings: less harms no fit
MOST_OUTLIERS_SHARE = 0.01  # share of readings that may be outliers: more belong to the signal
LEAST_OUTLIERS = 5  # number of readings that may be outliers however short the log


def off_neighbours(values: Array) -> Array:
    """Return how far readings lie off the running median, shape (n,); 0 where there are few."""
    if len(values) < WINDOW:
        return np.zeros(len(values))
    ends = np.pad(values, WINDOW // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(ends, WINDOW)
    return np.asarray(values - np.median(windows, axis=1))


def outliers(values: Array, excused: Mask | None = None) -> Array:
    """Return by how much outliers lie off the running median, with sign, 0 for all other readings.

    Edges and ramps pass a median of five unharmed (Tukey, Exploratory Data Analysis, 1977,
    ch. 7), so that what is left is noise, peaks and outliers; these stand out of the rest.

    Args:
        values: readings in the order of time, shape (n,).
        excused: True where a peak is no outlier, shape (n,).
    """
    off = off_neighbours(values)
    if len(values) < WINDOW:
        return off
    if excused is not None:
        off[excused] = 0.0
    sizes = np.sort(np.abs(off))[::-1]
    most = min(max(LEAST_OUTLIERS, int(MOST_OUTLIERS_SHARE * len(values))), len(values) - 1)
    least = max(reading_step(values).size, LEAST_SHARE * usual_width(values) / APART)
    apart = np.flatnonzero(sizes[:most] > APART * np.maximum(sizes[1 : most + 1], least))
    bar = sizes[apart[-1]] if len(apart) else np.inf
    return np.where(np.abs(off) >= bar, off, 0.0)


# Readings that stay

MOVES = 8.0  # change in noise floors above which a reading moves
SMALL = 10.0  # percentile of changes between two samples that is a step of a coarse sensor
FEW = 20  # moving samples below which a share of them is chance
LATE_SAMPLES = 2  # difference in length of stretches of one command: it is sampled late
FAST = 12.0  # speed before a sudden stop in noise floors a sample, at least
LEVELS = 2  # levels beside the extremes at which a reading rests that sticks


def stale_share(values: Array, floor: float) -> float:
    """Return the share of the moving samples that repeat the one before exactly.

    A sample counts as moving where its neighbours differ by more than 8 noise floors, and by more
    than a small jump in each row: a coarse sensor repeats readings as well, but not in fast motion.
    The share is 0 where such samples are few, as chance repeats some.
    """
    if len(values) < 4:
        return 0.0
    jumps = np.abs(np.diff(values))
    jumps = jumps[jumps > MOVES * floor]
    small = float(np.percentile(jumps, SMALL)) if len(jumps) else 0.0
    moving = np.abs(values[3:] - values[:-3]) > max(MOVES * floor, 3.0 * small)
    same = (values[1:-2] == values[2:-1]) & moving
    return float(same.sum() / moving.sum()) if moving.sum() >= FEW else 0.0


def clipped_share(values: Array, command: Array, floor: float) -> float:
    """Return the share of samples at which a reading stays at an extreme that it ran into.

    It stays there for three samples or more, came with a speed of over 12 noise floors a
    sample that would have carried it past, and its command, shape (n, inputs), takes more than one
    value there; so a shaft that settles is not taken for one that is held.  A shaft that
    sticks is neither: it rests where its command turns, or at as many other levels while the
    command moves.
    """
    stops = _sudden_stops(values, floor)
    ends = (values.max(), values.min())
    at_end = {end: [one for one in stops if _alike(values[one[0]], end)] for end in ends}
    others = [one for one in stops if not any(_alike(values[one[0]], end) for end in ends)]
    resting = [values[one[0]] for one in others if np.ptp(command[slice(*one)], axis=0).any()]
    if len(set(resting)) >= LEVELS and len(resting) >= sum(map(len, at_end.values())):
        return 0.0
    held = np.zeros(len(values), dtype=bool)
    for runs in at_end.values():
        there = np.zeros(len(values), dtype=bool)
        for start, stop in runs:
            there[start:stop] = not _turns(command, start, stop)
        if there.any() and np.ptp(command[there], axis=0).any():
            held |= there
    return float(held.mean())


def _sudden_stops(values: Array, floor: float) -> list[tuple[int, int]]:
    """Stretches (start, stop) of three or more equal readings, too sudden for the speed before."""
    same = np.abs(np.diff(values)) <= ROUNDED * np.abs(values[1:])
    stops = []
    for start, last in zip(*runs(same)):
        speed = values[start - 1] - values[start - 2] if start > 1 else 0.0
        past = (values[start - 1] + speed - values[start]) * np.sign(speed) > 0.0
        if last - start >= 2 and past and abs(speed) > FAST * floor:
            stops.append((int(start), int(last) + 1))
    return stops


def _alike(value: float, other: float) -> bool:
    return bool(abs(value - other) <= ROUNDED * abs(other))


def _turns(command: Array, start: int, stop: int) -> bool:
    """Whether every input that changes in a stretch turns back where that begins: it goes on by no
    more than it had changed in the samples before."""
    before = command[start] - command[max(start - LATE_SAMPLES, 0)]
    on = np.max((command[start:stop] - command[start]) * np.sign(before), axis=0)
    changing = np.ptp(command[start:stop], axis=0) > 0.0
    return bool(changing.any() and np.all((on <= np.abs(before))[changing]))


# Angles that were written within one turn

TURN = 2.0 * np.pi  # rad
WITHIN = 1.01  # range over a turn up to which an angle may have been written within one
LARGEST_STEP = 0.25  # step over a turn, from one row to the next, that motion surely stays below


def unwrapped(angles: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return angles [rad] as they go on, and the rows in which they had come back by a turn.

    They are as they were where motion may be so fast, where they have more than one turn, and where
    single wild readings alone leap.
    """
    whole = np.unwrap(angles)
    back = np.flatnonzero(np.diff(np.round((whole - angles) / TURN))) + 1
    both = (angles, angles - off_neighbours(angles))
    slow = any(
        np.abs(np.diff(it)).max(initial=0.0) > 0.5 * TURN
        and np.abs(np.diff(np.unwrap(it))).max() < LARGEST_STEP * TURN
        for it in both
    )
    return (whole, back) if slow and np.ptp(angles) < WITHIN * TURN else (angles, back[:0])


def next_to(angles: Array, reading: Array) -> Array:
    """Return angles [rad] of a command, which may be written within a turn as well, in the turns
    of a reading."""
    if np.ptp(angles) > WITHIN * TURN:
        return angles
    both = (angles, np.unwrap(angles))
    tried = [it + TURN * np.round(np.median(reading - it) / TURN) for it in both]
    return min(tried, key=lambda it: float(np.sum((it - reading) ** 2)))
