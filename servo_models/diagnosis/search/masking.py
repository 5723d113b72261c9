"""Effects that re-tuned parameters imitate: one may be there, and the logs would hardly show it.

Screening tells of which that may be so; then the effect is put into the model at the values that
were screened, and at some between them, and the parameters are fitted beside it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import Settings
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.linearisation import Linearisation
from servo_models.diagnosis.search.screening import Screened
from servo_models.errors import UserError

SHOWN_IN_SIGMAS = 3.0
"""Standard deviations, of noise or of the parameters together, by which an effect stands out."""
UNMASKED_SHARE = 0.3
"""Share of a change that slopes of the parameters leave, above which they do not imitate it."""
HALVINGS = 2
"""Of the way between a size that does not show and the next one, which does."""
SHAPES_TRIED = 2
"""Shapes and signs of an effect, those first that may move most."""
MASKED_FIT_STEPS = 8
"""Of a fit: what parameters imitate they find at once."""


@dataclass(frozen=True, eq=False)
class MaskedEffect:
    """An effect that parameters imitate, at the largest size at which they were found to.

    Attributes:
        fitted_model: with the effect at that size, parameters re-tuned beside it: it leaves as
            little as they do without.
        moved: how far the effect moves the outputs [RMS, noise floors] where the parameters stay.
    """

    fitted_model: FittedModel
    moved: float

    @property
    def name(self) -> str:
        """That of the effect."""
        return self.fitted_model.effects[0]


def masked_effects(
    fitter: Fitter, retuned: FittedModel, results: Iterable[Screened], least: float
) -> list[MaskedEffect]:
    """Return effects that may be there beside re-tuned parameters, the largest first.

    Args:
        fitter: without any effect.
        retuned: nominal parameters alone.
        results: of screening every effect.
        least: RMS [noise floors] by which an effect has to move the outputs.
    """
    alike: dict[tuple[object, ...], list[Screened]] = {}
    for result in results:
        # a ripple is screened as a share of each phase, at no size of its own
        if result.linearised is retuned.linearised and result.waves is None:
            alike.setdefault(_kind(result), []).append(result)
    largest: dict[str, MaskedEffect] = {}
    tried: Counter[str] = Counter()
    for own in sorted(alike.values(), key=lambda it: -_promised(it)):
        name = own[0].candidate.name
        wanted = max(least, largest[name].moved) if name in largest else least
        if _promised(own) > wanted and tried[name] < SHAPES_TRIED:
            tried[name] += 1
            one = _Walk(fitter, retuned, own).largest()
            if one and one.moved > wanted:
                largest[name] = one
    return sorted(largest.values(), key=lambda it: -it.moved)


def _kind(result: Screened) -> tuple[object, ...]:
    """What sizes have in common that differ by how large they are: effect, sign and shape."""
    switches = result.candidate.switches
    shape = tuple(it for it in result.settings.items() if it[0] not in switches)
    signs = tuple(
        (name, result.settings[name] < 0.0) for name in switches if name in result.settings
    )
    return result.candidate.name, signs, shape


def _promised(own: Iterable[Screened]) -> float:
    """How far an effect moves the outputs at sizes that parameters may imitate."""
    return max((_rms(it.change, it.linearised) for it in own if _alike(it)), default=0.0)


def _alike(result: Screened) -> bool:
    """Whether slopes of the parameters lead to most of a change."""
    return bool(np.linalg.norm(result.difference) < UNMASKED_SHARE * np.linalg.norm(result.change))


class _Walk:
    """Through the sizes of an effect of one sign and shape, to the largest that does not show."""

    def __init__(self, fitter: Fitter, retuned: FittedModel, own: Sequence[Screened]) -> None:
        self.fitter, self.retuned = fitter, retuned
        self.candidate = own[0].candidate
        self.sizes = sorted(own, key=lambda it: float(np.linalg.norm(it.change)))
        self.best: MaskedEffect | None = None

    def largest(self) -> MaskedEffect | None:
        """Return the effect at the largest size that does not show, None for none."""
        low, high = -1, len(self.sizes)
        middle = max(i for i in range(high) if _alike(self.sizes[i]))
        while high - low > 1:
            if self._passes(self.sizes[middle]):
                low = middle
            else:
                high = middle
            middle = (low + high) // 2
        if high < len(self.sizes) and (self.best or _alike(self.sizes[high])):
            self._closer(self._at(low), self.sizes[high].settings)
        return self.best

    def _at(self, index: int) -> Settings:
        """Settings of a size; before the first one, of none, as long as larger ones do more."""
        if index >= 0:
            return self.sizes[index].settings
        off = dict.fromkeys(self.candidate.switches, 0.0)
        return {name: off.get(name, value) for name, value in self.sizes[0].settings.items()}

    def _closer(self, low: Settings, high: Settings) -> None:
        for _ in range(HALVINGS):
            middle = {name: 0.5 * (low[name] + high[name]) for name in low}
            start = self.best.fitted_model.values if self.best else self.retuned.values
            if self._tried(middle, start):
                low = middle
            else:
                high = middle

    def _passes(self, result: Screened) -> bool:
        """Whether parameters imitate an effect at a value that was screened."""
        if not result.change.any():
            return True
        return _alike(result) and self._tried(
            result.settings, result.linearised.start(result.change)
        )

    def _tried(self, settings: Settings, start: Mapping[str, float]) -> bool:
        """Whether they do so at some settings; keeps the largest that they do imitate."""
        model = self.fitter.model
        other = replace(self.fitter, model=replace(model, values={**model.values, **settings}))
        if self.candidate.discontinuous:
            other = other.surveyed()
        found = other.fit((self.candidate.name,), (), start, limit=MASKED_FIT_STEPS)
        if _stands_out(found, self.retuned):
            return False
        moved = _moved(found, self.retuned)
        if self.best is None or moved > self.best.moved:
            self.best = MaskedEffect(found, moved)
        return True


def _stands_out(found: FittedModel, retuned: FittedModel) -> bool:
    """Whether an effect leaves more of the data than noise would make of what parameters alone
    leave, or strains these further than their priors allow."""
    n = retuned.problem.samples
    more = [
        float(it @ it) - float(was @ was)
        for it, was in zip(
            np.split(found.linearised.errors, [n]), np.split(retuned.linearised.errors, [n])
        )
    ]
    return (
        more[0] > SHOWN_IN_SIGMAS**2 * retuned.evidence.dispersion or more[1] > SHOWN_IN_SIGMAS**2
    )


def _moved(found: FittedModel, retuned: FittedModel) -> float:
    """How far an effect moves the outputs where the parameters stay, 0 where it cannot run."""
    try:
        errors = found.problem.errors_with(retuned.values, strict=True)
    except UserError:
        return 0.0
    return _rms(errors - retuned.linearised.errors, retuned.linearised)


def _rms(change: Array, linear: Linearisation) -> float:
    return float(np.linalg.norm(change) / np.sqrt(max(linear.problem.samples, 1)))
