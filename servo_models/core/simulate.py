"""Simulate an actuator in this process, on any grid of communication points.

The same text runs here as C, or through numba, and in the FMU as plain Python, on the same grid, so
all agree to the last bit.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import RLock
from typing import Any

import numpy as np

from servo_models.core.bounds import is_outside, outside
from servo_models.core.compiled import compiled_run, plain_make
from servo_models.core.flat import Flat, neutral_effects, trouble
from servo_models.core.flatten import flatten
from servo_models.core.plant import Actuator, Plant, Wire
from servo_models.core.printer import FURTHEST
from servo_models.core.stepper import run_text, start_text, step_text
from servo_models.core.types import Array
from servo_models.errors import UserError

LONGEST_RUN = 1e8  # internal steps of a run, some ten seconds of work: more is a wrong unit
MOST_TRIED = 10  # changed parameters of a failed run that are put back one by one, at most
PLANTS = 64  # plants whose texts are kept, the latest ones: a person's own come and go
ANGLES = ("shaft_angle", "load_angle", "coasting_angle")
SPEEDS = ("shaft_speed", "load_speed", "coasting_speed")
"""States of the motion of a shaft and of what turns with it, as ``actuators/shaft.py`` and the
effects ``gear_compliance`` and ``coasting_backlash`` name them."""


_PARSING = RLock()  # CPython 3.11 may fail where two threads make syntax trees at once


@functools.lru_cache(maxsize=PLANTS)
def flat_of(plant: Plant, name: str) -> Flat:
    """Return the flattened plant; flattening is done once per plant and process."""
    with _PARSING:
        return flatten(plant, name)


@functools.lru_cache(maxsize=PLANTS)
def _compiled(plant: Plant, name: str) -> Callable[..., Any]:
    with _PARSING:
        return compiled_run(run_text(flat_of(plant, name)))


@functools.lru_cache(maxsize=PLANTS)
def _starter(plant: Plant, name: str) -> Callable[..., Any]:
    return plain_make(start_text(flat_of(plant, name)))


@dataclass(frozen=True)
class Shaft:
    """Where the motion of a plant's shaft stands.

    Attributes:
        angle, rate: names of these outputs; a linear drive has a position and a speed.
        angles, speeds: their places in the state vector, and those of a second mass behind it.
        rate_over_speed: rate of the output [SI] over the speed that is the state.
        carried: places of states that hold what went before, by name, such as an integral part.
    """

    angle: str
    rate: str
    angles: tuple[int, ...]
    speeds: tuple[int, ...]
    rate_over_speed: float
    carried: Mapping[str, int]

    def place(self, state: Array, motion: Mapping[str, float]) -> None:
        """Put the shaft of a state to an angle and a rate [SI], by the names of the outputs.

        States that are carried are put to values of their own names.
        """
        if self.angle in motion:
            state[list(self.angles)] = motion[self.angle]
        if self.rate in motion:
            state[list(self.speeds)] = motion[self.rate] / self.rate_over_speed
        for name in self.carried.keys() & motion.keys():
            state[self.carried[name]] = motion[name]


@dataclass(frozen=True, repr=False)
class Model:
    """An actuator with all parameters chosen: what a simulation and an FMU are made of.

    Attributes:
        actuator, variant: actuator and name of the variant that it is made from.
        values: every parameter in SI by name, in the order of the parameter vector.
        provenance: origin of values that are not the variant's own, in words.
    """

    actuator: Actuator
    variant: str
    values: dict[str, float]
    flat: Flat = field(repr=False)
    provenance: str = ""

    def __repr__(self) -> str:
        nominal = self.actuator.values(self.variant)
        changed = sum(value != nominal[name] for name, value in self.values.items())
        return f"<Model of {self.actuator.name}, variant {self.variant}: {changed} values changed>"

    @cached_property
    def plant(self) -> Plant:
        return self.actuator.plant_of(self.variant)

    @property
    def stop_time(self) -> float:
        """End of the default experiment [s]."""
        return self.actuator.variant(self.variant).stop_time or self.actuator.stop_time

    @property
    def step_size(self) -> float:
        """Communication step of the default experiment [s]."""
        return self.actuator.variant(self.variant).step_size or self.actuator.step_size

    @property
    def step(self) -> tuple[str, float]:
        """Command of the variant and its value [SI] in the standard step."""
        return self.actuator.step_of(self.variant)

    @property
    def warning(self) -> str:
        """What is wrong with the variant's values, "" for nothing and for values not its own."""
        return "" if self.provenance else self.actuator.variant(self.variant).warning

    @property
    def vector(self) -> Array:
        """Parameter vector in the order of ``values``, SI."""
        return np.array(list(self.values.values()))

    def stepper(self) -> tuple[Callable[[], list[float]], Callable[..., Any]]:
        """Plain-Python ``start()`` and ``step(x, u, t, size)``; see ``stepper.step_text``."""
        values = list(self.values.values())
        text = step_text(self.flat, neutral_effects(self.flat, values))
        start, step = plain_make(text)(values)
        return start, step

    def start(self) -> Array:
        """State at rest, shape (flat.size,)."""
        return self.at_rest(self.vector)

    def at_rest(self, vector: Array) -> Array:
        """State at rest with a parameter vector [SI], shape (flat.size,)."""
        begin = _starter(self.plant, self.actuator.name)(vector.tolist())
        state = np.zeros(self.flat.size)
        state[: len(begin)] = begin
        return state

    def run(self, times: Array, inputs: Array, state: Array | None = None) -> Array:
        """Return the outputs, shape (n, outputs), for inputs of shape (n, inputs), SI.

        ``state`` is advanced in place; without it the run begins at rest.

        Raises:
            UserError: times that run backward, inputs that are not finite, or a run that
                leaves the finite numbers.
        """
        check_grid(times, inputs, self.plant.inputs, self.values["internal_step"])
        x = self.start() if state is None else state
        begin = x.copy()
        try:
            return self.ran(self.vector, x, times, inputs)
        except UserError as error:
            raise UserError(f"{error}{self._responsible(begin, times, inputs)}") from None

    def from_rest(
        self, vector: Array, times: Array, inputs: Array, most: float = math.inf
    ) -> Array:
        """Return ``run`` from rest with another parameter vector [SI], in the order of ``values``.

        Hundreds of simulations share an experiment, which has to have passed ``check_grid``.
        """
        return self.ran(vector, self.at_rest(vector), times, inputs, most)

    @cached_property
    def shaft(self) -> Shaft | None:
        """Where a run may put the shaft; None for a plant without the states of ``shaft.py``."""
        states = {state.name: place for place, state in enumerate(self.plant.states)}
        ends = [it for it in self.plant.terminals.get("shaft", ()) if it in self.plant.outputs]
        if len(ends) != 2 or ANGLES[0] not in states or SPEEDS[0] not in states:
            return None
        angles, speeds = (
            tuple(states[name] for name in names if name in states) for names in (ANGLES, SPEEDS)
        )
        ratio = self._rate_at(speeds[0], 1.0, ends[1]) - self._rate_at(speeds[0], 0.0, ends[1])
        carried = {it.name: states[it.name] for it in self.plant.states if it.carried}
        return Shaft(ends[0], ends[1], angles, speeds, ratio, carried)

    def _rate_at(self, place: int, speed: float, output: str) -> float:
        """An output [SI] at a speed of the shaft, with every effect off."""
        off = {switch for names in self.flat.switches.values() for switch in names}
        plain = [0.0 if name in off else v for name, v in zip(self.flat.params, self.vector)]
        vector = np.array(plain)
        state = self.at_rest(vector)
        state[place] = speed
        rest = np.array([[float(wire.rest) for wire in self.plant.inputs]])
        row = self.ran(vector, state, np.zeros(1), rest)[0]
        return float(row[self.plant.outputs.index(output)])

    def ran(
        self,
        vector: Array,
        state: Array,
        times: Array,
        inputs: Array,
        most: float = math.inf,
    ) -> Array:
        """Return ``run`` with another parameter vector [SI]; ``state`` is advanced in place.

        Raises:
            UserError: see ``run``; also a run of more than ``most`` sub-steps.
        """

        def run(state: Array, times: Array, inputs: Array, most: float = math.inf) -> Array:
            return self._ran(vector, state, times, inputs, most)[0]

        if self.actuator.inner is None:
            return run(state, times, inputs, most)
        # a plant around it is run at its steps, of which there are any number between two rows
        values = dict(zip(self.values, vector.tolist()))
        return np.asarray(self.actuator.inner.ran(run, values, state, times, inputs))

    def substeps(self, vector: Array, times: Array, inputs: Array) -> int:
        """Return how many sub-steps ``from_rest`` makes."""
        return self._ran(vector, self.at_rest(vector), times, inputs, math.inf)[1]

    def _ran(
        self, vector: Array, state: Array, times: Array, inputs: Array, most: float
    ) -> tuple[Array, int]:
        out = np.empty((len(times), len(self.plant.outputs)))
        run = _compiled(self.plant, self.actuator.name)
        given = (np.ascontiguousarray(it, dtype=float) for it in (vector, times, inputs))
        parameters, grid, columns = given
        code, row = run(parameters, state, grid, columns, out, most)
        if code:
            raise UserError(f"{trouble(self.flat, code, state.tolist())}, at t = {times[row]:g} s")
        return out, row

    def _responsible(self, begin: Array, times: Array, inputs: Array) -> str:
        """Clause about each changed parameter without which a run that fails would succeed."""
        nominal = self.actuator.values(self.variant)
        changed = [name for name, value in self.values.items() if value != nominal[name]]
        blamed = []
        for name in changed if len(changed) <= MOST_TRIED else ():
            vector = np.array(list({**self.values, name: nominal[name]}.values()))
            with contextlib.suppress(UserError):
                self.ran(vector, begin.copy(), times, inputs)
                unit = self.plant.parameters[name].param.unit
                instead = f"{nominal[name]:g} {unit}".removesuffix(" 1")
                blamed.append(f"with '{name}' = {instead} instead of {self.values[name]:g} it runs")
        return f" ({'; '.join(blamed)})" if blamed else ""


