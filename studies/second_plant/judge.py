"""What could have been said of a rig, by an observer who knows what is wrong with it.

The truth is fitted by the product's own fitter, from the true values.  It is *separated* from its
best rival where it leaves at least a tenth less of the squared error on blocks of time that the
fits have not seen, in so many blocks that chance would do so in fewer than 1 of 20 cases.  Rivals
are parameters alone and the four nearest explanations that the diagnosis has tried, by no more
effects than the truth has, each fitted on from where the diagnosis left it.  So one that searches
wider separates fewer.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

from servo_models.core.workers import Workers
from servo_models.data.description import read_description
from servo_models.diagnosis.search.crossval import consistency
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.withheld.oracle import RIVALS, Diagnosed, diagnose_case, fit_from, fitter_of
from studies.second_plant.rigs import NAMES

TENTH, BY_CHANCE = 0.1, 0.05
"""Share of a rival's squared error that the truth has to take away, and chance that it does."""


@dataclass(frozen=True)
class Observed:
    """What an observer can tell; errors are held out, in noise floors.

    Attributes:
        case: its name.
        truth: error that the truth leaves, fitted from the true values, and ``truth_effects``.
        truth_values, truth_bounds: free parameters [SI] of that fit, and which lie on a bound.
        parameters: error of nominal parameters alone.
        rival: error of the best rival, and ``rival_effects``.
        beyond: parameters of effects whose true values are outside the catalogue's bounds.
        told: error of the explanation that was told, fitted on, and ``told_bounds``.
        separated: the truth from its best rival.
    """

    case: str
    truth: float = 0.0
    truth_effects: Sequence[str] = ()
    truth_values: Mapping[str, float] | None = None
    truth_bounds: Sequence[str] = ()
    parameters: float = 0.0
    rival: float = 0.0
    rival_effects: Sequence[str] = ()
    beyond: Sequence[str] = ()
    told: float = 0.0
    told_bounds: Sequence[str] = ()
    separated: bool = False


def sets_of(causes: Iterable[str]) -> list[frozenset[str]]:
    """Return every set of effects that names these causes."""
    return [frozenset().union(*chosen) for chosen in product(*(NAMES[it] for it in causes))]


def judged(task: tuple[Path, dict[str, Any]]) -> dict[str, Any]:
    """Return what is said of a rig and what could have been said, from a folder and an answer."""
    folder, answer = task
    case = folder / "cases" / answer["case"]
    said = diagnose_case(case)
    observed = observe(case, answer, Diagnosed(**said))
    return {"case": answer["case"], "said": said, "observed": asdict(observed)}


def observe(case: Path, answer: Mapping[str, Any], said: Diagnosed) -> Observed:
    """Return what could have been said of the rig in a folder, of which something was said."""
    if not said.floors:
        return Observed(said.case)
    with warnings.catch_warnings(), Workers(1):
        warnings.simplefilter("ignore")
        return _observed(case, answer, said)


def _observed(case: Path, answer: Mapping[str, Any], said: Diagnosed) -> Observed:
    described = read_description(case / "description.toml")
    fitter = fitter_of(described, said)
    true = {**answer["parameters"], **answer["effects"]}
    tried = dict(zip(map(frozenset, said.tried), said.values))
    sets = sets_of(answer["causes"])
    truth = _best(*(_fits(fitter, it, true, tried) for it in sets))
    most = max(len(truth.effects), 1)
    nearest = [it for it in tried if len(it) <= most and it not in sets][:RIVALS]
    rivals = [fit_from(fitter, sorted(it), tried[it]) for it in nearest]
    begins = [true, *(it.values for it in rivals[:2])]
    alone = _best([fitter.fit((), ())], (fit_from(fitter, (), it) for it in begins))
    rival = _best(rivals if rivals and frozenset() in sets else [*rivals, alone])
    told = fit_from(fitter, said.named, tried[frozenset(said.named)]) if said.named else alone
    return Observed(
        case=said.case,
        truth=truth.evidence.rms,
        truth_effects=list(truth.effects),
        truth_values=truth.values,
        truth_bounds=_bounds(truth),
        parameters=alone.evidence.rms,
        rival=rival.evidence.rms,
        rival_effects=list(rival.effects),
        beyond=_beyond(fitter, answer["effects"]),
        told=told.evidence.rms,
        told_bounds=_bounds(told),
        separated=separated(truth, rival),
    )


def _fits(
    fitter: Fitter,
    names: Collection[str],
    true: Mapping[str, float],
    tried: Mapping[frozenset[str], Mapping[str, float]],
) -> Iterable[FittedModel]:
    """Fits of some effects from the true values, and from where the diagnosis left them."""
    yield fit_from(fitter, sorted(names), true)
    if frozenset(names) in tried:
        yield fit_from(fitter, sorted(names), tried[frozenset(names)])


def _best(*found: Iterable[FittedModel]) -> FittedModel:
    """The one that leaves least, held out."""
    return min((one for some in found for one in some), key=lambda one: one.evidence.rms)


def _bounds(fitted: FittedModel) -> list[str]:
    """Parameters that lie on a bound."""
    sides = fitted.problem.sides(fitted.evidence.vector)
    return [f"{free.name} {side}" for free, side in zip(fitted.problem.free, sides) if side]


def _beyond(fitter: Fitter, effects: Mapping[str, float]) -> list[str]:
    """Parameters of effects that are too large for the catalogue, or too small."""
    known = {name: fitter.model.plant.parameters[name].param for name in effects}
    return [
        f"{name} is {value:.3g}, of {known[name].low:.3g} to {known[name].high:.3g}"
        for name, value in effects.items()
        if not known[name].low <= value <= known[name].high
    ]


def separated(truth: FittedModel, rival: FittedModel) -> bool:
    """Return whether the truth leaves clearly less than a rival, see the top of this file."""
    less = truth.evidence.rms**2 < (1.0 - TENTH) * rival.evidence.rms**2
    return less and consistency(truth.evidence, rival.evidence) < BY_CHANCE
