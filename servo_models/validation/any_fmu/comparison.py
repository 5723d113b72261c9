"""One output of an FMU against its reference: what differs, by how much, and the likely cause.

The judgement is a tube: at every point the output has to come within ``value`` of what the
reference takes within ``time`` of it, and the reference within ``value`` of what the output
takes.  The second half finds what the output leaves out.  Where a curve jumps between two
samples, the samples beside the jump have the length of one sample more.

The other figures say what the difference looks like: each is the least-squares estimate of one
cause, and the sentence names the cause that explains the difference best.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.statistics import rms
from servo_models.core.types import Array
from servo_models.report.numbers import number, plain, prefix, with_unit

RTOL = 0.002  # default value tolerance over the range of the reference [1]
OF_LARGEST = 1e-6  # rounding of seven digits or 32-bit numbers, over the largest absolute value
TIME = 0.001  # default time tolerance over the duration of the run
STEP_SHARE = 0.6  # largest default time tolerance in communication steps; held inputs cost 0.5
CONTINUOUS_JUMP = 0.05  # least jump of a continuous output over its range
STEEPER = 4.0  # least jump over the changes beside it
LOOSE = 0.5  # fraction of both limits that the partner of a jump has to reach
STEP_LATE = 1.01  # communication steps that may pass before an event shows
EXPLAINED = 0.35  # fraction of the RMS difference that the named cause may leave
ENOUGH = 0.1  # fraction of the RMS difference up to which no second cause is sought
INVERTED = 0.95  # least slope, negated, of a held output that is inverted
STILL = 0.05  # least fraction of the run without a change that is a standstill
MOSTLY = 0.8  # least fraction of a standstill in which the reference is elsewhere
SPIKE = 3  # points outside their limits, at most, that are a spike
SEARCHED = 0.1  # longest delay that is searched, over the duration of the run
MOST_SHIFTS = 200  # delays that are tried at most
MOST_POINTS = 4000  # points that are compared for a delay, at most about
FINAL = 0.05  # fraction of the run that is its end
UNITS = {
    "deg for rad": 180.0 / math.pi,
    "rpm for rad/s": 30.0 / math.pi,
    "rpm for Hz": 60.0,
    "kilo, or milli, for one": 1000.0,
    "micro for one": 1e6,
    "percent for one": 100.0,
    "Hz for rad/s": 0.5 / math.pi,
    "km/h for m/s": 3.6,
    "inch for cm": 1.0 / 2.54,
    "kgf for N": 1.0 / 9.80665,
    "bar for Pa": 1e-5,
}
"""Factors between units that are mistaken for each other."""


@dataclass(frozen=True, eq=False)
class Trace:
    """A signal over time, lines between its points or values that are held; shapes (n,)."""

    times: Array
    values: Array
    held: bool = False

    def at(self, times: Array) -> Array:
        """Return the values at any times; before and after it keeps its first and last."""
        if not self.held:
            return np.interp(times, self.times, self.values)
        index = np.searchsorted(self.times, times + 1e-9 * self.sample, side="right") - 1
        return self.values[np.clip(index, 0, None)]

    @property
    def sample(self) -> float:
        """Longest distance of two neighbouring points [s]."""
        return float(np.median(np.diff(np.unique(self.times))))

    @property
    def range(self) -> float:
        return float(np.ptp(self.values))

    def within(self, times: Array, window: Array) -> tuple[Array, Array]:
        """Return the least and the largest value within ``window`` [s] of each time."""
        begin = np.searchsorted(self.times, times - window, side="left")
        end = np.searchsorted(self.times, times + window, side="right")
        low, high = _extremes(self.values, begin, end)
        for edge in (self.at(times - window), self.at(times), self.at(times + window)):
            low, high = np.minimum(low, edge), np.maximum(high, edge)
        return low, high

    def jumps(self, strict: float = 1.0) -> tuple[Array, Array]:
        """Return times [s] and sizes of the steps between two neighbouring points.

        In a curve that moves only changes far above their neighbours count: ``strict`` scales it.
        """
        change = np.diff(self.values)
        if self.held:
            at = np.flatnonzero(change)
        else:
            size = np.abs(change)
            padded = np.concatenate([[0.0], size, [0.0]])
            beside = np.maximum(padded[:-2], padded[2:])
            large = size > strict * CONTINUOUS_JUMP * self.range
            at = np.flatnonzero(large & (size > strict * STEEPER * beside))
        return self.times[at + 1], change[at]


def _extremes(values: Array, begin: NDArray[np.intp], end: NDArray[np.intp]) -> tuple[Array, Array]:
    """Least and largest of ``values[begin:end]``, by tables of spans of 1, 2, 4, ... values."""
    low = np.full(len(begin), np.inf)
    high = -low
    least, largest, span = values, values, 1
    length = end - begin
    while span <= max(length.max(), 0):
        fits = (length >= span) & (length < 2 * span)
        first, last = begin[fits], end[fits] - span
        low[fits] = np.minimum(least[first], least[last])
        high[fits] = np.maximum(largest[first], largest[last])
        least = np.minimum(least[:-span], least[span:]) if len(least) > span else least[:0]
        largest = np.maximum(largest[:-span], largest[span:]) if len(largest) > span else least
        span *= 2
    return low, high


@dataclass(frozen=True)
class Allowed:
    """Tolerances of one output: ``value`` in its unit, ``time`` [s]."""

    value: float
    time: float


def allowed(
    reference: Trace,
    step: float,
    exact: bool = False,
    atol: float | None = None,
    rtol: float | None = None,
    time: float | None = None,
) -> Allowed:
    """Return tolerances, the defaults where None is given.

    Args:
        reference: whose range and largest value count.
        step: communication step [s].
        exact: of whole numbers or truth values.
        atol: in the unit of the output; with it, ``rtol`` is 0 unless given.
        rtol: of the range of the reference, or of its value where that is constant [1].
        time: [s].
    """
    largest = float(np.max(np.abs(reference.values)))
    size = reference.range if reference.range > OF_LARGEST * largest else largest or 1.0
    duration = float(reference.times[-1] - reference.times[0])
    if rtol is None:
        rtol = RTOL if atol is None and not exact else 0.0
    default_time = min(TIME * duration, STEP_SHARE * step)
    value = (atol or 0.0) + rtol * size + OF_LARGEST * largest
    return Allowed(value or OF_LARGEST, default_time if time is None else time)


@dataclass(frozen=True)
class Measured:
    """A measured figure; no limit, no judgement.

    Attributes:
        name: what was measured.
        value, limit: in ``unit``.
    """

    name: str
    value: float
    limit: float | None
    unit: str

    @property
    def passed(self) -> bool | None:
        return None if self.limit is None else bool(self.value <= self.limit)


@dataclass(frozen=True, eq=False)
class Compared:
    """One output beside its reference.

    Attributes:
        name, unit: of the output.
        reference, response: the curves.
        low, high: the tube at ``times``, which are points of one of them.
        figures: what was measured.
        fault: the sentence that names what is wrong, "" for nothing.
    """

    name: str
    unit: str
    reference: Trace
    response: Trace
    times: Array
    low: Array
    high: Array
    figures: tuple[Measured, ...]
    fault: str = ""

    @property
    def passed(self) -> bool:
        return not self.fault


def compare(
    name: str, unit: str, reference: Trace, response: Trace, limits: Allowed, step: float
) -> Compared:
    """Judge one output within ``limits``, see ``allowed``; ``step`` is the communication step of
    the response [s]."""
    bad = np.flatnonzero(~np.isfinite(response.values))
    if len(bad):
        when = response.times[bad[0]]
        fault = f"output '{name}' is no number from t = {number(when)} s on"
        figure = Measured("values that are no number", float(len(bad)), 0.0, "1")
        none = np.empty(0)
        curves = (reference, response, none, none, none)
        return Compared(name, unit, *curves, (figure,), plain(fault))
    look = _Look(name, unit, reference, response, limits, step)
    figures = tuple(look.figures())
    wrong = any(figure.passed is False for figure in figures)
    fault = plain(f"output '{name}' {look.cause(figures)}") if wrong else ""
    tube = (look.times, look.low - limits.value, look.high + limits.value)
    return Compared(name, unit, reference, response, *tube, figures, fault)


class _Look:
    """A comparison at work: curves on common points, the difference beyond the time tolerance."""

    def __init__(
        self, name: str, unit: str, reference: Trace, response: Trace, limits: Allowed, step: float
    ) -> None:
        self.name, self.unit, self.limits = name, unit, limits
        self.reference, self.response = reference, response
        self.step, self.sample = step, max(step, reference.sample)
        coarser = reference if reference.sample >= response.sample else response
        self.times = np.unique(coarser.times)
        self.right, self.got = reference.at(self.times), response.at(self.times)
        held = reference.held
        # what is a step depends on how far points are apart; a pulse between two is on neither
        self.curves = [Trace(self.times, values, held) for values in (self.right, self.got)]
        self.partners = [reference, response] if held else self.curves
        window = self._window()
        self.low, self.high = reference.within(self.times, window)
        low, high = response.within(self.times, window)
        beyond = self.got - np.clip(self.got, self.low, self.high)
        left_out = np.clip(self.right, low, high) - self.right
        left_out[self.times + window > self.times[-1]] = 0.0  # it may come after the run
        self.beyond = np.where(np.abs(left_out) > np.abs(beyond), left_out, beyond)
        self.worst = int(np.argmax(np.abs(self.beyond)))
        self.error = self.got - self.right
        self.range = reference.range

    def _window(self) -> Array:
        """The time tolerance at each point: beside a jump, one sample more."""
        window = np.full(len(self.times), self.limits.time)
        jumps = np.concatenate([curve.jumps(LOOSE)[0] for curve in self.curves])
        jumps = np.concatenate([jumps, jumps - self.sample])
        reach = STEP_LATE * self.sample + self.limits.time
        for jump in jumps if len(jumps) < len(self.times) else ():
            window[np.abs(self.times - jump) <= reach] = reach
        return window

    def figures(self) -> Iterable[Measured]:
        """Measure everything; the tube first, then what the difference looks like."""
        value = self.limits.value
        worst = abs(float(self.beyond[self.worst]))
        yield Measured("distance from the tube's middle", worst, value, self.unit)
        size = self.range or float(np.max(np.abs(self.right))) or 1.0
        yield Measured("NRMSE", rms(self.beyond) / size, value / size, "1")
        yield Measured("error at the start", abs(float(self.beyond[0])), value, self.unit)
        yield Measured("error at the end", abs(self._end(self.beyond)), value, self.unit)
        yield from self._events()
        if not self.reference.held and self.range > OF_LARGEST * float(np.max(np.abs(self.right))):
            yield from self._shape()

    def _shape(self) -> Iterable[Measured]:
        """Gain, delay and drift of a curve that moves."""
        spread = float(np.std(self.right)) or 1.0
        delay, _ = self.delay()
        slope = rms(np.gradient(self.right, self.times))
        longest = max(self.limits.time, self.limits.value / slope if slope else math.inf)
        gain, _ = self.gain(self.right + self.beyond)
        yield Measured("gain error", abs(gain - 1.0), self.limits.value / spread, "1")
        yield Measured("delay", abs(delay), longest, "s")
        drift = float(np.polyfit(self._part(), self.beyond, 1)[0])
        yield Measured("drift over the run", abs(drift), 2.0 * self.limits.value, self.unit)

    def _events(self) -> Iterable[Measured]:
        """Steps of both curves, matched in order by direction."""
        (right, got), (reference, response) = self.curves, self.partners
        self.matched = match(right.jumps(), response.jumps(LOOSE), self.times[-1])
        self.extra = match(got.jumps(), reference.jumps(LOOSE), self.times[-1]).missed
        # a whole step or row if one of the two has finer points
        finer = min(self.step, self.reference.sample) < 0.99 * self.sample
        share = STEP_LATE if finer else STEP_SHARE
        self.median_late = max(self.limits.time, share * self.sample)
        self.latest = self.limits.time + STEP_LATE * self.sample
        if not (self.matched.right or self.matched.missed or self.extra):
            return
        yield Measured("events missed", float(len(self.matched.missed)), 0.0, "1")
        yield Measured("events that are none", float(len(self.extra)), 0.0, "1")
        if late := self.matched.late:
            usual, worst = abs(float(np.median(late))), abs(max(late, key=abs))
            yield Measured("median lateness of events", usual, self.median_late, "s")
            yield Measured("largest lateness of an event", worst, self.latest, "s")

    # Causes: each a model of the response from the reference, and what it leaves

    def delay(self) -> tuple[float, float]:
        """Return the shift [s] at which the reference fits the response best, and what is left."""
        from scipy.optimize import minimize_scalar

        every = max(len(self.times) // MOST_POINTS, 1)
        times, got = self.times[::every], self.got[::every]

        def left(shift: float) -> float:
            return rms(got - self.reference.at(times - shift))

        longest = SEARCHED * (self.times[-1] - self.times[0])
        count = min(int(longest / self.sample * 2.0) + 1, MOST_SHIFTS)
        shifts = np.linspace(-longest, longest, 2 * count + 1)
        best = min(shifts, key=lambda shift: (left(shift), abs(shift)))
        width = longest / count
        optimum = minimize_scalar(
            left, bounds=(best - width, best + width), method="bounded", options={"xatol": 1e-9}
        )
        if left(0.0) <= optimum.fun:
            return 0.0, left(0.0)
        return float(optimum.x), float(optimum.fun)

    def gain(self, got: Array) -> tuple[float, float]:
        """Return the slope of a response over the reference, and what is left."""
        return _slope(self.right - self.right.mean(), got - got.mean())

    def _part(self) -> Array:
        """Time as a share of the run, from 0 to 1."""
        return np.asarray((self.times - self.times[0]) / (self.times[-1] - self.times[0]))

    def _end(self, values: Array) -> float:
        return float(np.mean(values[self._part() >= 1.0 - FINAL]))

    def cause(self, figures: Sequence[Measured]) -> str:
        """Return what is wrong in words: the cause that explains the difference best."""
        words = self._event_words()
        if self.reference.held:
            gain, _ = self.gain(self.got)
            if self.range and gain < -INVERTED:
                return f"is inverted: its gain is {number(gain)}"
            return words or self._worst_words()
        cause = self._stands_still() or self._starts() or self._best(bool(words)) or words
        if not cause:
            cause = self._other_words()
            if figures[2].passed is False:
                cause += (
                    f"; it starts at {self._value(self.got[0])}, not {self._value(self.right[0])}"
                )
        return cause

    def _best(self, events: bool) -> str:
        """The single cause that leaves least, two where they leave far less, "" where none does.

        Where events differ as well, a cause has to explain nearly all.
        """
        whole = rms(self.error)
        single = min(self._single(), key=lambda one: one[0])
        if single[0] > ENOUGH * whole and self.range:
            gain, left = self.gain(self.got)
            if left < 0.5 * single[0]:
                offset = float(self.got.mean() - gain * self.right.mean())
                words = f"{self._gain_words(gain, 0.0)} and an offset of {self._value(offset)}"
                single = (left, lambda: words)
        return single[1]() if single[0] <= (ENOUGH if events else EXPLAINED) * whole else ""

    def _single(self) -> Iterable[tuple[float, Callable[[], str]]]:
        """The RMS difference that each cause leaves, and the sentence for it."""
        offset = float(np.mean(self.error))
        yield (
            rms(self.error - offset),
            lambda: f"is {self._value(abs(offset))} too " + ("high" if offset > 0.0 else "low"),
        )
        part = self._part()
        drift = float(part @ self.error) / float(part @ part)
        yield (
            rms(self.error - drift * part),
            lambda: f"drifts by {self._value(drift)} over the run",
        )
        if not self.range:
            return
        begin = float(self.right[0])
        gain, left = _slope(self.right, self.got)
        yield left, lambda: self._gain_words(gain, 0.0)
        from_begin, left = _slope(self.right - begin, self.got - begin)
        yield left, lambda: self._gain_words(from_begin, begin)
        delay, left = self.delay()
        yield left, lambda: self._delay_words(delay)

    def _stands_still(self) -> str:
        """Sentence for an output that keeps its value for a while in which the reference moves."""
        changes = np.flatnonzero(np.diff(self.got))
        edges = np.concatenate([[-1], changes, [len(self.got) - 1]])
        longest = int(np.argmax(np.diff(edges)))
        first, last = int(edges[longest]) + 1, int(edges[longest + 1])
        if last - first < STILL * len(self.got) or not len(changes):
            return ""
        apart = np.abs(self.error[first : last + 1]) > self.limits.value
        if np.mean(apart) < MOSTLY or np.ptp(self.right[first : last + 1]) <= self.limits.value:
            return ""
        since, until = (number(self.times[k]) for k in (first, last))
        return f"stays at {self._value(self.got[first])} from t = {since} s to {until} s"

    def _starts(self) -> str:
        """Sentence for a wrong start that decays."""
        first, worst = abs(self.error[0]), float(np.max(np.abs(self.error)))
        fades = first >= 0.999 * worst and abs(self._end(self.error)) < 0.1 * first
        if not fades or abs(self.beyond[0]) <= self.limits.value or self._roughness() > 1.0:
            return ""
        return f"starts at {self._value(self.got[0])} instead of {self._value(self.right[0])}"

    def _roughness(self) -> float:
        """RMS change of the error from sample to sample over its RMS: 1.4 is white noise."""
        return rms(np.diff(self.error)) / (rms(self.error - self.error.mean()) or 1.0)

    def _gain_words(self, gain: float, origin: float) -> str:
        if abs(gain + 1.0) < 0.05:
            return f"has the wrong sign: its gain is {number(gain, 4)}"
        for name, factor in UNITS.items():
            for ratio in (factor, 1.0 / factor):
                if abs(gain / ratio - 1.0) < 0.01:
                    return f"is in another unit: it is {number(ratio)} times as large ({name}?)"
        start = f" from {self._value(origin)} on" if origin else ""
        return (
            f"has a gain of {number(gain, 5)}{start}, an error of {number(100 * (gain - 1), 3)} %"
        )

    def _delay_words(self, delay: float) -> str:
        words = f"is {_late(delay)}"
        if abs(delay / self.sample - 0.5) < 0.05:
            words += (
                "; that is half a communication step, as where the reference does not hold inputs"
            )
        return words

    def _event_words(self) -> str:
        """Sentence about events that differ, "" for none."""
        matched, different = self.matched, []
        for does, events, which in (
            ("misses", matched.missed, ""),
            ("has", self.extra, " that the reference has not"),
        ):
            if events:
                count = "an event" if len(events) == 1 else f"{len(events)} events"
                first = f"the first at t = {number(events[0])} s"
                different.append(f"{does} {count}{which}, {first}")
        if different or not matched.late:
            return ", and ".join(different)
        usual = float(np.median(matched.late))
        if abs(usual) > self.median_late:
            return f"has its events {_late(usual)}"
        worst = max(matched.late, key=abs)
        when = matched.right[matched.late.index(worst)]
        late = abs(worst) > self.latest
        return f"has its event at t = {number(when)} s {_late(worst)}" if late else ""

    def _other_words(self) -> str:
        """A difference that no single cause explains."""
        error, outside = self.error, np.abs(self.beyond) > self.limits.value
        if np.sum(outside) <= SPIKE:
            return f"leaves the reference for {int(np.sum(outside))} point(s): {self._worst()}"
        if self._roughness() > 1.0:
            return f"is noisy: it differs by {self._value(rms(error))} RMS from sample to sample"
        end = self._end(self.beyond)
        if abs(end) > max(self.limits.value, 0.5 * float(np.max(np.abs(error)))):
            right, got = self._end(self.right), self._end(self.got)
            return f"ends at {self._value(got)} instead of {self._value(right)}"
        return self._worst_words()

    def _worst_words(self) -> str:
        if self.reference.held:
            right, got = self.right[self.worst], self.got[self.worst]
            when = number(self.times[self.worst])
            return f"is {self._value(got)} instead of {self._value(right)} at t = {when} s"
        return f"differs by {self._worst()}"

    def _worst(self) -> str:
        distance, when = abs(float(self.beyond[self.worst])), number(self.times[self.worst])
        allowed = self._value(self.limits.value)
        return f"{self._value(distance)} at t = {when} s, of {allowed} allowed"

    def _value(self, value: float) -> str:
        return with_unit(number(value), self.unit)


@dataclass(frozen=True)
class Matched:
    """Events: times [s] of matched ones and their lateness [s]; times [s] of the others."""

    right: list[float]
    late: list[float]
    missed: list[float]


def match(right: tuple[Array, Array], got: tuple[Array, Array], end: float) -> Matched:
    """Match each event with the nearest one of its direction, within half of the time between two.

    Args:
        right, got: times [s] and sizes of the reference and the response.
        end: of the run [s]; an event at the end may be seen after it.
    """
    times, sizes = right
    kinds = [times[sizes > 0.0], times[sizes < 0.0]]
    gaps = [np.diff(kind).min() for kind in kinds if len(kind) > 1]
    reach = 0.5 * min(gaps) if gaps else math.inf
    matched = Matched([], [], [])
    free = np.ones(len(got[0]), dtype=bool)
    for time, size in zip(times, sizes):
        far = np.where(free & (got[1] * size > 0.0), np.abs(got[0] - time), math.inf)
        nearest = int(np.argmin(far)) if len(far) else 0
        if not len(far) or not far[nearest] <= reach or math.isinf(far[nearest]):
            matched.missed.append(float(time))
            continue
        free[nearest] = False
        matched.right.append(float(time))
        matched.late.append(float(got[0][nearest] - time))
    latest = max(matched.late, default=0.0)
    while matched.missed and matched.missed[-1] + latest > end:  # it comes after the run
        matched.missed.pop()
    return matched


def _slope(right: Array, got: Array) -> tuple[float, float]:
    """Slope of a line through 0 that gives one curve from another, and what it leaves."""
    power = float(right @ right)
    slope = float(right @ got) / power if power else 1.0
    return slope, rms(got - slope * right)


def _late(time: float) -> str:
    factor, unit = prefix(abs(time), "s")
    return f"{number(abs(time) * factor, 3)} {unit} {'late' if time > 0.0 else 'early'}"
