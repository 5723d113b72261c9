"""When an identification is not to be believed: the one rule behind exit code 1 and its reason.

A warning is a sentence.  A ``Doubt`` is one after which the values are not to be used; every way to
identify marks its own so, and here are those that the errors of a fit by simulation give.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from servo_models.core.types import Array
from servo_models.data.audit import audits, noise_floors
from servo_models.data.outliers import off_neighbours
from servo_models.report.numbers import number
from servo_models.report.sections import Report

if TYPE_CHECKING:
    from servo_models.identification.result import Identification

HARDLY = 0.7
"""Error left over the standard deviation of a reading, from which a fit does not follow it."""
FAR_LEFT = 100.0
"""Error left in noise floors, from which values make up for what the model lacks."""
WILD_SHARE = 0.02  # of the readings
WILD_SQUARES = 0.5
"""Share of the squared errors in so few single readings, from which a fit follows these."""
LEAST_LEFT = 2.0
"""Error left in noise floors, below which no single reading moves a fit."""
NAMED = 3


class Doubt(str):
    """A warning after which the values are not to be believed."""

    __slots__ = ()


def doubts(warnings: Iterable[str]) -> tuple[str, ...]:
    """Return those warnings after which the values are not to be believed."""
    return tuple(text for text in warnings if isinstance(text, Doubt))


def judged(report: Report, warnings: Iterable[str]) -> Report:
    """Return the report, whose first sentence says why its values are not to be believed."""
    reasons = doubts(warnings)
    if not reasons:
        return report
    more = f" ({len(reasons) - 1} more below)" if len(reasons) > 1 else ""
    sentence = f"Not to be believed: {reasons[0]}{more}. {report.sentence}"
    return replace(report, sentence=sentence, passed=False)


def about_errors(found: Identification) -> Iterator[Doubt]:
    """Doubts that the errors of the fitted model give, one output after another."""
    floors = noise_floors(audits(found.logs, found.fitted.plant))
    for name in found.sigma:
        left = found.rms(name, "fit")
        values = [log.outputs[name][log.fitted] for log in found.logs if name in log.outputs]
        if left > HARDLY * float(np.std(np.concatenate(values))):
            yield Doubt(
                f"the fitted model explains hardly anything of '{name}', so its values say nothing"
                " of this log: check unit, scale and sign of the column, and that the log is of"
                f" '{found.fitted.actuator.name}'"
            )
        elif left > LEAST_LEFT * floors[name] and (rows := _wild(found, name)):
            yield Doubt(
                f"single readings of '{name}' have most of the squared error, so the fit follows"
                f" them: {rows}; remove these rows, or run 'diagnose' if they are real"
            )
        elif left > FAR_LEFT * floors[name]:
            yield Doubt(
                f"what is left of '{name}' is {number(left / floors[name], 2)} times its noise"
                " floor, so the values make up for something that the model lacks: run 'diagnose',"
                " or identify another actuator"
            )


def _wild(found: Identification, name: str) -> str:
    """The largest of the few single readings with most of the squared error, "" without such."""
    logs, errors, single = [], [], []
    for log, response in zip(found.logs, found.after):
        if name in log.outputs:
            error = (log.outputs[name] - response[name])[log.fitted]
            errors.append(error)
            single.append(off_neighbours(error))
            logs += [f"log '{log.name}' row {row}" for row in log.rows[log.fitted]]
    off: Array = np.abs(np.concatenate(single))
    largest = np.argsort(-off)[: max(1, int(WILD_SHARE * len(off)))]
    share = np.sum(off[largest] ** 2) / np.sum(np.concatenate(errors) ** 2)
    return ", ".join(logs[i] for i in largest[:NAMED]) if share > WILD_SQUARES else ""
