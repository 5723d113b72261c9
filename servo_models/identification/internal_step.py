"""The internal step of a search: as long as the noise of the readings allows.

A search simulates the same logs thousands of times, and a plant that is fine enough for any use
is finer than noise can show: a time constant of 0.8 s read every 20 ms does not need steps of
2 ms.  So an interval of the log, its half, its quarter and so on are tried, and the first is taken
that gives the outputs of the model's own step as far as the log can tell.  Each effect is tried on
at its typical size, since a lag or a limit cycle may need what the plant does not, and a run takes
the least of what its effects need.

A step hangs on the names of parameters, not on their values: along a search it stays, or slopes
would be differences between two steps.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from servo_models.core.simulate import Model
from servo_models.core.stop import Stop
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.simulation import Run, prepared

SHARE = 0.05
"""Error [noise floors, RMS] that a longer step may make."""
VISIBLE = 1.0
"""Sum of the squares of these errors in a log: the noise has a standard deviation of that size
along any course of errors, so what is less cannot be told from noise."""
MOST_ROWS = 0.9
"""Share of the rows that follow the one before within what is called an interval: clocks jitter."""


@dataclass(eq=False)
class InternalSteps:
    """The longest internal step [s] that the noise allows, by log and effects.

    Attributes:
        model: about which it is measured; it says which effects are on anyway.
        noise: standard deviation [SI] of each output.
        stop: ends the search.
    """

    model: Model
    noise: Mapping[str, float]
    stop: Stop = field(default_factory=Stop)
    _found: dict[tuple[Log, str], float] = field(default_factory=dict, init=False, repr=False)

    def longest(self, run: Run, names: Iterable[str]) -> float:
        """Return the step for a run in which these parameters may be anything."""
        plant = self.model.plant
        others = (name for name, value in run.model.values.items() if value != self._own(name))
        owners = {plant.parameters[name].owner for name in (*names, *others)}
        return min(self._of(run.log, owner) for owner in {"", *owners})

    def _own(self, name: str) -> float:
        return self.model.values[name]

    def _of(self, log: Log, effect: str) -> float:
        key = (log, effect)
        if key not in self._found:
            self._found[key] = self._measured(prepared(self.model, log), self._typical(effect))
        return self._found[key]

    def _typical(self, effect: str) -> dict[str, float]:
        """Switches of an effect that are off, at their typical size."""
        return {
            name: parameter.param.typical
            for name, parameter in self.model.plant.parameters.items()
            if parameter.owner == effect and parameter.param.switch and self._own(name) == 0.0
        }

    def _measured(self, run: Run, values: Mapping[str, float]) -> float:
        own = run.model.values["internal_step"]
        noise = np.array([self.noise[name] for name in run.log.outputs])
        try:
            fine = run.outputs(values)
        except UserError:
            return own
        for step in _longer(run.log.times, own):
            if _hidden((run.outputs_or_nan({**values, "internal_step": step}) - fine) / noise):
                return step
        return own


def _longer(times: Array, own: float) -> Iterator[float]:
    """Yield the interval of a log, its half and so on, as long as they are longer than a step."""
    step = float(np.quantile(np.diff(times), MOST_ROWS)) if len(times) > 1 else 0.0
    while step > own:
        yield step
        step *= 0.5


def _hidden(errors: Array) -> bool:
    """Whether noise hides errors [noise floors], shape (n, outputs); NaN are seen."""
    total = float(np.sum(errors**2))
    return total <= min(VISIBLE, SHARE**2 * errors.size)
