"""The result of a validation: rows under claims."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from servo_models.report.document import Document
from servo_models.report.result import Result
from servo_models.validation.any_fmu.comparison import Compared

IMPLEMENTATION = "implementation"  # claim: the FMU equals the simulation in this process
MODEL = "model"  # claim: the response equals an independent reference
PAPER = "paper"
"""Claim: the model gives the figures printed in its paper, or else those recomputed from the
paper's own numbers.  What these numbers do not give is named, with the reason."""

REFERENCE = "reference"  # claim: the outputs of an FMU equal a reference that came with it
FILES = "files"  # claim: the files of an FMU are as FMI has them; nothing was run

OWN_CLAIMS = (IMPLEMENTATION, MODEL, PAPER)  # claims about our own models
CLAIMS = (*OWN_CLAIMS, REFERENCE, FILES)


@dataclass(frozen=True)
class Row:
    """One measured figure.

    Attributes:
        claim: one of ``CLAIMS``.
        actuator, variant: what was run.
        case: how it was run.
        quantity: what was measured.
        value: the measured figure, None where there is none.
        limit: largest value (claims implementation and model) or largest distance from
            ``printed`` (claim paper) that passes; None where nothing is judged.
        unit: of value, limit, printed and recomputed; "1" for a pure number.
        passed: the judgement; None where nothing is judged.
        note: reason or reference in words.
        printed: figure in the paper, for the claim paper.
        recomputed: that figure from the paper's own numbers, without this model.
        subject: name of the FMU that was run, "" for the simulation in this process.
        seconds: its share of the time that the run of all figures of its case took.
    """

    claim: str
    actuator: str
    variant: str
    case: str
    quantity: str
    value: float | None
    limit: float | None
    unit: str
    passed: bool | None
    note: str = ""
    printed: float | None = None
    recomputed: float | None = None
    subject: str = ""
    seconds: float = field(default=0.0, compare=False)

    @property
    def verdict(self) -> str:
        """The judgement in words."""
        if self.passed is None:
            return "not reproducible" if self.claim == PAPER else "for information"
        return "passed" if self.passed else "failed"


def judged(
    claim: str,
    where: tuple[str, str, str],
    quantity: str,
    value: float | None,
    limit: float | None = None,
    unit: str = "1",
    note: str = "",
    subject: str = "",
) -> Row:
    """Make a row that passes while ``value`` is at most ``limit``; no limit, no judgement.

    ``where`` is actuator, variant and case.  A value of None fails a limit.
    """
    passed = None if limit is None else value is not None and bool(value <= limit)
    return Row(claim, *where, quantity, value, limit, unit, passed, note, subject=subject)


def failure(claim: str, where: tuple[str, str, str], reason: str, subject: str = "") -> Row:
    """Make the row of something that could not be measured, with the reason."""
    return judged(claim, where, "failures of the run", 1.0, 0.0, "1", reason, subject)


def figure(
    where: tuple[str, str, str],
    quantity: str,
    got: float | None,
    within: float,
    unit: str = "1",
    *,
    printed: float | None = None,
    recomputed: float | None = None,
    note: str = "",
) -> Row:
    """Make a row that passes while ``got`` is within ``within`` of the printed figure.

    ``where`` is actuator, variant and case.
    """
    target = recomputed if printed is None else printed
    passed = got is not None and target is not None and bool(abs(got - target) <= within)
    return Row(PAPER, *where, quantity, got, within, unit, passed, note, printed, recomputed)


def not_reproducible(
    where: tuple[str, str, str],
    quantity: str,
    got: float | None,
    unit: str,
    *,
    printed: float,
    recomputed: float,
    note: str,
) -> Row:
    """Name a printed figure that its own paper contradicts, and why."""
    return Row(PAPER, *where, quantity, got, None, unit, None, note, printed, recomputed)


def tightest(rows: Iterable[Row]) -> Row:
    """Return the worst row: one that failed, else the one nearest to its limit."""

    def tightness(row: Row) -> tuple[bool, float]:
        used = row.value / row.limit if row.value is not None and row.limit else 0.0
        return row.passed is False, used

    return max(rows, key=tightness)


class CostPoint(Document, frozen=True):
    """Accuracy and price of one internal step.

    Attributes:
        internal_step: [s].
        error: largest error over full scale of each output, by output.
        seconds: compiled simulation time per second simulated [s/s].
    """

    internal_step: float
    error: dict[str, float]
    seconds: float


class CostCurve(Document, frozen=True):
    """Error against internal step for one case; ``default_step`` [s] is the model's own."""

    actuator: str
    variant: str
    case: str
    default_step: float
    points: tuple[CostPoint, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Validation(Result):
    """The result of a validation.

    Attributes:
        rows: all figures, in the order in which they were measured.
        cost: error against internal step.
        conditions: versions of what it ran on, by name.
        compared: outputs beside references that came with the question.
    """

    rows: tuple[Row, ...]
    cost: tuple[CostCurve, ...] = ()
    conditions: dict[str, str] = field(default_factory=dict)
    compared: tuple[Compared, ...] = ()

    @property
    def claims(self) -> tuple[str, ...]:
        """The claims that were examined; for our own models always all."""
        used = {row.claim for row in self.rows}
        always = OWN_CLAIMS if used & {*OWN_CLAIMS} or not used else ()
        return tuple(claim for claim in CLAIMS if claim in used or claim in always)

    @property
    def passed(self) -> bool:
        """Whether no judged row failed; a figure named as not reproducible does not fail."""
        return not self.failures

    @property
    def failures(self) -> tuple[Row, ...]:
        """The rows that failed."""
        return tuple(row for row in self.rows if row.passed is False)

    def of(self, claim: str) -> tuple[Row, ...]:
        """Return the rows of a claim."""
        return tuple(row for row in self.rows if row.claim == claim)
