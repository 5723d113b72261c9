"""Which nominal parameters are free in every fit, and how far."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace

from servo_models.core.simulate import Model
from servo_models.data.description import Description
from servo_models.identification.problem import Free, free_parameter

BELIEVED = 4.0
"""Prior deviations that a nominal parameter may move."""


def prior_parameters(told: Description) -> tuple[Free, ...]:
    """Return what is free in every fit: parameters with an uncertainty, within its reach.

    Without the limit a large gap takes them anywhere, and an effect that is missing is
    imitated by constants that nobody would believe.
    """
    parameters, found = told.model.plant.parameters, []
    uncertain = told.uncertainty.keys()
    for name, prior in told.uncertainty.items():
        if _idle(told.model, name, uncertain):
            continue
        nominal, bounds = told.model.values[name], told.bounds.get(name)
        free = free_parameter(parameters[name], nominal, prior, bounds)
        low, high = free.nominal - BELIEVED * prior, free.nominal + BELIEVED * prior
        found.append(replace(free, low=max(free.low, low), high=min(free.high, high)))
    return tuple(found)


def _idle(model: Model, name: str, uncertain: Container[str]) -> bool:
    """Whether a parameter is that of an effect that is off and surely so."""
    known = model.plant.parameters
    owner = known[name].owner
    switches = [it.name for it in known.values() if owner and it.owner == owner and it.param.switch]
    return bool(switches) and not any(model.values[it] or it in uncertain for it in switches)
