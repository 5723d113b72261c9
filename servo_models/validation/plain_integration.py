"""Integrate a plant by calling its blocks as plain Python functions of floats.

Nothing here is printed, inlined or compiled, so that it can judge the text that is.  It knows
only the declarations (``block.py``, ``actuator.py``): a chain of functions between wires,
parameters, memories that are kept at both ends of a step, clocks at which a step ends, a
projection after it.  An effect whose switches are all 0 is the identity by its contract, and is
left out.

Where nothing that is on remembers, looks at the clock or is projected, ``solve_ivp`` goes from
one communication point to the next.  Elsewhere memories are part of the law, and how often they
are kept is part of the model: a plain loop keeps them ``finer`` times in each internal step, and
brings the states there by Kutta's method of third order.  A jump of a mode is not located.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from servo_models.core.block import RESERVED, Block, Clock, Fault
from servo_models.core.plant import Placement, Plant
from servo_models.core.types import Array
from servo_models.errors import UserError

Key = Any  # key of a value: the name of a wire, or (number of the link, name in its block)

DUE = 1e-6  # internal steps before its time from which a clock ticks; see the contract of a step
RELATIVE = 1e-10  # relative tolerance of ``solve_ivp``
ABSOLUTE = 1e-12  # absolute tolerance of ``solve_ivp`` over a state's full scale


class Course(NamedTuple):
    """The course of an integration.

    Attributes:
        times: of all its points [s], shape (m,).
        outputs: there, shape (m, outputs), SI.
        rows: indices of the communication points, shape (n,).
    """

    times: Array
    outputs: Array
    rows: NDArray[np.intp]


@dataclass(frozen=True)
class _Link:
    """A block at its place: the sources of its arguments and the targets of its results."""

    function: Callable[..., Any]
    reads: tuple[Key, ...]
    writes: tuple[str, ...]
    keeps: tuple[Key, ...]


class PlainPlant:
    """A plant at fixed parameters, ``values`` [SI], with its memories."""

    def __init__(self, plant: Plant, values: Mapping[str, float]) -> None:
        self.plant = plant
        self.base: dict[Key, Any] = {
            n: values[n] for n, p in plant.parameters.items() if not p.owner
        }
        self.links: list[_Link] = []
        self.clocks: list[Key] = []
        self.faults: dict[Key, str] = {}
        blocks: list[tuple[Block, Placement | None, tuple[str, ...]]] = []
        for link in plant.chain:
            if not isinstance(link, Placement):
                blocks.append((link, None, link.gives))
            elif _is_on(plant, link.name, values):
                blocks.append((link.effect, link, link.on))
        for number, (block, placed, writes) in enumerate(blocks):
            self._add(number, block, placed, writes, values)
        self.projection = plant.projection
        every = [block for block, _, _ in blocks]
        self.smooth = self.projection is None and not any(_remembers(it) for it in every)
        at_rest = self._setup()
        self.internal_step: float = at_rest["internal_step"]
        for number, (block, _, writes) in enumerate(blocks):
            for name, memory in block.memory.items():
                start = memory.start
                if start == "rest":
                    start = plant.wire[writes[0]].rest
                self.base[number, name] = _start(start, at_rest)
        self.states = [_start(state.start, at_rest) for state in plant.states]
        self.inputs_set = 0.0

    def _add(
        self,
        number: int,
        block: Block,
        placed: Placement | None,
        writes: tuple[str, ...],
        values: Mapping[str, float],
    ) -> None:
        reads: list[Key] = []
        key_of = {argument: key for key, argument in block.keys.items()}
        for argument in inspect.signature(block.function).parameters:
            if argument in block.wires:
                reads.append(placed.wire_of(argument) if placed else argument)
                continue
            key = key_of.get(argument, argument)
            reads.append((number, key))
            if key in block.params:
                name = f"{placed.name}.{key}" if placed else key
                self.base[number, key] = values[name]
            elif key in block.queues:
                self.base[number, key] = [0.0] * block.queues[key].size
        for name, memory in block.memory.items():
            if isinstance(memory, Clock):
                self.clocks.append((number, name))
            elif isinstance(memory, Fault):
                self.faults[number, name] = memory.message
        keeps = tuple((number, name) for name in block.memory)
        self.links.append(_Link(block.function, tuple(reads), writes, keeps))

    def _setup(self) -> dict[Key, Any]:
        """Values that depend on parameters alone."""
        known = dict(self.base)
        for link in self.links:
            if not link.keeps and all(key in known for key in link.reads):
                self._apply(link, known)
        return known

    @staticmethod
    def _apply(link: _Link, known: dict[Key, Any], kept: dict[Key, float] | None = None) -> None:
        result = link.function(*[known[key] for key in link.reads])
        if len(link.writes) + len(link.keeps) == 1:
            result = (result,)
        known.update(zip(link.writes, result))
        if kept is not None:
            kept.update(zip(link.keeps, result[len(link.writes) :]))

    def look(
        self, now: float, elapsed: float, begun: list[float], states: list[float], inputs: Array
    ) -> tuple[dict[Key, Any], dict[Key, float]]:
        """Go through the chain once: return all wires, and the next values of the memories."""
        known = dict(self.base)
        known.update(now=now, elapsed=elapsed, due=now + DUE * self.internal_step)
        known["input_age"] = now + elapsed - self.inputs_set
        for wire, value in zip(self.plant.inputs, inputs):
            known[wire.name] = float(value)
        for state, start, value in zip(self.plant.states, begun, states):
            known[state.name], known[f"start_{state.name}"] = value, start
        kept: dict[Key, float] = {}
        for link in self.links:
            self._apply(link, known, kept)
        return known, kept

    def keep(self, kept: Mapping[Key, float]) -> None:
        """Give the memories their new values.

        Raises:
            UserError: a fault among them.
        """
        self.base.update(kept)
        for key, message in self.faults.items():
            if self.base[key] != 0.0:
                raise UserError(message)

    def slopes(self, known: Mapping[Key, Any]) -> list[float]:
        return [known[state.rate] for state in self.plant.states]

    def outputs(self, known: Mapping[Key, Any]) -> list[float]:
        return [float(known[name]) for name in self.plant.outputs]

    def advance(self, now: float, end: float, inputs: Array) -> tuple[float, dict[Key, Any]]:
        """Advance from ``now`` to ``end`` or to the first clock before it.

        Returns that time and all wires there, before the next inputs are set.
        """
        return (self._glide if self.smooth else self._step)(now, end, inputs)

    def _step(self, now: float, end: float, inputs: Array) -> tuple[float, dict[Key, Any]]:
        begun = self.states
        known, kept = self.look(now, 0.0, begun, begun, inputs)
        self.keep(kept)
        latest = end - DUE * self.internal_step
        end = min([end, *(self.base[key] for key in self.clocks if now < self.base[key] < latest)])
        size = end - now
        first = self.slopes(known)
        middle = self._moved(begun, (0.5 * size, first))
        known, _ = self.look(now, 0.5 * size, begun, middle, inputs)
        second = self.slopes(known)
        there = self._moved(begun, (-size, first), (2.0 * size, second))
        known, _ = self.look(now, size, begun, there, inputs)
        third = self.slopes(known)
        sixth = size / 6.0
        reached = self._moved(begun, (sixth, first), (4.0 * sixth, second), (sixth, third))
        self.states = self._projected(known, reached, size)
        known, kept = self.look(now, size, self.states, self.states, inputs)
        self.keep(kept)
        return end, known

    def _glide(self, now: float, end: float, inputs: Array) -> tuple[float, dict[Key, Any]]:
        from scipy.integrate import solve_ivp

        scale = np.array([state.wire.scale for state in self.plant.states])

        def slopes(time: float, states: Array) -> list[float]:
            known, _ = self.look(time, 0.0, states.tolist(), states.tolist(), inputs)
            return self.slopes(known)

        solved = solve_ivp(
            slopes, (now, end), self.states, "DOP853", rtol=RELATIVE, atol=ABSOLUTE * scale
        )
        if not solved.success:
            raise UserError(f"solve_ivp: {solved.message}")
        self.states = solved.y[:, -1].tolist()
        return end, self.look(end, 0.0, self.states, self.states, inputs)[0]

    def _moved(self, begun: list[float], *parts: tuple[float, list[float]]) -> list[float]:
        return [
            value + sum(factor * slopes[k] for factor, slopes in parts)
            for k, value in enumerate(begun)
        ]

    def _projected(self, known: dict[Key, Any], states: list[float], size: float) -> list[float]:
        block = self.projection
        if block is None:
            return states
        names = [state.name for state in self.plant.states]
        known = {**known, **dict(zip(names, states)), "dt": size}
        known |= {name: self.base[name] for name in block.params}
        result = block.function(*[known[a] for a in inspect.signature(block.function).parameters])
        known.update(zip(block.gives, result if len(block.gives) > 1 else (result,)))
        return [known[name] for name in names]


def integrate(
    plant: Plant, values: Mapping[str, float], times: Array, inputs: Array, finer: int
) -> Course:
    """Integrate from rest.

    Args:
        plant: its declaration.
        values: every parameter by name, SI.
        times: communication points [s], shape (n,).
        inputs: shape (n, inputs), SI; each row is held from its time on.
        finer: how often memories are kept in an internal step.

    Raises:
        UserError: a fault that a block raised.
    """
    run = PlainPlant(plant, values)
    now = run.inputs_set = float(times[0])
    passed, rows = [now], [0]
    known, _ = run.look(now, 0.0, run.states, run.states, inputs[0])
    out = [run.outputs(known)]
    for k, (begin, end) in enumerate(zip(times.tolist(), times[1:].tolist())):
        parts = (
            1 if run.smooth else finer * max(1, math.ceil((end - begin) / run.internal_step - DUE))
        )
        now = run.inputs_set = begin
        for i in range(parts):
            goal = end if i + 1 == parts else begin + (end - begin) * (i + 1) / parts
            while now < goal:
                now, known = run.advance(now, goal, inputs[k])
                passed.append(now)
                out.append(run.outputs(known))
        rows.append(len(passed) - 1)
    return Course(np.array(passed), np.array(out), np.array(rows))


def _is_on(plant: Plant, owner: str, values: Mapping[str, float]) -> bool:
    switches = {
        f"{owner}.{name}" for link in plant.placements[owner] for name in link.effect.switches
    }
    return any(values[name] != 0.0 for name in switches)


def _remembers(block: Block) -> bool:
    """Whether its results depend on more than the wires of the moment."""
    reserved = any(w in RESERVED or w.startswith("start_") for w in block.wires)
    return bool(block.memory or block.queues or reserved)


def _start(start: float | str, known: Mapping[Key, Any]) -> float:
    return float(known[start] if isinstance(start, str) else start)
