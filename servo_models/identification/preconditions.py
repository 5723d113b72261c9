"""What no fit can do without: logs with samples to fit, and commands that move.

``identify`` and ``diagnose`` refuse the same, in the same words.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servo_models.core.plant import unknown
from servo_models.core.simulate import Model
from servo_models.data.audit import audits, noise_floors, show_motion
from servo_models.data.log import Log
from servo_models.data.outliers import without_outliers
from servo_models.errors import UserError
from servo_models.identification.problem import Problem
from servo_models.identification.resolution import with_unsure_inputs
from servo_models.identification.starts import with_starts


def checked_logs(
    model: Model, logs: Sequence[Log], free: int = 0, where: object = None
) -> tuple[Log, ...]:
    """Return logs with how they begin and without single wild readings; refuse what nothing could
    be said of, before the work.

    Args:
        model: nominal.
        logs: to be fitted.
        free: number of parameters that are.
        where: the description, for the message.

    Raises:
        UserError: no logs; every sample held out; an output that the model has not; no more
            samples than free parameters; a log on which the nominal model cannot be simulated;
            inputs that never change, neither in a log nor from one to another, where nothing
            moves either.
    """
    told = "the description" if where is None else f"'{where}'"
    if not logs:
        raise UserError(f"{told} describes no log: add [[logs]]")
    fitted = [log for log in logs if log.fitted.any()]
    if not fitted:
        raise UserError(f"{told} holds out every sample: leave some to fit")
    for log in logs:
        for name in log.outputs:
            if name not in model.plant.outputs:
                raise UserError(unknown("output", name, dict.fromkeys(model.plant.outputs)))
    logs = [without_outliers(log, model.plant) for log in logs]
    samples = sum(int(log.fitted.sum()) for log in logs)
    if samples <= free:
        raise UserError(
            f"{samples} samples to fit for {free} free parameters: give a longer log, hold"
            " out less, or free fewer"
        )
    for log in logs:
        _check_simulated(model, log, told)
    begun = with_starts(model, logs)
    if not show_motion([log for log in begun if log.fitted.any()], model.plant):
        raise UserError(
            "no input ever changes, neither in a log nor from one to another, and nothing moves: a"
            " single standstill tells nothing of a motion; record a command that moves"
        )
    return with_unsure_inputs(model, begun, {}, noise_floors(audits(begun, model.plant)))


def _check_simulated(model: Model, log: Log, told: str) -> None:
    try:
        Problem(model, [log], []).responses(np.empty(0))
    except UserError as error:
        stated = ", or the constants of this log" if log.constants else ""
        raise UserError(
            f"{told}: the nominal model cannot be simulated on log '{log.name}': {error};"
            f" correct its parameters{stated}"
        ) from error
