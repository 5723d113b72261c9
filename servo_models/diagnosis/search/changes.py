"""What an effect changes: simulated at its sizes, other parameters where it would take them.

Where a response is a staircase of the size, other parameters have made up for the cause, and the
true size looks like any other until they are taken back.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import pi

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.fitting.discontinuous import delays_of
from servo_models.diagnosis.fitting.linearisation import Linearisation
from servo_models.diagnosis.trial_values import Settings
from servo_models.errors import UserError

CORRECTIONS, BESIDE, GROUP = 2, 1.05, 32
"""Times that other parameters are corrected before a staircase is judged, and sizes, relative to
each other, so near that once is enough; so many of them are looked at one after another."""
SOONER = (0.25, 0.5, 0.75)
"""Parts of a hold's period by which a delay is less beside it, of which the best is taken; at a
first look it is half of it, which is as often among the best sizes."""


def neighbours(one: Candidate) -> list[list[Settings]]:
    """Sizes of an effect that are simulated one after another: those of a staircase that are
    near each other, since one tells where the other parameters are at the next."""
    if not one.discontinuous:
        return [[size] for size in one.trial_values]
    found: list[list[Settings]] = []
    for size in sorted(one.trial_values, key=lambda it: max(it.values())):
        last = found[-1][-1] if found and len(found[-1]) < GROUP else None
        if last and max(size.values()) < BESIDE * max(last.values()):
            found[-1].append(size)
        else:
            found.append([size])
    return found


def changes(
    seen: Linearisation, base: Settings, task: tuple[Candidate, Sequence[Settings]]
) -> list[Array]:
    """Changes of the weighted errors by an effect at sizes, each of shape (m + priors, 1 or 2)."""
    one, sizes = task
    if one.late and _delay(seen):
        return _held(seen, base, sizes, (0.5,))
    return [_simulated(seen, base, one, size) for size in sizes]


def corrected_changes(
    seen: Linearisation, base: Settings, task: tuple[Candidate, Sequence[Settings]]
) -> list[Array]:
    """The same, other parameters corrected beside a staircase."""
    one, sizes = task
    if not one.discontinuous:
        return changes(seen, base, task)
    if one.late and _delay(seen):
        return _held(seen, base, sizes, SOONER)
    whole = _difference(seen, {**base, **sizes[0]})
    for _ in range(CORRECTIONS - 1):
        whole = _corrected(seen, sizes[0], whole)
    found = []
    for size in sizes:
        whole = _corrected(seen, size, whole)
        if _left(seen, whole) > seen.left:  # slopes may have led astray
            whole = min(whole, _difference(seen, {**base, **size}), key=partial(_left, seen))
        found.append(whole[:, None])
    return found


def _simulated(seen: Linearisation, base: Settings, one: Candidate, size: Settings) -> Array:
    """The change by an effect; of a ripple, those by its sine and by its cosine."""
    phases = (0.0, pi / 2.0) if one.ripple else ()
    probes = [{**size, one.ripple[1]: at} for at in phases] if one.ripple else [size]
    return np.column_stack([_difference(seen, {**base, **probe}) for probe in probes])


def _corrected(seen: Linearisation, size: Settings, whole: Array) -> Array:
    """A change by an effect once more, from where it would take the other parameters."""
    return _change(seen, seen.start(whole), size)


def _held(
    seen: Linearisation, base: Settings, sizes: Sequence[Settings], parts: Sequence[float]
) -> list[Array]:
    """Changes by a hold, with the delay less by the part of its period that leaves least.

    A hold is late by half its period on average, and by how much at an edge of the command no
    slope tells: the clock may tick just after it.
    """
    delay = _delay(seen)
    least = next(free.low for free in seen.problem.free if free.name == delay)
    found = []
    for size in sizes:
        (period,) = size.values()
        sooner = dict.fromkeys(max(base[delay] - part * period, least) for part in parts)
        tried = [_change(seen, {**base, delay: time}, size) for time in sooner]
        best = tried[0] if len(tried) == 1 else min(tried, key=partial(_left, seen))
        found.append(best[:, None])
    return found


def _left(seen: Linearisation, change: Array) -> float:
    """Squared errors beside a change, without what parameters imitate."""
    return float(np.sum(seen.without(seen.errors + change) ** 2))


def _delay(seen: Linearisation) -> str:
    """The free delay of a problem, empty where there is none."""
    delays = delays_of(seen.problem)
    return seen.problem.free[delays[0]].name if delays else ""


def _change(seen: Linearisation, values: Settings, size: Settings) -> Array:
    """A change by an effect with other parameters at ``values``, less what their slopes do."""
    change = _difference(seen, {**values, **size})
    if not change.any():  # also where nothing can be simulated: slopes would make a change of it
        return change
    vector = np.array(list(values.values())) / seen.problem.scales
    change -= seen.slopes @ (vector - seen.vector)
    change[seen.problem.samples :] = 0.0
    return change


def _difference(seen: Linearisation, values: dict[str, float]) -> Array:
    """Change of the weighted errors, none where nothing can be simulated; the priors do not
    change."""
    problem = seen.problem
    try:
        changed = problem.errors_with(values, strict=True)
    except UserError:
        return np.zeros(len(seen.errors))
    changed -= seen.errors
    changed[problem.samples :] = 0.0
    return changed
