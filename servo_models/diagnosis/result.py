"""What a diagnosis found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from servo_models.core.simulate import Model
from servo_models.data.audit import Audit
from servo_models.data.log import Log
from servo_models.diagnosis.claims import Claim, Value, estimates
from servo_models.diagnosis.fitting.explanation import Explanation
from servo_models.diagnosis.gap import Gap, Reduction
from servo_models.diagnosis.search.causes import Causes
from servo_models.diagnosis.search.imitated import Imitated
from servo_models.diagnosis.unseen import Unseen, unseen
from servo_models.diagnosis.verdict import NO_GAP, PARAMETERS, Verdict

EXPLAINED = 0.5
"""Share of what can be closed from which parameters explain a gap."""
MUCH = 0.5
"""Size of an effect that they imitate, over the gap, from which it is worth an experiment."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What a diagnosis found.

    Attributes:
        model: as it was given.
        logs: as they were measured.
        audits: one a log.
        floors: noise floor [SI] by output.
        causes: everything that was tried.
        verdict: what is said.
        gap: before, re-tuned and after, in noise floors.
        gaps: the same by output, in SI.
        claims: effects, most likely first.
        moved: nominal parameters after re-tuning.
        tolerance: gap [noise floors] that counts as none.
        flags: outputs of the logs that say yes or no, which are not judged.
        unconfirmed: what is amiss with the FMU of the diagnosed model, "" for nothing.
    """

    model: Model
    logs: tuple[Log, ...]
    audits: tuple[Audit, ...]
    floors: dict[str, float]
    causes: Causes
    verdict: Verdict
    gap: Reduction
    gaps: tuple[Gap, ...]
    claims: tuple[Claim, ...]
    moved: tuple[Value, ...]
    tolerance: float
    flags: tuple[str, ...] = ()
    unconfirmed: str = ""

    @property
    def within_tolerance(self) -> bool:
        return self.verdict.kind == NO_GAP

    @cached_property
    def fitted(self) -> Model:
        """The model with nominal parameters re-tuned and the diagnosed effects switched on."""
        return replace(self.model, values={**self.model.values, **self.causes.taken.values})

    @cached_property
    def found(self) -> tuple[Value, ...]:
        """Every parameter that is other in ``fitted``, nominal ones first."""
        return estimates(self.causes.taken)

    @property
    def explained(self) -> bool:
        """Whether re-tuned parameters explain the gap: else, without an effect, it is noise."""
        share = self.gap.closed
        alone = self.verdict.kind == PARAMETERS and bool(self.moved)
        return alone and share is not None and share[0] >= EXPLAINED

    @property
    def imitated(self) -> tuple[Imitated, ...]:
        """Effects that may be there beside re-tuned parameters that explain the gap, and would not
        show, the largest first."""
        return tuple(self.causes.imitated) if self.explained else ()

    @property
    def undecided(self) -> tuple[Explanation, ...]:
        """Explanations that these logs cannot tell apart, and another experiment may."""
        least = MUCH * self.gap.rms["before"]
        large = [it.explanation for it in self.imitated if it.moved >= least]
        return (self.causes.retuned, *large) if large else self.verdict.rivals

    @cached_property
    def held_out(self) -> tuple[Unseen, ...]:
        """What the model leaves of samples that the description holds out, by log."""
        return unseen(self.causes)
