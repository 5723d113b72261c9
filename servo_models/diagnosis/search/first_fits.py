"""What is fitted to explain a gap, and in which order: the smooth effects before staircases.

A staircase is looked for in thousands of simulations.  So these are spent only where no smooth
effect, and no pair of them, leaves noise only.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.fitting.fitted_model import FittedModel, Fitter
from servo_models.diagnosis.search.fits import (
    Seen,
    Teller,
    beside_each,
    best_of_each,
    settled,
    starts_of,
)
from servo_models.diagnosis.search.grid_search import shortlist
from servo_models.diagnosis.search.pairing import LESS, discontinuous_beside, paired, swap
from servo_models.diagnosis.search.preselection import Looks, preselect
from servo_models.diagnosis.search.screening import Screened, screen

SINGLES, FIRST = 10, 4
"""Smooth effects fitted in full, and those of them that are fitted first."""
DISCONTINUOUS = 4
"""Those fitted of which the response is a staircase of the size."""
PART = 0.5
"""Part of what an effect closes that leaves noise only, which a look-alike has to promise."""
PAIRED = 0.5
"""Loss of a pair over that of the best effect, from which staircases are not sought beside that."""


class FirstFits(NamedTuple):
    """Fitted models by one and by two effects, best first, and every effect at promising sizes."""

    singles: list[FittedModel]
    couples: list[FittedModel]
    near: list[Candidate]


def first_fits(
    fitter: Fitter,
    retuned: FittedModel,
    results: Sequence[Screened],
    every: Sequence[Candidate],
    say: Teller,
) -> FirstFits:
    """Return fits of the most promising effects, one and two at a time.

    Where one fitted model leaves noise only, others are fitted if they may be its look-alikes.

    Args:
        fitter: model, logs, priors and floors.
        retuned: nominal parameters alone.
        results: of screening ``every`` effect, from the nominal model and from there.
        say: is told what goes on.
    """
    smooth = [it for it in results if not it.candidate.grid]
    singles, near, looks = _smooth(fitter, retuned, smooth, say), preselect(every, results), Looks()
    if any(map(settled, singles)):
        singles = _with_likely_discontinuous(fitter, retuned, results, singles, singles, say)
        couples = paired(fitter, singles, results, near, looks, say)
    else:
        plain = [one for one in near if not one.grid]
        couples = paired(fitter, singles, smooth, plain, looks, say)
        if any(map(settled, couples)):
            singles = _with_likely_discontinuous(fitter, retuned, results, singles, couples, say)
        else:
            closer = _closer(fitter, retuned, singles, results, every, say)
            results = sorted([*results, *closer], key=lambda result: result.left)
            near = preselect(every, results)
            discontinuous = beside_each(fitter, retuned, starts_of(closer, DISCONTINUOUS), say)
            singles = best_of_each([*singles, *discontinuous])
            couples = _paired_with_discontinuous(
                fitter, singles, couples, results, near, looks, say
            )
    if couples and couples[0].loss < LESS * singles[0].loss:
        couples = best_of_each([*couples, *swap(fitter, couples[0], near, say)])
    return FirstFits(singles, couples, near)


def _paired_with_discontinuous(
    fitter: Fitter,
    singles: Sequence[FittedModel],
    known: Sequence[FittedModel],
    results: Sequence[Screened],
    near: Sequence[Candidate],
    looks: Looks,
    say: Teller,
) -> list[FittedModel]:
    """Pairs with staircases too; these are sought anew beside the best effect, unless some pair
    leaves so much less that none beside it need be."""
    couples = paired(fitter, singles, results, near, looks, say, known)
    if not singles:
        return couples
    if any(it.loss < PAIRED * singles[0].loss or settled(it) for it in couples):
        return couples
    return best_of_each([*couples, *discontinuous_beside(fitter, singles[0], near, looks, say)])


def _smooth(
    fitter: Fitter, retuned: FittedModel, results: Sequence[Screened], say: Teller
) -> list[FittedModel]:
    """Fits of the most promising smooth effects, best first."""
    starts = list(starts_of(results, SINGLES))
    found = beside_each(fitter, retuned, starts[:FIRST], say)
    more = _likely(starts[FIRST:], retuned, found)
    return best_of_each([*found, *beside_each(fitter, retuned, more, say)])


def _with_likely_discontinuous(
    fitter: Fitter,
    retuned: FittedModel,
    results: Iterable[Screened],
    singles: Sequence[FittedModel],
    found: Sequence[FittedModel],
    say: Teller,
) -> list[FittedModel]:
    """Single effects with the staircases that may do what one of those ``found`` does."""
    discontinuous = starts_of([it for it in results if it.candidate.grid], DISCONTINUOUS)
    likely = _likely(discontinuous, retuned, found)
    return best_of_each([*singles, *beside_each(fitter, retuned, likely, say)])


def _closer(
    fitter: Fitter,
    retuned: FittedModel,
    singles: Sequence[FittedModel],
    results: Sequence[Screened],
    every: Sequence[Candidate],
    say: Teller,
) -> list[Screened]:
    """What is seen of staircases at the sizes that look best where the best fit has put the
    nominal parameters, from there and from where these alone go."""
    say("looking closer at staircases")
    best = min([retuned, *singles], key=lambda it: it.loss)
    beside_it = fitter.unfit((), (), best.values)
    near = [it for it in results if it.seen is retuned.linearised]
    short = shortlist(fitter, beside_it, every, near)
    return screen((retuned.linearised, beside_it.linearised), short)


def _likely(
    starts: Iterable[Seen], retuned: FittedModel, found: Sequence[FittedModel]
) -> Iterator[Seen]:
    """Effects that promise enough to be a look-alike of one that leaves noise only."""
    least = min((one.cost for one in found if settled(one)), default=-np.inf)
    enough = retuned.cost + PART * (least - retuned.cost) if np.isfinite(least) else np.inf
    return ((name, own) for name, own in starts if own[0].left < enough)
