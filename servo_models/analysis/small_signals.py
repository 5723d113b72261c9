"""Differences of a smooth model about a point of rest: in continuous time, or from tick to tick.

The text of the model is printed with the derivatives of its states among its outputs.  It is
evaluated at zero step size for these, and over one period for the map of a sampled loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from servo_models.analysis.linear_model import LinearModel
from servo_models.core.block import DeadTime, FirstOrderLag, LinearMemory, Memory
from servo_models.core.compiled import plain_make
from servo_models.core.flat import neutral_effects, owned, trouble
from servo_models.core.plant import Placement
from servo_models.core.simulate import Model
from servo_models.core.stepper import step_text
from servo_models.core.types import Array
from servo_models.errors import UserError

Step = Callable[[list[float], list[float], float, float], Any]

SMALL = 1e-5  # step of a difference quotient in full scales of the wire
MODERATE = 0.05  # step in full scales at which a smooth effect has the same difference quotient
EVENT_TOLERANCE = 1e-6  # internal steps after a point within which an event belongs to its step
BLOCKS = 50  # default experiments after which a model that still moves has no point of rest


class SmallSignals:
    """Values of a smooth model as functions of arguments, about a point of rest.

    Arguments are entries of the state vector, outputs of delays and inputs; values are one number
    for each of these entries, inputs of delays and outputs.

    Attributes:
        period: time [s] from one value of a state to the next, 0 for derivatives.
        channels: name and time [s] of every output of a delay.
        state, time: where the model rests.
    """

    def __init__(self, model: Model, inputs: list[float]) -> None:
        """Find the point of rest.

        Raises:
            UserError: there is none, or the model cannot be simulated.
        """
        self.model = model
        flat, plant = model.flat, model.plant
        neutral = neutral_effects(flat, list(model.values.values()))
        self._inputs = inputs
        names = [*(name for name, _, _ in flat.states), *(name for name, _ in flat.memory)]
        self._slot = {name: i for i, name in enumerate(names)}
        self._free = [i for i, (_, owner, _) in enumerate(flat.states) if owner not in neutral]
        active = (plant.main(name) for name in plant.placements if name not in neutral)
        small_signal = {link.name: link.effect.hints.small_signal for link in active}
        self._linear = {name: linear for name, linear in small_signal.items() if linear}
        wide = replace(flat, outputs=[*(rate for _, _, rate in flat.states), *flat.outputs])
        make = plain_make(step_text(wide, neutral))
        start, step = make(list(model.values.values()))
        self._step = self._checked(step)
        self.state: list[float] = start()
        self.time = 0.0
        self._settle()
        # from here on nothing leaves a delay by itself: what leaves it is an argument
        endless = {self._parameter(name): math.inf for name in self._of(DeadTime)}
        _, step = make(list({**model.values, **endless}.values()))
        self._step = self._checked(step)
        self.period = self._period()
        self.channels = self._channels()
        wires = [plant.states[i].wire for i in self._free]
        more = self._more()
        self.names = (*(wire.name for wire in wires), *(name for name, _, _ in more))
        self._entries = [*self._free, *(self._slot[text] for _, text, _ in more)]
        scales = [wire.scale for wire in wires] + [scale for _, _, scale in more]
        scales += [self._scale(name) for name, _ in self.channels]
        self.scales = np.array([*scales, *(wire.scale for wire in plant.inputs)])

    def _checked(self, step: Step) -> Step:
        """A step that raises where the model cannot be simulated."""

        def checked(x: list[float], u: list[float], time: float, size: float) -> Any:
            code, wide = step(x, u, time, size)
            if code:
                raise UserError(f"{trouble(self.model.flat, code, x)}, at t = {time + size:g} s")
            return code, wide

        return checked

    def _of(self, kind: type[LinearMemory]) -> list[str]:
        """Names under which effects of a kind are active."""
        return [name for name, linear in self._linear.items() if isinstance(linear, kind)]

    def _parameter(self, name: str) -> str:
        """The time of a lag or a delay, a parameter."""
        return f"{name}.{self._linear[name].time}"

    def _time(self, name: str) -> float:
        """Its value [s]."""
        return self.model.values[self._parameter(name)]

    def _into(self, name: str) -> int:
        """Where the state vector holds what went into a lag or a delay last."""
        return self._slot[owned(name, self._linear[name].input)]

    def _out_of(self, name: str) -> int:
        """Where it holds what came out of it last."""
        return self._slot[owned(name, self._linear[name].output)]

    def _scale(self, name: str) -> float:
        return self.model.plant.wire[self.model.plant.main_wire(name)].scale

    def _period(self) -> float:
        return 0.0

    def _channels(self) -> list[tuple[str, float]]:
        return [(name, self._time(name)) for name in self._of(DeadTime)]

    def _more(self) -> list[tuple[str, str, float]]:
        """Further states: name, entry in the text, scale."""
        raise NotImplementedError

    def _values(self, x: list[float], u: list[float], channel: int, change: float) -> list[float]:
        """Values at a state vector, which may be altered, inputs, and a change of a channel."""
        raise NotImplementedError

    def linear(self, left_out: Mapping[str, str]) -> LinearModel:
        """Return A, B, C, D of derivatives to both sides."""
        jacobian, n, plant = self.jacobian(), len(self.names), self.model.plant
        return LinearModel(
            joint_a=jacobian[:n, :n],
            joint_b=jacobian[:n, n:],
            joint_c=jacobian[n:, :n],
            joint_d=jacobian[n:, n:],
            states=self.names,
            inputs=tuple(wire.name for wire in plant.inputs),
            outputs=plant.outputs,
            channels=tuple(time for _, time in self.channels),
            delays={name: self._time(name) for name, _ in self.channels},
            left_out=left_out,
            point=self.point(),
            period=self.period,
        )

    def slopes(self, share: float) -> Array:
        """Differences of the values over those of the arguments, ``share`` of a scale away."""
        steps = share * self.scales
        origin = self._at(0, 0.0)
        return np.column_stack(
            [(self._at(k, step) - origin) / step for k, step in enumerate(steps)]
        )

    def jacobian(self) -> Array:
        return 0.5 * (self.slopes(SMALL) + self.slopes(-SMALL))

    def is_smooth(self, base: SmallSignals) -> bool:
        """Whether small and moderate differences to either side are as alike as in ``base``."""
        gaps, size = self._gaps()
        others, other_size = base._gaps()
        return bool(np.all(gaps <= others + 0.1 * np.maximum(size, other_size)))

    def _gaps(self) -> tuple[Array, Array]:
        """How far differences are from the derivatives, for each value, and how large those are."""
        near = self.jacobian() * self.scales
        sides = (SMALL, -SMALL, MODERATE, -MODERATE)
        gaps = [abs(self.slopes(side) * self.scales - near).max(axis=1) for side in sides]
        return np.array(gaps), abs(near).max(axis=1)

    def blocks(self, base: SmallSignals) -> bool:
        """Whether a value depends on nothing any more, or the main output not on the main input.

        Values that already do so in ``base`` do not count.
        """
        if np.any(self._gaps()[1] < 1e-3 * base._gaps()[1]):
            return True
        model = self.model
        route = (1.0 / model.stop_time, model.step[0], model.plant.outputs[0])
        gains = [abs(one.linear({}).response(*route)[0]) for one in (self, base)]
        return bool(gains[0] < 1e-3 * gains[1])

    def point(self) -> dict[str, float]:
        """SI values of inputs, states and outputs at the point of rest."""
        plant = self.model.plant
        return {
            **{wire.name: value for wire, value in zip(plant.inputs, self._inputs)},
            **{plant.states[i].name: self.state[i] for i in self._free},
            **dict(zip(plant.outputs, self._outputs(list(self.state), self._inputs))),
        }

    def _outputs(self, x: list[float], u: list[float]) -> list[float]:
        """Outputs at a state vector, which gets its memories committed."""
        wide: list[float] = self._step(x, u, self.time, 0.0)[1]
        return wide[len(self.model.plant.states) :]

    def _at(self, k: int, change: float) -> Array:
        """Values at the point of rest with argument ``k`` changed."""
        x, u = list(self.state), list(self._inputs)
        channel, column = k - len(self._entries), k - len(self._entries) - len(self.channels)
        if channel < 0:
            x[self._entries[k]] += change
        elif column >= 0:
            u[column] += change
        return np.array(self._values(x, u, channel, change))

    def _settle(self) -> None:
        """Run until the model rests."""
        plant, span = self.model.plant, self.model.stop_time
        scale = np.array([plant.states[i].wire.scale for i in self._free])
        for _ in range(BLOCKS):
            before = np.array([self.state[i] for i in self._free])
            self._step(self.state, self._inputs, self.time, span)
            self.time += span
            moved = np.array([self.state[i] for i in self._free]) - before
            if np.all(abs(moved) <= 1e-9 * scale):
                return
        raise UserError(
            f"actuator '{self.model.actuator.name}' does not come to rest at these inputs:"
            " choose another working point"
        )


class Continuous(SmallSignals):
    """Derivatives; a lag is a state more."""

    def _more(self) -> list[tuple[str, str, float]]:
        lags = self._of(FirstOrderLag)
        return [(name, owned(name, self._linear[name].output), self._scale(name)) for name in lags]

    def _values(self, x: list[float], u: list[float], channel: int, change: float) -> list[float]:
        lags = self._of(FirstOrderLag)
        if 0 <= channel < len(self.channels):
            x[self._out_of(self.channels[channel][0])] += change
        before = [x[self._out_of(name)] for name in lags]
        _, wide = self._step(x, u, self.time, 0.0)
        into = [x[self._into(name)] for name in lags]
        return [
            *(wide[i] for i in self._free),
            *((a - b) / t for a, b, t in zip(into, before, map(self._time, lags))),
            *(x[self._into(name)] for name, _ in self.channels),
            *wide[len(self.model.plant.states) :],
        ]


class Sampled(SmallSignals):
    """The map from just before one tick of the plant's clock to the next.

    The memories of the plant's blocks and of lags are states.  The input of a delay
    changes at ticks, so its output changes once a period: it has a channel for the value
    before that instant, and one for the value after it, which is a period younger.
    """

    def _settle(self) -> None:
        super()._settle()
        tick = self.state[self._clock]
        # what is due now stays so: a step of no length would take the tick
        if tick > self.time + EVENT_TOLERANCE * self.model.values["internal_step"]:
            self._step(self.state, self._inputs, self.time, tick - self.time)
            self.time = tick

    def _period(self) -> float:
        x = list(self.state)
        self._outputs(x, self._inputs)
        return x[self._clock] - self.time

    def _channels(self) -> list[tuple[str, float]]:
        made = []
        for name, time in super()._channels():
            whole = math.floor(time / self.period + 1e-9)
            made += [(name, (whole + 1) * self.period), (name, whole * self.period)]
        return made

    @property
    def _clock(self) -> int:
        clocks = plant_clocks(self.model)
        if len(clocks) > 1:
            raise UserError(
                f"actuator '{self.model.actuator.name}' has several clocks: no linear model"
            )
        return self._slot[clocks[0]]

    def _more(self) -> list[tuple[str, str, float]]:
        memories = [
            (f"{link.name}.{name}", owned(link.name, name))
            for link in self.model.plant.chain
            if not isinstance(link, Placement)
            for name, memory in link.memory.items()
            if type(memory) is Memory
        ]
        lagged = {
            n: (self._linear[n].output, self._linear[n].input) for n in self._of(FirstOrderLag)
        }
        lags = [(f"{n}.{key}", owned(n, key)) for n, keys in lagged.items() for key in keys]
        return [(name, text, 1.0) for name, text in (*memories, *lags)]

    def _values(self, x: list[float], u: list[float], channel: int, change: float) -> list[float]:
        before, after, split, slot = 0.0, 0.0, 0.0, 0
        if 0 <= channel < len(self.channels):
            name = self.channels[channel][0]
            slot = self._out_of(name)
            split = max(self._time(name) - self.channels[channel | 1][1], 0.0)
            before, after = (change, 0.0) if channel % 2 == 0 else (0.0, change)
        if split <= 1e-9 * self.period:
            split, before = 0.0, after
        x[slot] += before
        first = list(x)
        outputs = self._outputs(first, u)
        if split > 0.0:
            self._step(x, u, self.time, split)
        x[slot] += after - before
        self._step(x, u, self.time + split, self.period - split)
        fed = [first[self._into(name)] for name, _ in self.channels]
        return [*(x[i] for i in self._entries), *fed, *outputs]


def plant_clocks(model: Model) -> list[str]:
    """Return the names, in the text, of the clocks that tick in the plant itself, not in effects.

    A clock that nothing needs, as that of a controller without I and D gains, never ticks.
    """
    flat, values = model.flat, list(model.values.values())
    of_plant = {name for name, owner in flat.clocks if not owner}
    if not of_plant:
        return []
    start, step = plain_make(step_text(flat, neutral_effects(flat, values)))(values)
    state = start()
    step(state, [float(wire.rest) for wire in model.plant.inputs], 0.0, 0.0)
    entries = enumerate((name for name, _ in flat.memory), len(flat.states))
    return [name for i, name in entries if name in of_plant and math.isfinite(state[i])]
