"""Further sines of a ripple: cogging of a motor has several, each of a count of its own.

The first one is found as any effect is.  The spectrum of what is left, over the angle instead of
time, then shows which counts there may be.  Each number of sines is fitted from two starts.  One
adds a sine to the model so far.  The other has all sines at once and nominal parameters: beside too
few sines, parameters drift to where they imitate the missing ones.
Sources: Fyfe, Munck, Mechanical Systems and Signal Processing 11 (1997) 187 (order tracking: a
spectrum over the angle); Scargle, Astrophysical Journal 263 (1982) 835 (spectrum of unequal
samples); Pati, Rezaiifar, Krishnaprasad, Asilomar Conference 27 (1993) 40 (matching pursuit).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from math import atan2, hypot, log, pi

import numpy as np

from servo_models.core.block import Harmonic
from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import (
    LEAST_RIPPLE_PERIODS_IN_TRAVEL,
    LEAST_SAMPLES_IN_A_PERIOD,
    Candidate,
    Values,
)
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.joint_fits import best_start
from servo_models.diagnosis.search.screening import Screened, remains, scales, screen
from servo_models.identification.linear_inference import Linearisation
from servo_models.identification.problem import Free, free_parameter

SPACING_RAD = 1.0  # change of a sine's phase over the travel between counts of a spectrum
LEAST_PERIODS_IN_TRAVEL = 2.0  # fewest of a further sine: fewer take any shape over the position
MOST_SAMPLES = 10_000  # samples of a log for its spectrum: twice as many take four times as long
PEAKS = 12  # highest peaks of the spectrum that are simulated


def with_sines(
    fitter: Fitter, model: FittedModel, ripple: Candidate, number: int
) -> FittedModel | None:
    """Return the best fit with a ``number`` of sines of an effect, 2 or more, beside a ``model``
    with fewer; None where errors show no count."""
    effects, kept = model.without(ripple.name)
    nominal = {free.name: free.nominal for free in fitter.nominal}
    alone = fitter.at_values(effects, kept, {**model.values, **nominal})
    starts = [_one_more(model, ripple, order_peaks(model, ripple), number)]
    starts.append(_pursuit(alone, ripple, order_peaks(alone, ripple), number))
    further = [_free(model, ripple, it) for it in ripple.hints.harmonics[: number - 1]]
    extra = [*kept, *ripple.free, *chain.from_iterable(further)]
    fits = [fitter.fit((*effects, ripple.name), extra, it) for it in starts if it]
    best = min(fits, key=lambda it: it.cost, default=None)
    return replace(best, chance=best.chance + number * log(PEAKS)) if best else None


def _one_more(
    model: FittedModel, ripple: Candidate, counts: Sequence[float], number: int
) -> Values | None:
    """Values [SI] of a model with one more sine at the best of some counts, None where it lacks
    more than one."""
    *before, harmonic = ripple.hints.harmonics[: number - 1]
    if any(f"{ripple.name}.{it.share}" not in model.values for it in before):
        return None
    share, count = f"{ripple.name}.{harmonic.share}", f"{ripple.name}.{harmonic.count}"
    further = replace(
        ripple,
        hints=replace(ripple.hints, phase=harmonic.phase, count=harmonic.count),
        free=tuple(_free(model, ripple, harmonic)),
        switches=(share,),
        trial_values=tuple({share: 1.0, count: it} for it in counts),
        alone=(),
    )
    results = screen((model.linearised,), [further])
    if not results:
        return None
    start = best_start(results[0])
    return {**model.values, **start.values, **{it.name: it.start for it in start.free}}


def _free(model: FittedModel, ripple: Candidate, harmonic: Harmonic) -> list[Free]:
    """Parameters of a further sine."""
    chosen, sine = model.problem.model, []
    for key in (harmonic.share, harmonic.count, harmonic.phase):
        parameter = chosen.plant.parameters[f"{ripple.name}.{key}"]
        free = free_parameter(parameter, chosen.values[parameter.name], None)
        sine.append(replace(free, low=_least_count(ripple)) if key == harmonic.count else free)
    return sine


def _count(ripple: Candidate) -> Free:
    """The count of its first sine."""
    name = f"{ripple.name}.{ripple.hints.count}"
    return next(it for it in ripple.free if it.name == name)


def _least_count(ripple: Candidate) -> float:
    """Of a further sine [periods in a turn]."""
    return _count(ripple).low * LEAST_PERIODS_IN_TRAVEL / LEAST_RIPPLE_PERIODS_IN_TRAVEL


def _pursuit(
    model: FittedModel, ripple: Candidate, counts: Sequence[float], number: int
) -> Values | None:
    """Values [SI] of a model and of so many sines at some counts, None where there are fewer."""
    linear = model.linearised
    switch = ripple.switches[0]
    size = ripple.trial_values[0][switch]
    trials = [{switch: size, f"{ripple.name}.{ripple.hints.count}": it} for it in counts]
    left = screen((linear,), [replace(ripple, trial_values=tuple(trials), alone=())])
    if len(left) < number:
        return None
    taken: list[Screened] = []
    steps = np.empty(0)
    while len(taken) < number:
        tried = [_beside(linear, [*taken, it]) for it in left]
        best = int(np.argmin([it[0] for it in tried]))
        taken.append(left.pop(best))
        steps = tried[best][1]
    return _start(linear, taken, steps)


def _beside(linear: Linearisation, taken: Sequence[Screened]) -> tuple[float, Array]:
    """Squared errors that sines leave together, and the steps of parameters and shares."""
    waves = np.hstack([it.columns for it in taken])
    columns = np.hstack([linear.slopes, waves])
    least, largest = scales(taken[0].candidate)
    low = np.concatenate([linear.room[0], np.full(waves.shape[1], least)])
    high = np.concatenate([linear.room[1], np.full(waves.shape[1], largest)])
    gram, towards = columns.T @ columns, columns.T @ linear.errors
    left, steps = remains(linear, gram[None], towards[None], low[None], high[None])
    return float(left[0]), steps[0]


def _start(linear: Linearisation, taken: Sequence[Screened], steps: Array) -> Values:
    """Values [SI] of a start: sines, the largest first, and parameters, moved by their steps where
    that leaves less."""
    ripple, p = taken[0].candidate, linear.slopes.shape[1]
    size, hints = ripple.trial_values[0][ripple.switches[0]], ripple.hints
    key = f"{ripple.name}.{hints.count}"
    sines = sorted(
        (
            (size * hypot(*share), result.settings[key], atan2(share[1], share[0]))
            for result, share in zip(taken, steps[p:].reshape(-1, 2))
        ),
        reverse=True,
    )
    (largest, count, phase), *others = sines
    settings = {ripple.switches[0]: largest, key: count, f"{ripple.name}.{hints.phase}": phase}
    for harmonic, (amplitude, count, phase) in zip(hints.harmonics, others):
        sine = {harmonic.share: amplitude / largest, harmonic.count: count, harmonic.phase: phase}
        settings |= {f"{ripple.name}.{name}": value for name, value in sine.items()}
    both = [
        {**linear.problem.values(vector), **settings}
        for vector in (linear.vector, linear.vector + steps[:p])
    ]
    return min(both, key=linear.cost)


def order_peaks(model: FittedModel, ripple: Candidate) -> list[float]:
    """Return the counts [periods in a turn] at the highest peaks of errors over the angle."""
    records = list(_over_angle(model, ripple))
    travelled = max(float(np.ptp(angle)) for angle, _ in records)
    between = [float(np.median(np.abs(np.diff(angle)))) for angle, _ in records if len(angle) > 1]
    step = min((it for it in between if it > 0.0), default=0.0)
    if not travelled or not step:
        return []
    high = min(_count(ripple).high, 2.0 * pi / (LEAST_SAMPLES_IN_A_PERIOD * step))
    counts = np.arange(_least_count(ripple), high, SPACING_RAD / travelled)
    power = np.zeros(len(counts))
    for angle, errors in records:
        onward = np.gradient(angle) > 0.0
        for way in (onward, ~onward):  # what lags in time is ahead on the way back
            if np.count_nonzero(way) > LEAST_SAMPLES_IN_A_PERIOD:
                power += sine_powers(angle[way], errors[way] - errors[way].mean(), counts)
    around = np.concatenate([[0.0], power, [0.0]])
    peaks = np.flatnonzero((power > around[:-2]) & (power >= around[2:]))
    return [float(counts[it]) for it in peaks[np.argsort(-power[peaks])][:PEAKS]]


def sine_powers(angle: Array, values: Array, counts: Array) -> Array:
    """Return half of what the best sine of each count takes off the sum of squares, shape (m,).

    Args:
        angle: angle of each value [rad], shape (n,).
        values: without their mean, shape (n,).
        counts: periods in a turn, shape (m,).
    """
    turned, n = np.exp(1j * np.outer(counts, angle)), len(values)
    double = np.sum(turned**2, axis=1)
    along = turned @ values * np.exp(-0.5j * np.angle(double))  # sine and cosine are orthogonal
    rest = np.maximum(n - np.abs(double), n * np.finfo(float).eps)
    return np.asarray(along.real**2 / (n + np.abs(double)) + along.imag**2 / rest)


def _over_angle(model: FittedModel, ripple: Candidate) -> Iterator[tuple[Array, Array]]:
    """Angle [rad] and errors [noise floors] of each output of each log, both of shape (n,)."""
    wire = model.problem.model.plant.main(ripple.name).wire_of(ripple.hints.angle)
    for k, run in enumerate(model.problem.runs):
        if not run.measured.size:
            continue
        angle = run.signal(wire, model.values)[run.log.fitted]
        stride = -(-len(angle) // MOST_SAMPLES)
        for name in run.log.outputs:
            errors = model.linearised.errors[model.problem.records[k, name]]
            yield angle[::stride], errors[::stride]
