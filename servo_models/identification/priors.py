"""What is free in every fit of a diagnosis: parameters with an uncertainty, near their values.

Without the limit a large gap takes them anywhere, and an effect that is missing is imitated by
constants that nobody would believe.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace

from servo_models.core.simulate import Model
from servo_models.data.description import Description
from servo_models.identification.problem import Free, free_parameter

PRIOR_BOUND_SIGMAS = 4.0  # prior deviations that a nominal parameter may move


def prior_parameters(told: Description, widened: float = 1.0) -> tuple[Free, ...]:
    """Return the parameters that a description gives an uncertainty, with their bounds; ``widened``
    is a factor on these uncertainties."""
    parameters, priors = told.model.plant.parameters, []
    uncertain = told.uncertainty.keys()
    for name, prior in told.uncertainty.items():
        if _idle(told.model, name, uncertain):
            continue
        nominal, bounds = told.model.values[name], told.bounds.get(name)
        free = free_parameter(parameters[name], nominal, prior, bounds)
        wide = widened * prior
        low, high = nominal - PRIOR_BOUND_SIGMAS * wide, nominal + PRIOR_BOUND_SIGMAS * wide
        low, high = max(free.low, low), min(free.high, high)
        priors.append(replace(free, low=low, high=high, prior=wide, widened=widened))
    return tuple(priors)


def _idle(model: Model, name: str, uncertain: Container[str]) -> bool:
    """Whether a parameter is that of an effect that is off and surely so."""
    known = model.plant.parameters
    owner = known[name].owner
    switches = [it.name for it in known.values() if owner and it.owner == owner and it.param.switch]
    return bool(switches) and not any(model.values[it] or it in uncertain for it in switches)
