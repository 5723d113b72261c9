"""Whether a fitted model carries over to a condition under which its fit has seen nothing.

Logs with other constants, such as a gain, were taken under another condition.  What merely
imitates the cause fits each of them with a size in between, and predicts one that was left
out worse than fewer effects do.
Source: Roberts et al., Ecography 40 (2017) 913 (blocks as the structure of the data has them).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from servo_models.data.log import Log
from servo_models.diagnosis.fitting.fitted_model import FittedModel, Fitter

LEAST = 3
"""Conditions from which one can be spared."""


def conditions(logs: Sequence[Log]) -> list[list[Log]]:
    """Return the logs with fitted samples by what their constants are."""
    groups: dict[tuple[tuple[str, float], ...], list[Log]] = {}
    for log in logs:
        if log.fitted.any():
            groups.setdefault(tuple(sorted(log.constants.items())), []).append(log)
    return list(groups.values())


def leave_one_condition_out(fitter: Fitter, found: FittedModel) -> float:
    """Return the squared errors of each condition by fits to the others, begun where one ended.

    0 where there are fewer than three conditions, so that nothing speaks for or against it.
    """
    groups = conditions(fitter.logs)
    if len(groups) < LEAST:
        return 0.0
    extra = [free for free in found.problem.free if free.prior is None]
    lost = 0.0
    for group in groups:
        rest = [log for other in groups if other is not group for log in other]
        fitted = replace(fitter, logs=rest).fit(found.effects, extra, found.values)
        unseen = replace(fitter, logs=group).problem(extra)
        errors = unseen.residuals(fitted.evidence.vector)[: unseen.samples]
        lost += float(errors @ errors)
    return lost
