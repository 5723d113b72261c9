"""What a fit by simulation error found: estimates, accuracy before and after, warnings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from servo_models.analysis.statistics import rms
from servo_models.core.simulate import Model
from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.linear_inference import Profile, Spread
from servo_models.identification.optimise import Optimum
from servo_models.identification.problem import Free, Problem
from servo_models.report.document import Document, Unbounded, choice
from servo_models.report.result import Result

FIT = "fit"
HELD_OUT = "held out"


class Doubt(str):
    """A warning after which the values are doubtful."""

    __slots__ = ()


def doubts(warnings: Iterable[str]) -> tuple[str, ...]:
    """Return those warnings after which the values are doubtful."""
    return tuple(text for text in warnings if isinstance(text, Doubt))


class Accuracy(Document, frozen=True):
    """Error of one output in one part of one log.

    Attributes:
        log, output: names.
        part: ``"fit"`` or ``"held out"``.
        samples: how many.
        before, after: RMS error [SI] of the nominal and of the fitted model.
        fit: 100 % (1 - |error| / |measured - its mean|), after.
        column_scale: SI per number in the file; RMS / it is the error in the file's numbers.
    """

    log: str
    output: str
    part: Annotated[str, choice(FIT, HELD_OUT)]
    samples: int
    before: Unbounded
    after: Unbounded
    fit: Unbounded
    column_scale: float


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """What a fit by simulation found; vectors in the order of ``free``.

    Attributes:
        nominal, fitted: models before and after.
        logs: as used.
        free: the estimated parameters.
        values, standard_errors: [SI], shape (p,); a standard error on a bound is NaN.
        correlations: shape (p, p).
        condition: of the slopes; see ``linear_inference.Spread``.
        groups: names of parameters that the logs show only together.
        profiles: the squared errors along single parameters.
        sigma: weight of each output [SI]: its RMS error after the fit.
        accuracy: rows of errors before and after.
        before, after: simulated outputs by log, SI by name.
        method: in words.
        warnings: in words, each with its cure.
        converged, interrupted: how the search ended.
        costs: where every start ended, best first.
        evaluations: simulations of all logs.
    """

    nominal: Model
    fitted: Model
    logs: Sequence[Log]
    free: Sequence[Free]
    values: Array
    standard_errors: Array
    correlations: Array
    condition: float
    groups: tuple[tuple[str, ...], ...]
    profiles: tuple[Profile, ...]
    sigma: dict[str, float]
    accuracy: Sequence[Accuracy]
    before: Sequence[dict[str, Array]]
    after: Sequence[dict[str, Array]]
    method: str
    warnings: Sequence[str]
    converged: bool
    interrupted: bool
    costs: Sequence[float]
    evaluations: int

    @property
    def believable(self) -> bool:
        """Whether no warning says that the values are doubtful."""
        return not doubts(self.warnings)

    def judged_part(self, output: str) -> str:
        """Return the part that judges an output: held out, if any of it was."""
        parts = {row.part for row in self.accuracy if row.output == output}
        return HELD_OUT if HELD_OUT in parts else FIT

    def rms(self, output: str, part: str, stage: str = "after") -> float:
        """Return the RMS error [SI] of an output over all logs of a part.

        ``stage`` is ``"before"`` or ``"after"`` the fit.
        """
        return overall(self.accuracy, output, part, stage)


def overall(rows: Sequence[Accuracy], output: str, part: str, stage: str) -> float:
    """Return the RMS error [SI] of an output over the rows of a part; NaN without any."""
    kept = [a for a in rows if (a.output, a.part) == (output, part)]
    count = sum(row.samples for row in kept)
    squares = sum(row.samples * getattr(row, stage) ** 2 for row in kept)
    return float(np.sqrt(squares / count)) if count else float("nan")


def accuracy(
    logs: Sequence[Log], before: Sequence[dict[str, Array]], after: Sequence[dict[str, Array]]
) -> list[Accuracy]:
    """Return the errors of every output in every part of every log."""
    rows: list[Accuracy] = []
    for log, old, new in zip(logs, before, after):
        for output, measured in log.outputs.items():
            for part, mask in ((FIT, log.fitted), (HELD_OUT, log.checked)):
                if mask.any():
                    rows.append(_row(log, output, part, mask, measured, old[output], new[output]))
    return rows


def _row(
    log: Log, output: str, part: str, mask: Mask, measured: Array, old: Array, new: Array
) -> Accuracy:
    spread = float(np.std(measured[mask]))
    after = _rms((new - measured)[mask])
    return Accuracy(
        log=log.name,
        output=output,
        part=part,
        samples=int(mask.sum()),
        before=_rms((old - measured)[mask]),
        after=after,
        fit=100.0 * (1.0 - after / spread) if spread > 0.0 else float("nan"),
        column_scale=abs(log.channels[output].scale),
    )


def _rms(error: Array) -> float:
    with np.errstate(over="ignore"):  # an infinite one is refused with its log and output
        return rms(error)


def conclude(
    problem: Problem,
    optimum: Optimum,
    spread: Spread,
    fitted: Model,
    before: Sequence[dict[str, Array]],
    method: str,
    warnings: Sequence[str],
) -> Identification:
    """Put together what a search and its uncertainty have found.

    Raises:
        UserError: the fitted model leaves the finite numbers, or its RMS error does.
    """
    after = problem.responses(optimum.vector)
    rows = accuracy(problem.logs, before, after)
    for row in rows:
        if not np.isfinite(row.after):
            raise UserError(
                f"log '{row.log}', {row.part}: the RMS error of '{row.output}' is {row.after} after"
                " the fit, so the fitted model runs away there: free fewer parameters, give"
                " them bounds or priors, or correct the column"
            )
    return Identification(
        nominal=problem.model,
        fitted=fitted,
        logs=problem.logs,
        free=problem.free,
        values=np.array(list(problem.values(optimum.vector).values())),
        standard_errors=spread.standard_errors,
        correlations=spread.correlations,
        condition=spread.condition,
        groups=tuple(tuple(problem.free[i].name for i in it) for it in spread.groups),
        profiles=spread.profiles,
        sigma=dict(problem.sigma),
        accuracy=rows,
        before=before,
        after=after,
        method=method,
        warnings=warnings,
        converged=optimum.converged,
        interrupted=optimum.interrupted,
        costs=optimum.costs,
        evaluations=problem.memory.evaluations,
    )
