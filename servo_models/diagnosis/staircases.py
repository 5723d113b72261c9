"""Which of thousands of sizes of a staircase are worth a look: a short list from short logs.

Where a response is a staircase of a size no slope leads to the best one, and beside another
effect the best is another one than alone.  The first part of the logs tells quickly which sizes
are near it; the whole logs then tell them apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import log, sqrt

import numpy as np

from servo_models.diagnosis.candidates import Candidate, candidates
from servo_models.diagnosis.explanation import Bench, Explanation
from servo_models.diagnosis.screening import Sight, look
from servo_models.diagnosis.sizes import Settings
from servo_models.diagnosis.view import view
from servo_models.recording import Log

SHORT = 2000
"""Samples of the part of the logs that is looked at first."""
APART = 0.005
"""Relative distance of the sizes that are looked at first, at least."""
SHOWN, AROUND = 0.7, 2.0
"""Share of what is left that the best of them has to leave at most for all sizes within a factor
to be looked at: a needle may lie beside what resembles it."""
WEAK, STRONG = 0.1, 10.0
"""What a staircase moves over what is left to explain, between which it may be the cause."""
LISTED = 6
"""Sizes that are looked at with the whole logs, and their neighbours that only these tell apart."""


def shortlist(
    bench: Bench, first: Explanation, every: Sequence[Candidate], seen: Sequence[Sight] = ()
) -> tuple[Candidate, ...]:
    """Return the staircases among some effects, with the sizes that look best beside ``first``.

    What was ``seen`` of them tells how much a size moves.
    """
    stairs = {one.name: one for one in every if one.fine and one.name not in first.effects}
    if not stairs:
        return ()
    brief = replace(bench, logs=shortened(bench.logs))
    problem = brief.problem([free for free in first.problem.free if free.prior is None])
    here = view(problem, first.evidence.vector, first.widths)
    short = [one for one in candidates(bench.model, brief.logs) if one.name in stairs]
    found = []
    for one in short:
        full = stairs[one.name]
        grid = [*full.sizes, *_thinned(_fitting(one.fine, one.name, seen))]
        sights, _ = look((here,), [replace(one, sizes=tuple(grid))])
        shown = bool(sights) and sights[0].left < SHOWN * here.left
        if shown:
            nearer = _about(sights[0].settings, one.fine)
            sights += look((here,), [replace(one, sizes=tuple(nearer))])[0]
            grid += nearer
        best = [it.settings for it in sorted(sights, key=lambda it: it.left)[:LISTED]]
        near = [it for size in best for it in _between(full.fine, grid, size)] if shown else []
        sizes = {tuple(it.items()): it for it in (*best, *near)}
        found.append(replace(full, sizes=tuple(sizes.values())))
    return tuple(found)


def _about(best: Settings, every: Sequence[Settings]) -> list[Settings]:
    """Sizes within a factor of the best."""
    (size,) = best.values()
    return [it for it in every if size / AROUND < max(it.values()) < size * AROUND]


def _thinned(every: Sequence[Settings]) -> list[Settings]:
    """Of sizes that fall, those that are apart from each other."""
    found: list[Settings] = []
    last = np.inf
    for it in every:
        size = max(it.values())
        if size < last * (1.0 - APART):
            found.append(it)
            last = size
    return found


def _fitting(sizes: Sequence[Settings], name: str, seen: Iterable[Sight]) -> Sequence[Settings]:
    """Sizes that move about as much as there is left to explain."""
    own = {
        max(it.settings.values()): np.linalg.norm(it.difference) / sqrt(it.seen.left)
        for it in seen
        if it.candidate.name == name
    }
    if not own:
        return sizes
    known = sorted(own)
    moved = np.log([own[size] for size in known])
    wanted = np.log([max(it.values()) for it in sizes])
    found = np.interp(wanted, np.log(known), moved)
    return [it for it, size in zip(sizes, found) if log(WEAK) < size < log(STRONG)]


def shortened(logs: Sequence[Log], samples: int = SHORT) -> tuple[Log, ...]:
    """Return the first parts of some logs, the same share of each; all where that is too little.

    A simulation can only begin where a log does.
    """
    share = samples / sum(len(log.times) for log in logs)
    if share >= 1.0:
        return tuple(logs)
    found = tuple(_first(log, max(2, int(share * len(log.times)))) for log in logs)
    fitted = sum(int(log.fitted.sum()) for log in found)
    return found if fitted > 0.5 * samples else tuple(logs)


def _first(log: Log, count: int) -> Log:
    return replace(
        log,
        times=log.times[:count],
        inputs={name: values[:count] for name, values in log.inputs.items()},
        outputs={name: values[:count] for name, values in log.outputs.items()},
        rows=log.rows[:count],
        held_out=log.held_out[:count],
        skipped=None if log.skipped is None else log.skipped[:count],
    )


def _between(every: Sequence[Settings], grid: Sequence[Settings], size: Settings) -> list[Settings]:
    """Sizes nearer to one of a grid than to its neighbours there."""
    (switch,) = size
    value = size[switch]
    others = np.array([it[switch] for it in grid])
    below, above = others[others < value], others[others > value]
    low = 0.5 * (value + below.max()) if len(below) else value
    high = 0.5 * (value + above.min()) if len(above) else value
    return [it for it in every if low <= it[switch] <= high]
