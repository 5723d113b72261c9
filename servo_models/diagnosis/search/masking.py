"""Effects that re-tuned parameters imitate: one may be there, and the logs would hardly show it.

Screening tells of which that may be so; then the effect is put into the model at the values that
were screened, and at some between them, and the parameters are fitted beside it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import Candidate, Values
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.screening import Screened
from servo_models.errors import UserError
from servo_models.identification.linear_inference import Linearisation, information

HALVINGS = 2  # bisection steps from a masked size to the next one, which is detectable
UNMASKED_SHARE = 0.3  # share of a change left by slopes, above which parameters do not imitate it
SHAPES_TRIED = 2  # shapes and signs of an effect, those first that may move most
MASKED_FIT_STEPS = 8  # least-squares steps of a fit: what parameters imitate they find at once


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
    """Return effects that may be there beside re-tuned parameters, of those that move the outputs
    by ``least`` [RMS, noise floors], the largest first."""
    linear, shown = retuned.linearised, fitter.settings.shown_deviations
    allowed = shown**2 * retuned.evidence.dispersion
    if fitter.rough:  # short slopes are up to half roughness, and a dent is left by any re-tuning
        told = information(retuned.problem, linear.vector)
        linear = replace(linear, slopes=told.slopes)
        allowed += shown * float(np.sqrt(2.0 * np.sum(told.jitter**2)))
    alike: dict[tuple[object, ...], list[Screened]] = {}
    for result in results:
        # a ripple is screened as a share of each phase, at no size of its own; codes and clocks
        # show in the data, whatever parameters do
        smooth = result.waves is None and not result.candidate.discontinuous
        if result.linearised is retuned.linearised and smooth:
            beside = replace(result, linearised=linear, difference=linear.without(result.change))
            alike.setdefault(_kind(result), []).append(beside)
    largest: dict[str, MaskedEffect] = {}
    tried: Counter[str] = Counter()
    for sizes in sorted(alike.values(), key=lambda group: -_promised(group)):
        name = sizes[0].candidate.name
        wanted = max(least, largest[name].moved) if name in largest else least
        if _promised(sizes) > wanted and tried[name] < SHAPES_TRIED:
            tried[name] += 1
            masked = _largest(fitter, retuned, sizes, allowed)
            if masked and masked.moved > wanted:
                largest[name] = masked
    return sorted(largest.values(), key=lambda masked: -masked.moved)


def _kind(result: Screened) -> tuple[object, ...]:
    """What sizes have in common that differ by how large they are: effect, sign and shape."""
    switches = result.candidate.switches
    shape = tuple(it for it in result.settings.items() if it[0] not in switches)
    signs = tuple(
        (name, result.settings[name] < 0.0) for name in switches if name in result.settings
    )
    return result.candidate.name, signs, shape


def _promised(sizes: Iterable[Screened]) -> float:
    """How far an effect moves the outputs at sizes that parameters may imitate."""
    return max((_rms(it.change, it.linearised) for it in sizes if _alike(it)), default=0.0)


def _alike(result: Screened) -> bool:
    """Whether slopes of the parameters lead to most of a change."""
    return bool(np.linalg.norm(result.difference) < UNMASKED_SHARE * np.linalg.norm(result.change))


def _largest(
    fitter: Fitter, retuned: FittedModel, sizes: Iterable[Screened], allowed: float
) -> MaskedEffect | None:
    """The effect of one sign and shape at the largest of its sizes that does not show: the largest
    one, else by bisection, and then nearer to the next one, which does."""
    imitated = sorted(filter(_alike, sizes), key=lambda it: float(np.linalg.norm(it.change)))
    largest, hidden, shown = None, -1, len(imitated)
    middle = shown - 1
    while hidden < middle < shown:
        result = imitated[middle]
        start = result.linearised.start(result.change)
        masked = _masked(fitter, retuned, result.candidate, result.settings, start, allowed)
        if masked:
            largest, hidden = masked, middle
        else:
            shown = middle
        middle = (hidden + shown) // 2
    if shown == len(imitated):
        return largest
    candidate, high = imitated[shown].candidate, imitated[shown].settings
    low = imitated[hidden].settings if hidden >= 0 else dict.fromkeys(candidate.switches, 0.0)
    for _ in range(HALVINGS):
        between = {name: 0.5 * (low.get(name, value) + value) for name, value in high.items()}
        start = largest.fitted_model.values if largest else retuned.values
        masked = _masked(fitter, retuned, candidate, between, start, allowed)
        if masked:
            low, largest = between, masked
        else:
            high = between
    return largest


def _masked(
    fitter: Fitter,
    retuned: FittedModel,
    candidate: Candidate,
    settings: Values,
    start: Values,
    allowed: float,
) -> MaskedEffect | None:
    """An effect at some settings with parameters re-tuned beside it, None where it shows."""
    on = replace(fitter.model, values={**fitter.model.values, **settings})
    slopes, other = retuned.linearised.slopes, replace(fitter, model=on)
    fitted = other.fit((candidate.name,), (), start, slopes, limit=MASKED_FIT_STEPS)
    if _stands_out(fitted, retuned, allowed):
        return None
    return MaskedEffect(fitted, _moved(fitted, retuned))


def _stands_out(model: FittedModel, retuned: FittedModel, allowed: float) -> bool:
    """Whether an effect leaves more squared errors of the data than ``allowed`` beyond what
    parameters alone leave, or strains these further than their priors allow."""
    (now, priors), (was, priors_were) = (
        np.split(it.linearised.errors, [retuned.problem.samples]) for it in (model, retuned)
    )
    more, strain = now @ now - was @ was, priors @ priors - priors_were @ priors_were
    return bool(more > allowed or strain > model.settings.shown_deviations**2)


def _moved(model: FittedModel, retuned: FittedModel) -> float:
    """How far an effect moves the outputs where the parameters stay, 0 where it cannot run."""
    try:
        errors = model.problem.errors_with(retuned.values, strict=True)
    except UserError:
        return 0.0
    return _rms(errors - retuned.linearised.errors, retuned.linearised)


def _rms(change: Array, linear: Linearisation) -> float:
    return float(np.linalg.norm(change) / np.sqrt(max(linear.problem.samples, 1)))
