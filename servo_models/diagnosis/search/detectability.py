"""How far an effect moves the outputs of logs, and how far beyond what parameters imitate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.search.screening import LARGEST, Screened


@dataclass(frozen=True)
class Detectability:
    """How far an effect moves the outputs at the sizes looked at, RMS in noise floors.

    Attributes:
        moved: at most.
        shown: at most, without what nominal parameters imitate.
    """

    moved: float = 0.0
    shown: float = 0.0


def reaches(sights: Iterable[Screened], every: Sequence[Candidate]) -> dict[str, Detectability]:
    """Return the reach of each effect by its name, from all that was seen of it."""
    found = {one.name: Detectability() for one in every}
    for sight in sights:
        before, own = found[sight.candidate.name], _reach(sight)
        larger = Detectability(max(before.moved, own.moved), max(before.shown, own.shown))
        found[sight.candidate.name] = larger
    return found


def _reach(sight: Screened) -> Detectability:
    """That of one size; of a ripple, that of the phase which does more."""
    moved, shown = sight.change[:, None], sight.difference[:, None]
    if sight.waves is not None:
        moved = LARGEST * sight.waves
        shown = sight.seen.without(moved)
    samples = max(sight.seen.problem.samples, 1)
    return Detectability(
        *(float(np.sqrt((it**2).sum(axis=0).max() / samples)) for it in (moved, shown))
    )
