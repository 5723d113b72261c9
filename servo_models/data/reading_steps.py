"""The step in which a sensor reads, from the values it gave alone.

A step is told where all values of a log lie on a lattice, too well and too many of them for
chance, and where a finer lattice would have shown values between.  Logs of one sensor share the
step, each with an offset of its own; a log that does not lie on the step of the others is judged
by itself.
Source: code histogram test, IEEE Std 1241; here the step is unknown, so it is the common divisor
of the distances between codes.  Chance: Rissanen, Automatica 14 (1978), two numbers told for each
lattice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array

ROUNDED = 1e-12  # readings closer than this share of the largest are equal but for rounding
ON_STEP = 0.1
"""Distance from a multiple of the step, in steps, that still is on it: two digits are left."""
FINEST = 24  # steps that the two closest values are apart at most
REACHES = tuple(3.0**k for k in range(1, 16))
"""Distances in steps up to which codes are counted, one after the other: each makes the step known
to a part of the next."""
LANDINGS = 10
"""Values that met codes of twice the step alone: by chance once in a thousand (2**-10)."""
CODES = 4  # different values that readings take at least: three may be places of rest
EVEN = 0.2
"""Changes of speed for each move: fewer are a ramp, whose samples lie as far apart as codes."""
UNLIKELY = math.log(1e4)  # how much likelier, as a logarithm, a lattice is to be than chance
RESAMPLED = 0.1
"""Share of the readings that occur more than once where a resampled log shows its codes."""
SETTLING = 0.4
"""Share of the values between codes that are near one: 0.2 of those that lie anywhere.  Above,
they settle there, and the codes are places of rest."""
EQUAL = 1e-6  # part of a step that interpolation between two equal readings may leave
COARSER = 1.5
"""How much larger codes of repeated readings are than a step of all, if these were resampled."""


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
        phase = np.angle(np.mean(np.exp(2j * np.pi * turns))) / (2.0 * np.pi)
        off = (turns if values is None else values / step) - phase
        return np.asarray(np.abs(off - np.round(off)))

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
    for values, size, one in zip(records, sizes, often):
        rough = next(coarse) if one is not None else 0.0
        if one is not None and _resampled(one, values, size, rough):
            off = one.residues(rough, values)
            steps.append(Step(rough, float(np.mean(off > ON_STEP))))
        else:
            steps.append(Step(size))
    return steps


def reading_step(values: Array, least: int = CODES) -> Step:
    """Return the step of a log by itself, see ``reading_steps``."""
    return reading_steps([values], least)[0]


def _codes(values: Array) -> tuple[Array, Array]:
    """Different values but for rounding, ascending, and how often each occurs."""
    ordered = np.sort(values)
    new = np.diff(ordered, prepend=-math.inf) > ROUNDED * np.abs(values).max()
    starts = np.flatnonzero(new)
    return ordered[starts], np.diff(starts, append=len(values))


def _repeated(values: Array) -> _Record | None:
    """The readings that occur more than once, None for hardly any.

    A sensor without steps hardly gives one twice, and of a file that was resampled they are what
    the sensor gave.
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
    """The step of each record, 0 for none: of those on which it lies, the one that most lie on,
    and of these the largest."""
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
    both, own = 0.0, 0.0
    for one in records:
        number = np.concatenate([[0.0], np.cumsum(np.round(np.diff(one.codes) / step))])
        about = number - number.mean()
        both, own = both + float(about @ (one.codes - one.codes[0])), own + float(about @ about)
    return both / own if own else step


def _is_no_chance(records: Sequence[_Record], step: float, least: int) -> bool:
    worst, values, landings, bends, travel, reach = 0.0, 0, 0, 0, 0, 1.0
    for one in records:
        worst = max(worst, float(np.max(one.residues(step))))
        values += len(one.codes) - 1
        moves = np.round(np.diff(one.values) / step)
        landings += int(np.count_nonzero(np.abs(moves) == 1.0))
        bends += int(np.count_nonzero(np.diff(moves)))
        travel += int(np.count_nonzero(moves))
        reach = max(reach, float(np.ptp(one.codes)) / step)
    if worst >= ON_STEP or values < least - 1 or values + landings < LANDINGS:
        return False
    if bends < EVEN * travel:
        return False
    # of the values one is spent on the step; as many steps as codes could have been tried
    return -(values - 1) * math.log(2.0 * worst + ROUNDED) > math.log(reach) + UNLIKELY


def _off(multiples: Array) -> Array:
    return np.asarray(np.abs(multiples - np.round(multiples)))
