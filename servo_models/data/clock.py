"""Times of a log: stamps that were rounded or came late go back on the grid of their clock; jitter
and lost rows of the others."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.data.sensor import reading_step

ROUNDING = 1e-3  # deviation from a regular grid over the sampling step up to which it is rounding
DECIMALS = 9  # decimals of a stamp [s] beyond which its digits are rounding
DIGITS_LEFT = 4.0  # finest step of stamps over the spacing of floating-point numbers of their size
MOST_TICKS = 2.0**52  # longest log in finest steps: all are exact in a floating-point number
STRICT = 1.0 - 1e-6  # range of stamps about an even grid, in quanta: rounding leaves less than one
CLOSED = 1.0 + 1e-6  # range in quanta if the clock ticks where the rounding turns: one
LOOSE = 2.0  # range in quanta where rows were late or early as well: every stamp within one
LOOSE_PERIODS = 0.5  # lateness of rows in periods, at most: a lost row shifts stamps by a whole one
SHORT = 1.01  # range over the least one that a period of few digits may leave
TURNS = 3  # odd steps that show a rounding, at least: fewer may be lost rows, or a repeated one
MOST_BREAKS = 0.02  # gaps over rows above which they are jitter
FIRST_BREAKS = 2  # gaps allowed beyond that share, however short the log
LEAST_STRETCH = 16  # fewest rows between gaps that tell a period
THIRDS = 45  # steps of the search for a period, each of which leaves two thirds of its interval

BINS_PER_STEP = 8  # bins in a usual step, in which stamps are counted to find their period
RATES = (0.7, 3.5)  # range of the rate over the usual one: uneven rows are up to 3 periods apart
LEAST_COHERENCE = 0.2  # coherence of stamps with a period; half a period late on average leaves 0.3
LEAST_POWER = 25.0  # coherence^2 times rows; without a period it is hardly ever reached
MOST_SPARSE = 20.0  # duration in usual steps over the number of rows, at most
PHASES = 64  # phases of a period that are tried
NEIGHBOURS = 5  # neighbours on each side, from which a reading is predicted
CUBIC = 4  # coefficients of a cubic
MOST_PREDICTED = 20_000  # rows that are predicted, at most
WITHOUT_WILD = 0.9  # share of rows that tell the usual squared error: a glitch spoils ten of them
WILD_SQUARE = 16.0  # squared error over the usual one at which it is cut
SURELY_SMOOTHER = 2.0  # gain of the even clock over its standard error above which stamps came late


@dataclass(frozen=True, eq=False)
class Grid:
    """An even grid on which rounded stamps lie.

    Attributes:
        times: times of the rows on the grid [s], shape (n,), from about 0.
        period, quantum: steps of the grid and of the stamps [s].
        correction: largest distance of a stamp from its time [s], at most a quantum.
    """

    times: Array
    period: float
    quantum: float
    correction: float

    @property
    def note(self) -> str:
        """What was done, as a sentence."""
        return (
            f"time stamps in steps of {1e3 * self.quantum:.4g} ms are put back on the even grid"
            f" that all of them agree with: a row every {1e3 * self.period:.6g} ms, the largest"
            f" correction is {1e3 * self.correction:.3g} ms"
        )


def regular(times: Array) -> Array:
    """Return times that miss a regular grid only by rounding on that grid; others as they are.

    Time stamps of a few digits would shift samples against the clocks of a model, and a
    digital loop that misses a tick now and then is another loop.  The step is the shortest
    decimal number that fits.
    """
    n = len(times)
    count = np.arange(n)
    step = (times[-1] - times[0]) / (n - 1)
    tolerance = ROUNDING * step
    if np.abs(times - times[0] - step * count).max() > tolerance:
        return times
    for digits in range(2, 16):
        short = float(f"{step:.{digits - 1}e}")
        if np.abs(times - times[0] - short * count).max() <= tolerance:
            return np.asarray(times[0] + short * count)
    return times


def dithered(stamps: Array, scale: float = 1.0) -> Grid | None:
    """Return the even grid whose rounded times the stamps are, None where there is none.

    A row every 3.003 ms is stamped 0, 3, 6, 9, ... 1000, 1004 in ms, and one every 0.7 ms
    0, 1, 1, 2: steps that differ and times that repeat, though the clock is even.  All stamps
    have to lie within one quantum about one straight line over the rows; rows may be lost, where
    the stamps then jump.
    Source: Rosenfeld, IEEE Trans. Computers C-23 (1974), digital straight lines; of the
    lines that fit, the one with the least largest error.

    Args:
        stamps: not falling, shape (n,).
        scale: seconds in one unit of them.
    """
    since = (stamps - stamps[0]) * scale
    finest = max(10.0**-DECIMALS, DIGITS_LEFT * scale * float(np.spacing(np.abs(stamps).max())))
    finest = 10.0 ** math.ceil(math.log10(finest))
    if len(since) < LEAST_STRETCH or since[-1] > MOST_TICKS * finest:
        return None
    ticks = np.round(since / finest).astype(np.int64)
    common = int(np.gcd.reduce(np.diff(ticks)))
    if not common:
        return None
    counts = ticks // common
    steps = np.diff(counts)
    if np.ptp(steps) == 0 or np.median(steps) * ROUNDING >= 1.0:
        return None  # even as it is, or as good as
    for width in _widths(steps):
        numbers = _numbered(counts, width)
        if numbers is not None:
            return _grid(counts, numbers, common * finest)
    return _without_gaps(counts, common * finest)


def _widths(steps: NDArray[np.int64]) -> list[float]:
    """Ranges of stamps about a grid with missing rows to be tried [quanta], narrow ones first.

    There are none where a longer step may be either rounding or a lost row.
    """
    near = steps[steps <= 2 * np.median(steps) + 1]
    usual = int(np.argmax(np.bincount(near)))
    shorter, odd = int(np.count_nonzero(near < usual)), int(np.count_nonzero(near != usual))
    if odd < TURNS or (usual == 1 and not shorter and odd <= MOST_BREAKS * len(steps)):
        return []
    loose = min(LOOSE, 1.0 + LOOSE_PERIODS * float(np.mean(near)))
    return [STRICT, CLOSED, loose] if usual > 1 or shorter >= TURNS else [STRICT, CLOSED]


def _without_gaps(counts: NDArray[np.int64], quantum: float) -> Grid | None:
    """The grid of rows of which none is missing, None where too few steps are odd to tell it."""
    steps = np.diff(counts)
    rows = np.arange(len(counts))
    if np.count_nonzero(steps != np.median(steps)) < TURNS or not _fits(counts, STRICT):
        return None
    return _grid(counts, rows, quantum)


def _grid(counts: NDArray[np.int64], numbers: NDArray[np.int64], quantum: float) -> Grid:
    """The grid of rows with these numbers; its period is the shortest decimal one that fits."""
    slope, least = _line(counts, numbers)
    most = CLOSED if least <= CLOSED else SHORT * least
    for digits in range(2, 16):
        short = float(f"{slope * quantum:.{digits - 1}e}") / quantum
        if np.ptp(counts - short * numbers) <= most:
            slope = short
            break
    off = counts - slope * numbers
    middle = 0.5 * float(off.max() + off.min())
    times = np.asarray(quantum * (middle + slope * numbers))
    return Grid(times, quantum * slope, quantum, 0.5 * quantum * float(np.ptp(off)))


def _numbered(counts: NDArray[np.int64], width: float) -> NDArray[np.int64] | None:
    """The number of each row on the grid, None where no grid is as narrow as ``width`` [quanta].

    The period is that of the longest stretch without a gap; it gets more certain as the rows
    about that are numbered.
    """
    n = len(counts)
    stretch = _longest_stretch(counts, width)
    if stretch is None:
        return None
    first, last = stretch
    numbers = np.arange(last - first)
    while (first, last) != (0, n):
        within = counts[first:last]
        slope, _ = _line(within, numbers)
        off = within - slope * numbers
        middle = 0.5 * float(off.max() + off.min())
        more = (last - first + 1) // 2
        first, last = max(0, first - more), min(n, last + more)
        renumbered = _number(np.asarray(counts[first:last] - middle), slope, width)
        if renumbered is None or _line(counts[first:last], renumbered, width)[1] > width:
            return None
        numbers = renumbered
    gaps = np.count_nonzero(np.diff(numbers) > 1)
    return numbers if gaps <= FIRST_BREAKS + MOST_BREAKS * n else None


def _line(
    counts: NDArray[np.int64], numbers: NDArray[np.int64], enough: float = 0.0
) -> tuple[float, float]:
    """Slope of the line over the numbers that leaves the least range, and that range.

    The range is convex in the slope, and no better line is steeper or flatter than the ends allow.
    The search ends where the range is ``enough``.
    """
    across = max(int(numbers[-1] - numbers[0]), 1)
    mean = float(counts[-1] - counts[0]) / across
    low, high = mean - 2.0 / across, mean + 2.0 / across
    for _ in range(THIRDS):
        slopes = low + (high - low) / 3.0, high - (high - low) / 3.0
        left, right = (float(np.ptp(counts - slope * numbers)) for slope in slopes)
        if min(left, right) <= enough:
            break
        low, high = (low, slopes[1]) if left <= right else (slopes[0], high)
    return min((left, slopes[0]), (right, slopes[1]))[::-1]


def _fits(counts: NDArray[np.int64], width: float) -> bool:
    return _line(counts, np.arange(len(counts)), width)[1] <= width


def _longest_stretch(counts: NDArray[np.int64], width: float) -> tuple[int, int] | None:
    """Begin and end of the most rows that lie on a line, None for more gaps than a clock has."""
    n, begin, breaks = len(counts), 0, 0
    longest = (0, 0)
    while begin < n:
        if breaks > FIRST_BREAKS + MOST_BREAKS * begin:
            return None
        end = _reach(counts, begin, width)
        longest = max(longest, (begin, end), key=lambda one: one[1] - one[0])
        begin, breaks = end, breaks + 1
    return longest if longest[1] - longest[0] >= LEAST_STRETCH else None


def _reach(counts: NDArray[np.int64], begin: int, width: float) -> int:
    """Where a line through the rows from ``begin`` on ends."""
    n = len(counts)
    good, bad = begin + 1, begin + LEAST_STRETCH
    while _fits(counts[begin:bad], width):
        if bad >= n:
            return n
        good, bad = bad, 2 * bad - begin
    bad = min(bad, n)
    while bad - good > 1:
        middle = (good + bad) // 2
        if _fits(counts[begin:middle], width):
            good = middle
        else:
            bad = middle
    return good


def _number(off: Array, slope: float, width: float) -> NDArray[np.int64] | None:
    """Numbers of rows about a line through 0, with as few gaps as can be; None if there are none.

    A row may be off the line by half the ``width``, or else by half a period: the line is not
    known for sure.
    """
    slack = CLOSED - 1.0
    half = 0.5 * max(width, slope)
    rows = np.arange(len(off))
    lowest = np.ceil((off - half) / slope - slack).astype(np.int64) - rows
    highest = np.floor((off + half) / slope + slack).astype(np.int64) - rows
    shifts, begin = np.zeros_like(rows), 0
    low, high = int(lowest[0]), int(highest[0])
    least = None  # shift after a gap; before the first one, the largest that is possible
    for row, (bottom, top) in enumerate(zip(lowest.tolist(), highest.tolist())):
        if max(low, bottom) <= min(high, top):
            low, high = max(low, bottom), min(high, top)
            continue
        shifts[begin:row] = before = high if least is None else least
        low, high, begin, least = bottom, top, row, bottom
        if not before < low <= high:
            return None
    shifts[begin:] = high if least is None else low
    return np.asarray(rows + shifts - shifts[0])


# Stamps that came late


@dataclass(frozen=True, eq=False)
class Late:
    """The even clock after whose ticks rows were stamped.

    Attributes:
        times: times of the rows on that clock [s], shape (n,), from 0.
        period: period of the clock [s].
        delays: delays of the stamps after their ticks [s], shape (n,), the least about 0.
    """

    times: Array
    period: float
    delays: Array

    @property
    def note(self) -> str:
        """What was done, as a sentence."""
        return (
            f"rows are stamped {1e3 * float(self.delays.mean()):.3g} ms late on average, up to"
            f" {1e3 * float(self.delays.max()):.3g} ms: readings are smooth over an even clock of"
            f" {1e3 * self.period:.4g} ms and not over the stamps, so the rows are put back on it"
        )


def stamped_late(times: Array, readings: Iterable[Array]) -> Late | None:
    """Return the even clock on which rows were read, None where their stamps fit as well.

    A host that stamps messages as they arrive shifts each by another delay.  Stamps that follow an
    even clock do not show which of the two is true: a host that wakes late reads late, too.  The
    readings show it.  Each is predicted by a cubic through its neighbours, once over the stamps,
    once over the clock; the wrong times leave errors where a reading moves.  The most significant
    reading decides.

    Args:
        times: times of the rows by their stamps [s], rising, shape (n,), from 0.
        readings: measured at these rows, shape (n,) each.

    Source: a period in events, Mardia, Jupp, Directional Statistics (2000), sec. 6.3 (Rayleigh
    test); delays above a least one, exponential: the tick after which they are shortest.
    """
    late, surest = _late_and_surest(times, readings)
    return late if surest > SURELY_SMOOTHER else None


def unsure_delays(log: Log) -> Array | None:
    """Return the delays [s] with which rows may have been stamped, in some order, where readings do
    not tell whether they were; None where they tell, and where stamps follow no clock."""
    late, surest = _late_and_surest(log.times, log.outputs.values())
    return late.delays if late and abs(surest) <= SURELY_SMOOTHER else None


def _late_and_surest(times: Array, readings: Iterable[Array]) -> tuple[Late | None, float]:
    """The even clock that stamps follow, and by how many standard errors the most significant
    reading is smoother over it than over the stamps."""
    late, surest = _late(times), 0.0
    if late is None:
        return None, surest
    for values in readings:
        gains = _gains(values, times / late.period, late.times / late.period)
        surer = float(gains.sum()) / max(math.sqrt(float(gains @ gains)), 1e-300)
        surest = max(surest, surer, key=abs)
    return late, surest


def _late(times: Array) -> Late | None:
    """The even clock that stamps follow; ticks may be missing between rows."""
    steps = np.diff(times)
    usual = float(np.median(steps))
    few = len(times) < LEAST_STRETCH or not usual or times[-1] > MOST_SPARSE * len(times) * usual
    if few or np.ptp(steps) < ROUNDING * usual:
        return None
    rate, coherence = _rate(times, usual)
    if coherence < LEAST_COHERENCE or coherence**2 * len(times) < LEAST_POWER:
        return None
    turns, rows = rate * times, np.arange(len(times))
    shortest, since, ticks = math.inf, turns, rows
    for phase in np.arange(PHASES) / PHASES:
        before = np.floor(turns - phase).astype(np.int64) - rows
        before = np.minimum.accumulate(before[::-1])[::-1] + rows  # no tick has two rows
        delays = turns - phase - before
        if (mean := float(delays.mean())) < shortest:
            shortest, since, ticks = mean, delays, before
    if shortest < ROUNDING + 1.0 / PHASES:
        return None
    return Late((ticks - ticks[0]) / rate, 1.0 / rate, since / rate)


def _rate(times: Array, usual: float) -> tuple[float, float]:
    """The rate [1/s] that fits the stamps best, and their coherence with it, at most 1."""
    counts = np.bincount((BINS_PER_STEP / usual * times).astype(np.int64))
    powers = np.abs(np.fft.rfft(counts, 4 * len(counts)))
    rates = np.arange(len(powers)) * BINS_PER_STEP / (4 * len(counts) * usual)
    asked = (rates >= RATES[0] / usual) & (rates <= RATES[1] / usual)
    if not asked.any():
        return 0.0, 0.0
    near = rates[asked][np.argmax(powers[asked])]

    def coherence(rate: float) -> float:
        return float(abs(np.exp(2j * np.pi * rate * times).mean()))

    fine = near + np.linspace(-0.5, 0.5, 33) / times[-1]
    best = max(fine, key=coherence)
    return float(best), coherence(best)


def _gains(values: Array, stamps: Array, ticks: Array) -> Array:
    """Squared prediction error of each reading by the stamps less that by the ticks, up to 1."""
    every = np.arange(NEIGHBOURS, len(values) - NEIGHBOURS)
    rows = every[:: max(1, len(every) // MOST_PREDICTED)]
    before, after = (_prediction_errors(values, times, rows) ** 2 for times in (stamps, ticks))
    usual = np.sort(np.minimum(before, after))[: max(1, int(WITHOUT_WILD * len(rows)))].mean()
    most = WILD_SQUARE * max(float(usual), 1e-24 * float(np.ptp(values)) ** 2, 1e-300)
    return np.asarray(np.minimum(before, most) - np.minimum(after, most)) / most


def _prediction_errors(values: Array, times: Array, rows: NDArray[np.int64]) -> Array:
    """Errors of values predicted by a cubic through their neighbours, over that of white noise."""
    near = np.delete(np.arange(-NEIGHBOURS, NEIGHBOURS + 1), NEIGHBOURS)
    away = (times[rows[:, None] + near] - times[rows, None]) / NEIGHBOURS
    powers = away[..., None] ** np.arange(CUBIC)
    weights = np.linalg.pinv(powers)[:, 0]
    errors = values[rows] - np.sum(weights * values[rows[:, None] + near], axis=1)
    return np.asarray(errors / np.sqrt(1.0 + np.sum(weights**2, axis=1)))


# The clock of a whole log, and where rows are missing

GAP = 1.5  # step over the usual one above which samples are lost
STAMPS = 3  # different steps that time stamps need to show their digits, 0 among them
COARSE_STAMPS_PER_STEP = 0.3  # step of the stamps over the usual step from which stamps are coarse
JITTERY = 0.2  # standard deviation of the sampling step over its mean, from which rows are uneven
USUAL_STEPS = 0.95  # share of uneven steps that are the usual ones
SHORT_STEPS = 3  # steps below the usual one that show rounding: a lost row only makes steps longer
LONG_STEPS = 0.1  # share of steps one stamp longer than usual above which they show rounding
USUAL_ROWS = 33  # rows about a step that tell the usual one: a clock may wander
STRAIGHT_ROWS = 16  # rows over which stamps are compared with a straight line
BENT_STAMPS = 2.0  # second difference of stamps, in their steps, that rounding does not reach
BENT_ROWS = 0.1  # share of such rows up to which stamps are straight: gaps bend the rows about them


@dataclass(frozen=True)
class Gap:
    """Samples are missing after ``row`` of the file: nothing for ``length`` [s]."""

    row: int
    time: float
    length: float


@dataclass(frozen=True)
class Sampling:
    """The clock of a log, all in seconds.

    Attributes:
        samples: number of samples.
        duration: time from the first to the last.
        step: mean of the steps that are no gaps.
        jitter: their standard deviation.
        stamp: smallest common step of the time stamps, 0 for none.
        gaps: steps longer than 1.5 usual ones; where stamps are rounded, also longer than the usual
            step nearby plus a stamp, so that a lost row shorter than two stamps may not show.
        rounded: the stamps are so coarse that the steps differ by their rounding.
    """

    samples: int
    duration: float
    step: float
    jitter: float
    stamp: float
    gaps: tuple[Gap, ...]
    rounded: bool = False


def lost_rows(log: Log) -> NDArray[np.int64]:
    """Return the samples after which rows are missing; where rows are uneven, those after which
    they may be, since no more than a few steps are longer."""
    steps = np.diff(log.times)
    if len(steps) < STAMPS:
        return np.empty(0, dtype=np.int64)
    lost, *_ = _lost(steps)
    kept = np.delete(steps, lost)
    if kept.std() <= JITTERY * kept.mean():
        return lost
    return np.flatnonzero(steps > (1.0 + ROUNDING) * np.quantile(steps, USUAL_STEPS))


def _lost(steps: Array) -> tuple[NDArray[np.int64], float, bool]:
    """Steps [s] in which rows are missing, the step of the stamps, and whether that is coarse."""
    stamp = reading_step(np.round([*steps, 0.0, 0.0], DECIMALS), STAMPS).size
    longest: float | Array = GAP * float(np.median(steps))
    if rounded := _are_rounded(steps, stamp):
        near = np.minimum(steps, np.median(steps) + GAP * stamp)
        around = np.pad(near, USUAL_ROWS // 2, mode="edge")
        usual = np.convolve(around, np.full(USUAL_ROWS, 1.0 / USUAL_ROWS), "valid")
        off = stamp / USUAL_ROWS  # by the rounding of the first and of the last of these rows
        longest = np.maximum(GAP * usual, usual + stamp + 2.0 * off)
    return np.flatnonzero(steps > longest), stamp, rounded


def sampling(log: Log) -> Sampling:
    """Return the clock of a log."""
    steps = np.diff(log.times)
    lost, stamp, rounded = _lost(steps)
    kept = np.delete(steps, lost)
    gaps = tuple(Gap(int(log.rows[i]), float(log.stamps[i]), float(steps[i])) for i in lost)
    return Sampling(
        samples=len(log.times),
        duration=log.duration,
        step=float(kept.mean()),
        jitter=float(kept.std()),
        stamp=stamp,
        gaps=gaps,
        rounded=rounded,
    )


def _are_rounded(steps: Array, stamp: float) -> bool:
    """Whether stamps in steps of ``stamp`` [s] are coarse, so that steps differ by rounding.

    Stamps on an even grid have been put back on it before.
    """
    usual = float(np.percentile(steps, 50.0, method="lower"))  # a step, never between two
    if stamp < COARSE_STAMPS_PER_STEP * usual or not stamp:
        return False
    off = np.round((steps - usual) / stamp)
    if np.sum(off < 0) >= SHORT_STEPS:
        return True
    one_each = usual < GAP * stamp  # a row of a stamp: a lost one is a stamp too
    return bool(np.mean(off == 1) > LONG_STEPS) and not (one_each and _are_bent(steps / stamp))


def _are_bent(steps: Array) -> bool:
    """Whether stamps with these steps [stamps] leave a straight line by more than rounding.

    Lost rows add up by chance, and the rounding of a clock does not add up.
    """
    stamps = np.cumsum(np.round(steps))
    rows = min(STRAIGHT_ROWS, (len(stamps) - 1) // 3)
    bend = stamps[2 * rows :] - 2.0 * stamps[rows:-rows] + stamps[: -2 * rows]
    return bool(np.mean(np.abs(bend) >= BENT_STAMPS) > BENT_ROWS)
