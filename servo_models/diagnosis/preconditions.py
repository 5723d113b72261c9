"""What a diagnosis cannot do without, beside what no fit can: a motion to its end, no flags."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from servo_models.analysis.linearise import linearise
from servo_models.core.plant import Plant
from servo_models.core.simulate import Model
from servo_models.data.log import Log
from servo_models.errors import UserError


def check_duration(model: Model, logs: Sequence[Log]) -> None:
    """Refuse logs all of which are shorter than the slowest time constant of a model.

    Raises:
        UserError: they are; so the model is of another actuator, or nothing settles in them.
    """
    longest = max((log for log in logs if log.fitted.any()), key=lambda log: log.duration)
    slowest = slowest_time_constant(model)
    if longest.duration < slowest:
        raise UserError(
            f"log '{longest.name}' lasts {longest.duration:.3g} s, but the slowest time constant"
            f" of '{model.actuator.name}' is {slowest:.3g} s: log ten of them, or correct the unit"
            " of its time or the actuator"
        )


def without_flags(logs: Iterable[Log], plant: Plant) -> tuple[tuple[Log, ...], tuple[str, ...]]:
    """Return logs without outputs that say yes or no, and the names of these.

    The size of an error in a flag says nothing, and a floor of it is none.

    Raises:
        UserError: a log with no other output.
    """
    others, left_out = [], dict[str, None]()
    for log in logs:
        flags = [name for name in log.outputs if plant.wire[name].flag]
        kept = {name: it for name, it in log.outputs.items() if name not in flags}
        if not kept:
            raise UserError(
                f"log '{log.name}' has no output but '{flags[0]}', which says yes or no: add one"
                " that is measured"
            )
        left_out |= dict.fromkeys(flags)
        others.append(replace(log, outputs=kept) if flags else log)
    return tuple(others), tuple(left_out)


def slowest_time_constant(model: Model) -> float:
    """Return the slowest time constant [s] about rest; 0 where nothing decays or rests, or where
    the output has no place of rest to settle at, as a motor that nothing holds."""
    try:
        linear = linearise(model)
    except UserError:
        return 0.0
    return 0.0 if linear.integrates() else linear.slowest()
