"""What the JSON of a check and of an identification holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, ClassVar

from servo_models.data.log import Log
from servo_models.data.parameters import ParametersDocument
from servo_models.identification.check import Check, verdict
from servo_models.identification.identify import Outcome
from servo_models.identification.resolution import WHY
from servo_models.identification.result import Accuracy, Identification
from servo_models.report.document import Document, Figure, about, choice
from servo_models.report.result import document_of

Notes = Annotated[
    Mapping[str, Sequence[str]], about("What reading has changed of each file, by log.")
]
Together = Annotated[Sequence[Sequence[str]], about("Parameters that the logs show only together.")]


class IdentificationDocument(Document, frozen=True):
    """A fit by simulation [SI]; lists of parameters are in the order of ``free``."""

    title: ClassVar[str] = "servo-models identify: a fit by simulation"

    method: str
    free: Sequence[str]
    values: list[float]
    standard_errors: Annotated[list[Figure], about("null on a bound.")]
    correlations: list[list[Figure]]
    condition: Annotated[Figure, about("Of the slopes.")]
    only_together: Together
    accuracy: Sequence[Accuracy]
    warnings: list[str]
    notes: Notes
    costs: Annotated[list[Figure], about("Where every start ended, best first.")]
    evaluations: Annotated[int, about("Simulations of all logs.")]


class OutcomeDocument(Document, frozen=True):
    """The parameters, and what the method found beside."""

    title: ClassVar[str] = "servo-models identify"

    converged: bool
    believable: bool
    doubts: Annotated[Sequence[str], about("Why the values are doubtful.")]
    parameter_set: ParametersDocument | None
    result: Annotated[dict[str, Any], about("By the method.")]


class ParameterReach(Document, frozen=True):
    value: float
    standard_error_alone: Annotated[Figure, about("To expect if nothing else were free.")]
    standard_error_together: Figure
    verdict: str


class EffectReach(Document, frozen=True):
    sizes: dict[str, float]
    output: Annotated[str, about("That it moves most.")]
    moves_noise_floors: Figure
    shown: bool


class Resolution(Document, frozen=True):
    """What the resolution of a column alone does to the outputs: it is written in steps [SI], a
    change is logged at the next row, or rows are stamped late [s]."""

    log: str
    input: str
    why: Annotated[str, choice(*WHY)]
    size: float
    moves_noise_floors: dict[str, Figure]


class CheckDocument(Document, frozen=True):
    """What the logs determine [SI]."""

    title: ClassVar[str] = "servo-models check"

    actuator: str
    variant: str
    warnings: Sequence[str]
    notes: Notes
    noise_floors: dict[str, float]
    parameters: dict[str, ParameterReach]
    effects: dict[str, EffectReach]
    ambiguity_groups: Annotated[list[Sequence[str]], about("Causes that look alike.")]
    resolution: list[Resolution]


def identification_document(fit: Identification) -> IdentificationDocument:
    """Return a fit as what JSON is made of."""
    return IdentificationDocument.made_from(
        fit,
        free=[free.name for free in fit.free],
        only_together=fit.groups,
        notes=_notes(fit.logs),
    )


def outcome_document(outcome: Outcome) -> OutcomeDocument:
    """Return the parameters and what the method found beside."""
    parameters = outcome.parameters and outcome.parameters.document()
    return OutcomeDocument.made_from(
        outcome, parameter_set=parameters, result=document_of(outcome.result)
    )


def check_document(check: Check) -> CheckDocument:
    """Return what the logs determine."""
    described, seen = check.description, check.identifiability
    parameters = {
        reach.name: ParameterReach(
            reach.sizes[reach.name],
            reach.alone * reach.scale,
            reach.together * reach.scale,
            verdict(reach, reach.name in described.uncertainty),
        )
        for reach in seen.parameters
    }
    effects = {
        reach.name: EffectReach.made_from(reach, moves_noise_floors=reach.moves)
        for reach in seen.effects
    }
    resolution = [
        Resolution.made_from(blur, input=blur.column, moves_noise_floors=blur.moves)
        for blur in check.blurs
    ]
    return CheckDocument.made_from(
        described,
        actuator=described.actuator.name,
        warnings=check.warnings,
        notes=_notes(described.logs),
        noise_floors=check.floors,
        parameters=parameters,
        effects=effects,
        ambiguity_groups=[group.names for group in seen.groups],
        resolution=resolution,
    )


def _notes(logs: Iterable[Log]) -> dict[str, tuple[str, ...]]:
    return {log.name: log.notes for log in logs if log.notes}
