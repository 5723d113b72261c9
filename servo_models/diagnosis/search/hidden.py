"""Effects that re-tuned parameters imitate: one may be there, and the logs would hardly show it.

A look tells at which sizes that may be so, as if responses were straight; then the effect is put
into the model at such a size, and the parameters are fitted beside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
SURELY = 0.8
"""Share of that, at which a part of a size is tried: responses are not quite straight."""
BENT = 10.0
"""Times that, which an effect may stand out by, for a part of it to be tried."""
SIZES = 4
"""Sizes looked at of which each is tried whole, beside a part of a larger one."""

Size = tuple[float, Sight, float]
"""How far an effect moves the outputs [RMS, noise floors], as seen, and by which part of that."""


@dataclass(frozen=True, eq=False)
class Hidden:
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


def hidden_effects(
    bench: Bench, retuned: Explanation, sights: Iterable[Sight], least: float
) -> list[Hidden]:
    """Return effects that may be there beside re-tuned parameters, the largest first.

    Args:
        bench: without any effect.
        retuned: nominal parameters alone.
        sights: of every effect.
        least: RMS [noise floors] by which an effect has to move the outputs.
    """
    by_effect: dict[str, list[Sight]] = {}
    for sight in sights:
        # a ripple is seen as a share of each phase, at no size of its own
        if sight.seen is retuned.view and sight.waves is None:
            by_effect.setdefault(sight.candidate.name, []).append(sight)
    found = (_hidden(bench, retuned, own, least) for own in by_effect.values())
    return sorted((it for it in found if it), key=lambda it: -it.moved)


def _hidden(
    bench: Bench, retuned: Explanation, own: Sequence[Sight], least: float
) -> Hidden | None:
    """An effect at the largest of a few sizes that parameters imitate, None for none."""
    noise = SHOWN * float(np.sqrt(retuned.evidence.dispersion))
    for promised, sight, part in _sizes(own, noise):
        if promised <= least:
            return None
        found = _beside(bench, retuned, sight, part)
        shows = _more(found, retuned) / noise
        if 1.0 < shows < BENT:
            found = _beside(bench, retuned, sight, part * SURELY / shows)
            shows = _more(found, retuned) / noise
        if shows <= 1.0 and (moved := _moved(found, retuned)) > least:
            return Hidden(found, moved)
    return None


def _sizes(own: Iterable[Sight], noise: float) -> list[Size]:
    """Sizes of an effect that promise to show by less than ``noise``, largest movement first."""
    whole: list[Size] = []
    parts: list[Size] = []
    for sight in own:
        shown, moved = float(np.linalg.norm(sight.difference)), _rms(sight.change, sight.seen)
        if shown <= noise:
            whole.append((moved, sight, 1.0))
        else:
            part = SURELY * noise / shown
            parts.append((part * moved, sight, part))
    return _largest([*_largest(whole, SIZES), *_largest(parts, 1)], SIZES + 1)


def _largest(sizes: Iterable[Size], count: int) -> list[Size]:
    return sorted(sizes, key=lambda size: -size[0])[:count]


def _beside(bench: Bench, retuned: Explanation, sight: Sight, part: float) -> Explanation:
    """Nominal parameters fitted where a part of an effect belongs to the model."""
    values = {**bench.model.values, **sight.at(part)}
    other = replace(bench, model=replace(bench.model, values=values))
    if sight.candidate.stairs:
        other = other.surveyed()
    start = retuned.view.start(part * sight.change)
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
