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


def reaches(results: Iterable[Screened], every: Sequence[Candidate]) -> dict[str, Detectability]:
    """Return the reach of each effect by its name, from all that was seen of it."""
    found = {one.name: Detectability() for one in every}
    for result in results:
        before, own = found[result.candidate.name], _reach(result)
        larger = Detectability(max(before.moved, own.moved), max(before.shown, own.shown))
        found[result.candidate.name] = larger
    return found


def _reach(result: Screened) -> Detectability:
    """That of one size; of a ripple, that of the phase which does more."""
    moved, shown = result.change[:, None], result.difference[:, None]
    if result.waves is not None:
        moved = LARGEST * result.waves
        shown = result.seen.without(moved)
    samples = max(result.seen.problem.samples, 1)
    return Detectability(
        *(float(np.sqrt((it**2).sum(axis=0).max() / samples)) for it in (moved, shown))
    )
