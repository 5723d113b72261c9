"""What a diagnosis cannot do without: logs to fit, long enough to show the slowest motion."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from servo_models.analysis.linearise import linearise
from servo_models.core.plant import Plant
from servo_models.core.simulate import Model
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.problem import Problem


def check_logs(where: object, model: Model, logs: Sequence[Log]) -> None:
    """Refuse what nothing could be said of.

    Args:
        where: the description, for the message.
        model: nominal.
        logs: of the description.

    Raises:
        UserError: no logs, every sample held out, the longest log is shorter than the slowest
            time constant of the model, or the model cannot be simulated on a log.
    """
    if not logs:
        raise UserError(f"'{where}' describes no log to diagnose: add [[logs]]")
    judging = [log for log in logs if log.fitted.any()]
    if not judging:
        raise UserError(f"'{where}' holds out every sample: leave some to diagnose")
    longest = max(judging, key=lambda log: log.duration)
    slowest = slowest_time_constant(model)
    if longest.duration < slowest:
        raise UserError(
            f"log '{longest.name}' lasts {longest.duration:.3g} s, but the slowest time constant"
            f" of '{model.actuator.name}' is {slowest:.3g} s: log ten of them, or name the"
            " actuator that made it"
        )
    for log in logs:
        try:
            Problem(model, [log], []).responses(np.empty(0))
        except UserError as error:
            stated = ", or the constants of this log" if log.constants else ""
            raise UserError(
                f"'{where}': the nominal model cannot be simulated on log '{log.name}': {error};"
                f" correct its parameters{stated}"
            ) from error


def without_flags(logs: Iterable[Log], plant: Plant) -> tuple[tuple[Log, ...], tuple[str, ...]]:
    """Return logs without outputs that say yes or no, and the names of these.

    The size of an error in a flag says nothing, and a floor of it is none.

    Raises:
        UserError: a log with no other output.
    """
    found, left_out = [], dict[str, None]()
    for log in logs:
        flags = [name for name in log.outputs if plant.wire[name].flag]
        kept = {name: it for name, it in log.outputs.items() if name not in flags}
        if not kept:
            raise UserError(
                f"log '{log.name}' has no output but '{flags[0]}', which says yes or no: add one"
                " that is measured"
            )
        left_out |= dict.fromkeys(flags)
        found.append(replace(log, outputs=kept) if flags else log)
    return tuple(found), tuple(left_out)


def slowest_time_constant(model: Model) -> float:
    """Return the slowest time constant [s] about rest; 0 where nothing decays or rests."""
    try:
        return linearise(model).slowest()
    except UserError:
        return 0.0