def with_output(chosen: Model, wire: str) -> Model:
    """Return the same model with an inner wire among its outputs."""
    if wire in chosen.plant.outputs:
        return chosen
    plant = replace(chosen.plant, outputs=(*chosen.plant.outputs, wire))
    variant = replace(chosen.actuator.variant(chosen.variant), plant=plant)
    actuator = replace(chosen.actuator, plant=plant, variants=(variant,))
    return replace(chosen, actuator=actuator, flat=flat_of(plant, actuator.name))


def of_named(chosen: Model, names: Set[str]) -> Model:
    """Return the same model without outputs of a simulation that is not ours, and effects on its
    commands, of which nothing is named, nor a value changed: each that is read costs time, and a
    command that nobody gives has no offset."""
    if not chosen.actuator.inner:
        return chosen
    less = chosen.actuator.inner.only(frozenset(names))
    nominal, plant = chosen.actuator.values(chosen.variant), less.plant
    needed = names | {name for name, value in chosen.values.items() if value != nominal[name]}
    if not needed <= {*plant.wire, *plant.parameters, *plant.placements}:
        return chosen
    values = {name: chosen.values[name] for name in less.values(chosen.variant)}
    return replace(chosen, actuator=less, values=values, flat=flat_of(plant, less.name))


def check_grid(times: Array, inputs: Array, wires: Sequence[Wire], internal_step: float) -> None:
    """Check what a run begins with: times of shape (n,), inputs of shape (n, inputs) in SI.

    Raises:
        UserError: no times, times that run backward or last too long for the internal step [s],
            inputs outside their bounds or not finite.
    """
    if len(times) == 0:
        raise UserError("no communication points: give at least one time")
    if not np.all(np.isfinite(times)):
        row = int(np.argmin(np.isfinite(times)))
        raise UserError(f"time in row {row} is not finite: remove that row")
    backward = np.flatnonzero(np.diff(times) < 0.0)
    if len(backward):
        row = int(backward[0]) + 1
        raise UserError(
            f"time runs backward in row {row} ({times[row - 1]:g} s, then {times[row]:g} s):"
            " sort the rows by time"
        )
    lasts = float(times[-1]) - float(times[0])
    if lasts > LONGEST_RUN * internal_step:
        row = int(np.argmax(np.diff(times)))
        raise UserError(
            f"the times last {lasts:.3g} s, {lasts / internal_step:.2g} internal steps, more than"
            f" {LONGEST_RUN:.0e}; the largest step, {times[row + 1] - times[row]:.3g} s, follows"
            f" row {row}: correct the unit or that row, or choose a longer internal_step"
        )
    furthest = FURTHEST * internal_step
    if max(abs(float(times[0])), abs(float(times[-1]))) > furthest:
        raise UserError(
            f"the times, {times[0]:g} to {times[-1]:g} s, lie more than {furthest:.3g} s from 0,"
            " where numbers are too coarse for the internal step: subtract the first one"
        )
    for wire, column in zip(wires, inputs.T):
        bad = np.flatnonzero(is_outside(column, wire) | ~np.isfinite(column))
        if len(bad) and not math.isfinite(column[bad[0]]):
            raise UserError(f"input '{wire.name}' in row {bad[0]} is not finite: fill or drop it")
        if len(bad):
            message = outside("input", wire.name, float(column[bad[0]]), wire)
            raise UserError(f"{message} (row {bad[0]})")
