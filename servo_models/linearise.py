"""Linear state space of a model about a working point.

The printed text of the model is evaluated at zero step size, which gives the derivatives of
its states and its outputs; differences of these are A, B, C, D.  A lag is a state more, a
transport delay an extra channel that stays exact.  What has no derivative (jumps, memories,
clocks) is left out, and said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servo_models.actuator import Placement, unknown
from servo_models.block import Clock
from servo_models.compiled import plain_make
from servo_models.effects.lag import lag
from servo_models.effects.transport_delay import transport_delay
from servo_models.errors import UserError
from servo_models.flat import neutral_effects
from servo_models.linear_model import LinearModel
from servo_models.simulate import Model
from servo_models.stepper import step_text

Array = NDArray[np.float64]

SMALL = 1e-5
"""Difference for a derivative, in full scales of the wire."""
MODERATE = 0.05
"""Difference at which an effect must still look the same to count as smooth."""
BLOCKS = 50
"""Default experiments after which a model that still moves has no point of rest."""


def linearise(model: Model, at: Mapping[str, float] | None = None) -> LinearModel:
    """Return the linear state space about the point where ``model`` rests.

    Args:
        model: whose plant runs in continuous time.
        at: SI values of inputs there by name; an input not named is at rest.

    Raises:
        UserError: an unknown input, a plant with a clock of its own, or no point of rest.
    """
    inputs = inputs_at(model, at)
    if is_sampled(model):
        raise UserError(
            f"actuator '{model.actuator.name}' has a sampled loop: no continuous state space"
        )
    kept, left_out = _smooth_part(model, inputs)
    return _Evaluation(kept, inputs).linear(left_out)


def is_sampled(model: Model) -> bool:
    """Whether a clock belongs to the plant itself, as in a digital controller."""
    return any(
        isinstance(memory, Clock)
        for link in model.plant.chain
        if not isinstance(link, Placement)
        for memory in link.memory.values()
    )


def inputs_at(model: Model, at: Mapping[str, float] | None) -> list[float]:
    """Return the values [SI] of all inputs where some are given by name.

    Raises:
        UserError: an unknown input.
    """
    rest = {wire.name: float(wire.rest) for wire in model.plant.inputs}
    for name in at or {}:
        if name not in rest:
            raise UserError(unknown("input", name, rest, f"actuator '{model.actuator.name}'"))
    return list({**rest, **(at or {})}.values())


def _smooth_part(model: Model, inputs: list[float]) -> tuple[Model, dict[str, str]]:
    """The model with the effects that have a derivative, and why the others have none."""
    neutral = neutral_effects(model.flat, list(model.values.values()))
    active = {
        name: tuple(link.effect for link in links)
        for name, links in model.plant.placements.items()
        if name not in neutral
    }
    linear = {name for name, found in active.items() if found[0] in (lag, transport_delay)}
    left_out = {
        name: "it has a memory"
        for name, found in active.items()
        if name not in linear and any(effect.memory or effect.queues for effect in found)
    }
    doubtful = [name for name in active if name not in linear and name not in left_out]
    base = _Evaluation(_without(model, {*left_out, *doubtful}), inputs)
    for name in doubtful:
        others = {*left_out, *doubtful} - {name}
        trial = _Evaluation(_without(model, others), inputs, start=base.state)
        if not trial.is_smooth(base):
            left_out[name] = "it jumps or bends at this point"
        elif trial.blocks(base):
            left_out[name] = "it lets nothing small pass at this point"
    return _without(model, set(left_out)), left_out


def _without(model: Model, effects: set[str]) -> Model:
    """The model with these effects at their neutral value."""
    parameters = model.plant.parameters
    values = {
        name: 0.0 if parameters[name].owner in effects and parameters[name].param.switch else value
        for name, value in model.values.items()
    }
    return replace(model, values=values)


class _Evaluation:
    """Derivatives and outputs of a smooth model, as functions of states, channels and inputs.

    An argument is a vector of the states, the values of the lags, the outputs of the delays
    and the inputs; a value one of the derivatives of states and lags, the inputs of the
    delays and the outputs.
    """

    def __init__(self, model: Model, inputs: list[float], start: list[float] | None = None) -> None:
        self.model = model
        flat, plant = model.flat, model.plant
        values = list(model.values.values())
        neutral = neutral_effects(flat, values)
        rates = [rate for _, _, rate in flat.states]
        wide = replace(flat, outputs=[*rates, *flat.outputs])
        self._start, self._step = plain_make(step_text(wide, neutral))(values)
        self._inputs = inputs
        self._free = [i for i, (_, owner, _) in enumerate(flat.states) if owner not in neutral]
        names = [*(name for name, _, _ in flat.states), *(name for name, _ in flat.memory)]
        self._slot = {name: i for i, name in enumerate(names)}
        active = {n: links[0] for n, links in plant.placements.items() if n not in neutral}
        self._lags = [name for name, link in active.items() if link.effect is lag]
        self._delays = [name for name, link in active.items() if link.effect is transport_delay]
        self._lag_times = [model.values[f"{name}.time_constant"] for name in self._lags]
        self._arguments = [
            *self._free,
            *(self._slot[f"{name}_value"] for name in self._lags),
            *(self._slot[f"{name}_current"] for name in self._delays),
        ]
        wires = [plant.states[i].wire for i in self._free]
        wires += [plant.wire[active[name].on[0]] for name in (*self._lags, *self._delays)]
        self.scales = np.array([wire.scale for wire in (*wires, *plant.inputs)])
        self.time = 0.0
        self.state = self._rest() if start is None else start

    def slopes(self, share: float) -> Array:
        """Differences of the values over those of the arguments, ``share`` of a scale away."""
        steps = share * self.scales
        columns = [(self._at(k, step) - self._at(k, 0.0)) / step for k, step in enumerate(steps)]
        return np.column_stack(columns)

    def jacobian(self) -> Array:
        return 0.5 * (self.slopes(SMALL) + self.slopes(-SMALL))

    def is_smooth(self, base: _Evaluation) -> bool:
        """Whether differences to either side, small and moderate, are about the same."""
        near = self.jacobian() * self.scales
        size = 0.1 * np.maximum(abs(near), abs(base.jacobian() * base.scales)).max(axis=1)
        sides = [SMALL, -SMALL, MODERATE, -MODERATE]
        gaps = [abs(self.slopes(side) * self.scales - near).max(axis=1) for side in sides]
        return bool(np.all(np.array(gaps) <= size))

    def blocks(self, base: _Evaluation) -> bool:
        """Whether the main input no longer reaches the main output, as it did in ``base``."""
        actuator = self.model.actuator
        route = (1.0 / actuator.stop_time, actuator.step[0], self.model.plant.outputs[0])
        gains = [abs(one.linear({}).response(*route)[0]) for one in (self, base)]
        return bool(gains[0] < 1e-3 * gains[1])

    def linear(self, left_out: Mapping[str, str]) -> LinearModel:
        plant, jacobian = self.model.plant, self.jacobian()
        n = len(self._free) + len(self._lags)
        names = [plant.states[i].name for i in self._free]
        inputs = tuple(wire.name for wire in plant.inputs)
        outputs = self._at(0, 0.0)[n + len(self._delays) :]
        return LinearModel(
            joint_a=jacobian[:n, :n],
            joint_b=jacobian[:n, n:],
            joint_c=jacobian[n:, :n],
            joint_d=jacobian[n:, n:],
            states=(*names, *self._lags),
            inputs=inputs,
            outputs=plant.outputs,
            delays={name: self.model.values[f"{name}.time"] for name in self._delays},
            left_out=left_out,
            point={
                **dict(zip(inputs, self._inputs)),
                **{name: self.state[i] for name, i in zip(names, self._free)},
                **dict(zip(plant.outputs, outputs.tolist())),
            },
        )

    def _at(self, k: int, change: float) -> Array:
        """Values at the point of rest, argument ``k`` changed."""
        x, u = list(self.state), list(self._inputs)
        if k < len(self._arguments):
            x[self._arguments[k]] += change
        else:
            u[k - len(self._arguments)] += change
        before = [x[self._slot[f"{name}_value"]] for name in self._lags]
        _, wide = self._step(x, u, self.time, 0.0)
        rates = [wide[i] for i in self._free]
        into = [x[self._slot[f"{name}_last"]] for name in self._lags]
        lags = [(a - b) / t for a, b, t in zip(into, before, self._lag_times)]
        delayed = [x[self._slot[f"{name}_newest"]] for name in self._delays]
        return np.array([*rates, *lags, *delayed, *wide[len(self.model.flat.states) :]])

    def _rest(self) -> list[float]:
        """Run until nothing moves any more."""
        x: list[float] = self._start()
        span = self.model.actuator.stop_time
        scale = self.scales[: len(self._arguments)]
        for _ in range(BLOCKS):
            before = np.array([x[i] for i in self._arguments])
            self._step(x, self._inputs, self.time, span)
            self.time += span
            moved = np.array([x[i] for i in self._arguments]) - before
            if np.all(abs(moved) <= 1e-9 * scale):
                return x
        raise UserError(
            f"actuator '{self.model.actuator.name}' does not come to rest at these inputs:"
            " choose another working point"
        )
