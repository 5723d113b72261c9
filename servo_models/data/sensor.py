"""What a column of readings tells about its sensor: noise, clipping, stale values.

Every function takes the readings of one signal in the order of time, shape (n,), in one unit.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from itertools import pairwise

import numpy as np

from servo_models.core.types import Array

ROUNDED = 1e-12  # readings closer than this share of the largest are equal but for rounding
STILL = 0.01  # share of its range by which a reading at rest may move
SAME_START = 0.05  # share of its range within which readings at rest begin a repetition alike
REST_SAMPLES = 5
"""Samples for which a command must stand still so that its next move begins a repetition."""
REST_SHARE, REST_PARTS = 0.5, 4
"""Last part of the stretch before such a move that is compared, and in how many pieces."""
MOVES = 8.0  # change in noise floors from which a reading moves
SMALL = 10.0  # percentile of such changes between two samples that is a step of a coarse sensor
FEW = 20  # moving samples, below which a share of them is chance
LATE_SAMPLES = 2  # by which stretches of one command may differ in length: it is sampled late
FAST = 12.0  # speed of a motion, in noise floors a sample
LEVELS = 2  # levels beside the extremes at which a reading rests that sticks
ORDERS = (1, 2, 3)
DITHERS = 8  # draws of dither: its own scatter is then a third of what one draw adds
HARMONICS = 50  # of the rounding error's series: a thousandth of a step^2 is left of 1/12
SPAN = 4
"""Samples over which the speed of a motion is taken: rounding adds a tenth of a step a sample."""


def difference_noise(values: Array) -> float:
    """Return the standard deviation of white noise on a signal that is smooth between samples.

    Differences of order k remove a smooth signal and scale white noise by the root of
    (2k choose k); the least of three orders is the one that the signal inflates least, and
    the median keeps transients out.
    Source: Hall, Kay, Titterington, Biometrika 77 (1990); median: Rousseeuw, Croux, JASA 88
    (1993).
    """
    estimates = [
        1.4826 * np.median(np.abs(np.diff(values, order))) / math.sqrt(math.comb(2 * order, order))
        for order in ORDERS
    ]
    return float(min(estimates))


def noise_under_steps(values: Array, step: float) -> float:
    """Return the standard deviation of the white noise that a sensor of this step rounded.

    Quantised readings hide noise below half a step: differences show what of noise and rounding
    changes from sample to sample.  In a slow motion the mean of rounding at a place does not,

        V = sum over k of exp(-4 pi^2 k^2 sigma^2) / (2 pi^2 k^2)  [steps^2],

    by the share that the motion leaves in phase; so what differences show is
    sigma^2 + 1/12 - V, solved for sigma.  Uniform noise of one step, added beforehand and taken
    off again, makes the median of the differences one of a continuous distribution.
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


def stale_share(values: Array, floor: float) -> float:
    """Return the share of the moving samples that repeat the one before exactly.

    A sample counts as moving where its neighbours differ by more than 8 noise floors, and by more
    than a small jump in each row: a coarse sensor repeats readings as well, but not in fast motion.
    Of few such samples chance repeats some.
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
    value there; so a shaft that settles is not taken for one that is held.  One that sticks is
    neither: it rests where its command turns, or at as many other levels while the command moves.
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
    """Stretches (start, stop) of three or more equal readings that the speed before passes by."""
    same = np.abs(np.diff(values)) <= ROUNDED * np.abs(values[1:])
    edges = np.diff(np.concatenate([[0], same.astype(int), [0]]))
    found = []
    for start, last in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)):
        speed = values[start - 1] - values[start - 2] if start > 1 else 0.0
        past = (values[start - 1] + speed - values[start]) * np.sign(speed) > 0.0
        if last - start >= 2 and past and abs(speed) > FAST * floor:
            found.append((int(start), int(last) + 1))
    return found


def _alike(value: float, other: float) -> bool:
    return bool(abs(value - other) <= ROUNDED * abs(other))


def _turns(command: Array, start: int, stop: int) -> bool:
    """Whether every input that changes in a stretch goes back from where it begins: by no more than
    it had changed in the samples before does it go on."""
    before = command[start] - command[max(start - LATE_SAMPLES, 0)]
    on = np.max((command[start:stop] - command[start]) * np.sign(before), axis=0)
    changing = np.ptp(command[start:stop], axis=0) > 0.0
    return bool(changing.any() and np.all((on <= np.abs(before))[changing]))


def spread_of_repeats(values: Array, command: Array) -> float | None:
    """Return the standard deviation of the responses to identical commands, None without any.

    A repetition lasts from a move after rest of the command, shape (n, inputs), to the next
    such move, and begins with a reading at rest, as do all that it is compared with: from the same
    command, that came after the same stretch before.  Play and friction remember that stretch.
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
            one = slice(start - past - 1, start + length)
            other = slice(first - past - 1, first + length)
            if alike and np.array_equal(command[one], command[other]):
                group.append((start, stop))
                break
        else:
            groups.append([(start, stop)])
    return [group for group in groups if len(group) > 1]
