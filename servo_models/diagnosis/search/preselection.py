"""What is seen of effects beside those of a fit, at the sizes that may do something there.

Each size of each effect has been simulated where nominal parameters alone go.  As far as changes
add up, that tells what it would leave beside other effects, and only the likeliest are simulated
there.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.fitting.fitted_model import FittedModel
from servo_models.diagnosis.fitting.linearisation import Linearisation
from servo_models.diagnosis.search.fits import likeliest, names_of
from servo_models.diagnosis.search.screening import Screened, best_scales, screen
from servo_models.diagnosis.trial_values import Settings

SIZES = 6
"""Sizes at which an effect is seen again beside others."""


def preselect(every: Iterable[Candidate], results: Sequence[Screened]) -> list[Candidate]:
    """Return effects with what ``results``, best first, have shown of their sizes alone.

    Of the thousands of sizes of a staircase, those stay that were promising once.  Others keep all:
    alone, each takes the size that imitates what is missing as well.
    """
    found = []
    for one in every:
        own = [result for result in results if result.candidate.name == one.name]
        first = {_place(one, it.settings): it for it in reversed(own)}
        if one.grid and own:
            sizes = {_place(one, it.settings): it.settings for it in own}
            found.append(replace(one, trial_values=tuple(sizes.values())[:SIZES]))
        elif one.discontinuous or not own:
            found.append(one)
        else:
            none = np.zeros_like(own[0].columns)
            known = (first.get(_place(one, size)) for size in one.trial_values)
            found.append(replace(one, alone=tuple(it.columns if it else none for it in known)))
    return found


def _place(one: Candidate, settings: Settings) -> Hashable:
    """Which of its sizes some settings are: of a ripple they come with another size and phase."""
    return tuple(it for it in settings.items() if it[0] not in (one.ripple or ()))


def seen_beside(first: FittedModel, every: Iterable[Candidate]) -> list[Screened]:
    """Return what is seen of other effects beside those of ``first``, best first."""
    others = [_likely(first.linearised, one) for one in every if one.name not in first.effects]
    return screen((first.linearised,), others)


def _likely(seen: Linearisation, one: Candidate) -> Candidate:
    """An effect at the sizes that would leave least from there if changes add up."""
    if len(one.alone) <= SIZES:
        return one
    left, _ = best_scales(seen, [one] * len(one.alone), one.alone)
    best = np.argsort(left, kind="stable")[:SIZES]
    return replace(one, trial_values=tuple(one.trial_values[i] for i in sorted(best)), alone=())


class Looks:
    """What is seen of effects beside fitted models, at the same sizes only once.

    Of smooth effects the sizes are kept from which a fit may begin: every one holds a response.
    """

    def __init__(self) -> None:
        self._known: dict[Hashable, list[Screened]] = {}

    def beside(self, first: FittedModel, every: Iterable[Candidate]) -> list[Screened]:
        """Return the same as ``seen_beside``."""
        keys = {_key(first, one): one for one in every if one.name not in first.effects}
        new = {one.name: key for key, one in keys.items() if key not in self._known}
        self._known |= {key: [] for key in new.values()}
        found = seen_beside(first, [keys[key] for key in new.values()])
        for name in names_of(found):
            own = [result for result in found if result.candidate.name == name]
            self._known[new[name]] = own if own[0].candidate.discontinuous else likeliest(own)
        known = chain.from_iterable(self._known[key] for key in keys)
        return sorted(known, key=lambda result: result.left)


def _key(first: FittedModel, one: Candidate) -> Hashable:
    """An effect at its sizes, seen from a fit."""
    return first, one.name, tuple(tuple(size.items()) for size in one.trial_values)
