"""Which of thousands of sizes of a staircase are worth a look: a short list from short logs.

Where a response is a staircase of a size no slope leads to the best one, and beside another
effect the best is another one than alone.  The first part of the logs tells quickly which sizes
are near it; the whole logs then tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servo_models.diagnosis.candidates import Candidate, candidates
from servo_models.diagnosis.explanation import Bench, Explanation
from servo_models.diagnosis.screening import look, view
from servo_models.diagnosis.sizes import Settings
from servo_models.recording import Log

SHORT = 2000
"""Samples of the part of the logs that is looked at first."""
APART = 0.0025
"""Relative distance of the sizes that are looked at first, at least."""
LISTED = 6
"""Sizes that are looked at with the whole logs, and their neighbours that only these tell apart."""


def shortlist(
    bench: Bench, first: Explanation, every: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """Return the staircases among some effects, with the sizes that look best beside ``first``."""
    stairs = {one.name: one for one in every if one.fine and one.name not in first.effects}
    if not stairs:
        return ()
    brief = replace(bench, logs=shortened(bench.logs))
    problem = brief.problem([free for free in first.problem.free if free.prior is None])
    seen = view(problem, first.evidence.vector, first.widths)
    short = [one for one in candidates(bench.model, brief.logs) if one.name in stairs]
    grids = {one.name: (*stairs[one.name].sizes, *_thinned(one.fine)) for one in short}
    sights, _ = look((seen,), [replace(one, sizes=grids[one.name]) for one in short])
    found = []
    for name, one in stairs.items():
        best = [sight.settings for sight in sights if sight.candidate.name == name][:LISTED]
        near = [it for size in best for it in (size, *_between(one.fine, grids[name], size))]
        sizes = {tuple(it.items()): it for it in near}
        found.append(replace(one, sizes=tuple(sizes.values())))
    return tuple(found)


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


def _thinned(every: Sequence[Settings]) -> list[Settings]:
    """Sizes that are apart from each other."""
    found: list[Settings] = []
    last = np.inf
    for it in sorted(every, key=lambda it: -max(it.values())):
        size = max(it.values())
        if size < last * (1.0 - APART):
            found.append(it)
            last = size
    return found


def _between(every: Sequence[Settings], grid: Sequence[Settings], size: Settings) -> list[Settings]:
    """Sizes nearer to one of a grid than to its neighbours there."""
    (switch,) = size
    value = size[switch]
    others = np.array([it[switch] for it in grid])
    below, above = others[others < value], others[others > value]
    low = 0.5 * (value + below.max()) if len(below) else value
    high = 0.5 * (value + above.min()) if len(above) else value
    return [it for it in every if low <= it[switch] <= high]
