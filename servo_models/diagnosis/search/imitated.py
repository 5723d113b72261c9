"""Effects that re-tuned parameters imitate: one may be there, and the logs would hardly show it.

A look tells of which that may be so; then the effect is put into the model at one of the sizes that
were looked at, and the parameters are fitted beside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.fitting.explanation import Bench, Explanation
from servo_models.diagnosis.fitting.view import View
from servo_models.diagnosis.search.screening import Sight
from servo_models.errors import UserError

Array = NDArray[np.float64]

SHOWN = 3.0
"""Standard deviations of noise by which an effect stands out."""
UNLIKE = 0.3
"""Share of a change that slopes of the parameters leave, above which they do not imitate it."""
SIZES = 5
"""Sizes of an effect, of either sign, that are tried at most."""
BENT, SURELY = 10.0, 0.8
"""How far one may stand out, over what noise does, for a part of it to be tried, and the share of
that part which is: responses are not quite straight."""


@dataclass(frozen=True, eq=False)
class Imitated:
    """An effect that parameters imitate, at the largest size at which they were found to.

    Attributes:
        explanation: with the effect at that size, parameters re-tuned beside it: it leaves as
            little as they do without.
        moved: how far the effect moves the outputs [RMS, noise floors] where the parameters stay.
    """

    explanation: Explanation
    moved: float

    @property
    def name(self) -> str:
        """That of the effect."""
        return self.explanation.effects[0]


def imitated_effects(
    bench: Bench, retuned: Explanation, sights: Iterable[Sight], least: float
) -> list[Imitated]:
    """Return effects that may be there beside re-tuned parameters, the largest first.

    Args:
        bench: without any effect.
        retuned: nominal parameters alone.
        sights: of every effect.
        least: RMS [noise floors] by which an effect has to move the outputs.
    """
    alike: dict[tuple[str, bool], list[Sight]] = {}
    for sight in sights:
        # a ripple is seen as a share of each phase, at no size of its own
        if sight.seen is retuned.view and sight.waves is None:
            positive = all(
                sight.settings.get(name, 0.0) >= 0.0 for name in sight.candidate.switches
            )
            alike.setdefault((sight.candidate.name, positive), []).append(sight)
    largest: dict[str, Imitated] = {}
    for (name, _), own in alike.items():
        one = _imitated(bench, retuned, own, least)
        if one and (name not in largest or one.moved > largest[name].moved):
            largest[name] = one
    return sorted(largest.values(), key=lambda it: -it.moved)


def _imitated(
    bench: Bench, retuned: Explanation, own: Sequence[Sight], least: float
) -> Imitated | None:
    """An effect at the largest of a few sizes that parameters imitate, None for none.

    Each fit begins where the one of the size before has ended, since parameters have to go far.
    """
    noise = SHOWN * float(np.sqrt(retuned.evidence.dispersion))
    best: Imitated | None = None
    for sight in _sizes(own, least):
        start = best.explanation.values if best else retuned.view.start(sight.change)
        found = _beside(bench, sight, 1.0, start)
        shows = _more(found, retuned) / noise
        whole = shows <= 1.0
        if 1.0 < shows < BENT:
            part = SURELY / shows
            found = _beside(bench, sight, part, _between(retuned.values, found.values, part))
            shows = _more(found, retuned) / noise
        moved = _moved(found, retuned)
        if shows <= 1.0 and moved > max(least, best.moved if best else 0.0):
            best = Imitated(found, moved)
        if not whole:
            break
    return best


def _between(one: Mapping[str, float], other: Mapping[str, float], part: float) -> dict[str, float]:
    """Values that are by a part of the way from one towards the other."""
    return {name: value + part * (other[name] - value) for name, value in one.items()}


def _sizes(own: Iterable[Sight], least: float) -> list[Sight]:
    """Sizes of an effect that parameters may imitate, the smallest movement first."""
    sizes = [
        it
        for it in own
        if _rms(it.change, it.seen) > least
        and np.linalg.norm(it.difference) < UNLIKE * np.linalg.norm(it.change)
    ]
    sizes.sort(key=lambda it: float(np.linalg.norm(it.change)))
    chosen = np.linspace(0, len(sizes) - 1, min(SIZES, len(sizes))).round().astype(int)
    return [sizes[i] for i in chosen]


def _beside(bench: Bench, sight: Sight, part: float, start: Mapping[str, float]) -> Explanation:
    """Nominal parameters fitted where an effect, or a part of it, belongs to the model."""
    values = {**bench.model.values, **sight.at(part)}
    other = replace(bench, model=replace(bench.model, values=values))
    if sight.candidate.stairs:
        other = other.surveyed()
    return other.fit((sight.candidate.name,), (), start)


def _more(found: Explanation, retuned: Explanation) -> float:
    """The root of the squared errors that are left more than by parameters alone."""
    return float(np.sqrt(max(found.cost - retuned.cost, 0.0)))


def _moved(found: Explanation, retuned: Explanation) -> float:
    """How far an effect moves the outputs where the parameters stay, 0 where it cannot run."""
    try:
        errors = found.problem.errors_with(retuned.values, strict=True)
    except UserError:
        return 0.0
    return _rms(errors - retuned.view.errors, retuned.view)


def _rms(change: Array, seen: View) -> float:
    return float(np.linalg.norm(change) / np.sqrt(max(seen.problem.samples, 1)))
