"""Linear state space of a model about a working point.

A, B, C, D are differences of the model's own text about its point of rest: of derivatives in
continuous time, of the state from tick to tick where the plant has a clock of its own, as in
a digital controller.  A lag is a state more, a transport delay in continuous time an extra
channel that stays exact.  What has no derivative (jumps, memories, the clocks of effects) is
left out, with the reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from servo_models.analysis.linear_model import LinearModel
from servo_models.analysis.small_signals import Continuous, Sampled, SmallSignals, plant_clocks
from servo_models.core.flat import neutral_effects
from servo_models.core.plant import check_known
from servo_models.core.simulate import Model
from servo_models.errors import UserError


def linearise(model: Model, at: Mapping[str, float] | None = None) -> LinearModel:
    """Return the linear state space about the point where ``model`` rests.

    Args:
        model: any.
        at: SI values of inputs there by name; an input not named is at rest.

    Raises:
        UserError: an unknown input, no point of rest, or a plant with several clocks.

    Example:
        >>> import servo_models as sm
        >>> linear = sm.linearise(sm.model("gimbal.py"))
        >>> linear.states, linear.inputs, linear.outputs
        (('speed', 'angle'), ('command',), ('reading', 'voltage'))
    """
    inputs = inputs_at(model, at)
    kind = Sampled if plant_clocks(model) else Continuous
    kept, left_out = _smooth_part(model, inputs, kind)
    return kind(kept, inputs).linear(left_out)


def inputs_at(model: Model, at: Mapping[str, float] | None) -> list[float]:
    """Return the values [SI] of all inputs where some are given by name.

    Raises:
        UserError: an unknown input.
    """
    rest = {wire.name: float(wire.rest) for wire in model.plant.inputs}
    check_known("input", at or (), rest, f"actuator '{model.actuator.name}'")
    return list({**rest, **(at or {})}.values())


def _smooth_part(
    model: Model, inputs: list[float], kind: type[SmallSignals]
) -> tuple[Model, dict[str, str]]:
    """The model with the effects that have a derivative, and why the others have none."""
    neutral = neutral_effects(model.flat, list(model.values.values()))
    active = {
        name: tuple(link.effect for link in links)
        for name, links in model.plant.placements.items()
        if name not in neutral
    }
    linear = {owner for _, owner, _ in model.flat.states}
    linear |= {name for name in active if model.plant.main(name).effect.hints.small_signal}
    left_out = {
        name: "it has a memory"
        for name, effects in active.items()
        if name not in linear and any(effect.memory or effect.queues for effect in effects)
    }
    doubtful = [name for name in active if name not in linear and name not in left_out]
    base = kind(_without(model, {*left_out, *doubtful}), inputs)
    for name in doubtful:
        others = {*left_out, *doubtful} - {name}
        reason = _roughness(_without(model, others), inputs, base)
        if reason:
            left_out[name] = reason
    return _without(model, set(left_out)), left_out


def _roughness(model: Model, inputs: list[float], base: SmallSignals) -> str:
    """Why ``model``, which is ``base`` with one effect more, has no derivative; "" if it has."""
    try:
        trial = type(base)(model, inputs)
    except UserError:
        return "it keeps the model from rest"
    if not trial.is_smooth(base):
        return "it jumps or bends at this point"
    return "it lets nothing small pass at this point" if trial.blocks(base) else ""


def _without(model: Model, effects: set[str]) -> Model:
    """The model with these effects at their neutral value."""
    parameters = model.plant.parameters
    values = {
        name: 0.0 if parameters[name].owner in effects and parameters[name].param.switch else value
        for name, value in model.values.items()
    }
    return replace(model, values=values)
