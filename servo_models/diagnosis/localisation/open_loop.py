"""Each block judged alone: an output simulated from the other outputs as they were measured.

A logged wire inside the actuator is handed to the blocks behind it as it was measured, so
errors do not travel from block to block, nor around the loop.  What an integrator makes of
such a wire drifts with the smallest offset; there only the error beside a straight line in
each block of time counts.
Source: Ljung, System Identification, 2nd ed., sec. 13.4 (direct approach in closed loop).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from servo_models.core.block import Block, Param, effect
from servo_models.core.plant import Placement, Plant, Wire, place
from servo_models.core.simulate import PLANTS, Model, flat_of
from servo_models.core.types import Array
from servo_models.diagnosis.localisation.breakdown import WORSE, Breakdown, Sums, tabulate
from servo_models.diagnosis.search.crossval import BLOCKS
from servo_models.diagnosis.search.selection import Selection
from servo_models.errors import UserError
from servo_models.identification.simulation import Run, at_readings

MOMENTS = (0.0, 0.5, 1.0)  # parts of an interval after which a held wire is read; the best counts
OFFSET = 0.01  # offset of measured wires over their range by which a drift is found out
DRIFTS = 1.5  # effect of an offset in the second half of a log over the first, if it drifts


@effect("signal", source="the log")
def replaced(
    signal: float,
    measured: float,
    on: Annotated[float, Param("1", "1 to take the wire as measured", switch=True)],
) -> float:
    """The wire as it was measured."""
    return measured


@functools.lru_cache(maxsize=PLANTS)
def opened(plant: Plant, names: tuple[str, ...]) -> Plant:
    """Return a plant with a switch on each wire by which what is behind takes it as measured.

    A switch is the parameter ``<measured>.on``, the measured wire one more input ``<measured>``.
    """
    chain, inputs = list(plant.chain), list(plant.inputs)
    for name in names:
        wire, measured = plant.wire[name], measured_name(plant, name)
        at = 1 + max((i for i, link in enumerate(chain) if name in _writes(link)), default=-1)
        chain.insert(at, place(measured, replaced, name, measured=measured))
        inputs.append(Wire(measured, wire.unit, wire.about, wire.scale, wire.rest))
    return replace(plant, inputs=tuple(inputs), chain=tuple(chain))


def measured_name(plant: Plant, wire: str) -> str:
    """Return what a wire as it was measured is called: nothing of the plant has that name."""
    taken = {*plant.wire, *plant.placements, *plant.parameters}
    taken.update(*map(_writes, plant.chain))
    name = f"measured_{wire}"
    while name in taken:
        name += "_too"
    return name


def led_on(plant: Plant, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return those wires of ``names`` that blocks behind them read."""
    chain = opened(plant, names).chain
    at = {link.name: i for i, link in enumerate(chain) if isinstance(link, Placement)}
    behind = {name: chain[at[measured_name(plant, name)] + 1 :] for name in names}
    rates = {state.rate for state in plant.states}
    return tuple(
        name for name in names if name in rates or any(_reads(link, name) for link in behind[name])
    )


def by_block(selection: Selection) -> Breakdown | None:
    """Shares of outputs that are simulated from the others as measured, None without any."""
    problem = selection.taken.problem
    names = tuple(problem.sigma)
    led = led_on(problem.model.plant, names)
    sums = np.zeros((4, len(names)))
    labels = []
    for k, name in enumerate(names):
        others = tuple(other for other in led if other != name)
        labels.append(f"{name} from measured {' and '.join(others)}")
        for run in problem.runs:
            if others and {name, *others} <= run.log.outputs.keys():
                fitter = _Bench(run, led, others, name, problem.sigma[name])
                with suppress(UserError):  # a block that runs away with what was measured
                    sums[:, k] += fitter.sums(selection.taken.values)
    before, after, amplitude, weight = sums
    if not weight.any():
        return None
    worse = after > WORSE**2 * np.maximum(before, weight)
    edges = [(label, np.nan, np.nan) for label in labels]
    return tabulate("block", "", edges, Sums(before, after, amplitude, weight, worse), "in ")


@dataclass(frozen=True, eq=False)
class _Bench:
    """One output of one log, simulated from ``others`` as measured; ``led`` can be switched."""

    run: Run
    led: tuple[str, ...]
    others: tuple[str, ...]
    name: str
    sigma: float

    def sums(self, values: Mapping[str, float]) -> Array:
        """Squares before, after, of the amplitude, and their number; shape (4,)."""
        log = self.run.log
        if not log.fitted.any():
            return np.zeros(4)
        first = MOMENTS[0]
        moved = self._simulated(values, first, OFFSET) - self._simulated(values, first)
        drifting = _drifts(moved)
        before, after = (self._least(it, drifting) for it in ({}, values))
        seen = log.outputs[self.name][log.fitted]
        deviation = (seen - seen.mean()) / self.sigma
        return np.array([before, after, deviation @ deviation, len(seen)])

    def _least(self, values: Mapping[str, float], drifting: bool) -> float:
        """Squares that a model leaves at the moment that suits it best."""
        log, squares = self.run.log, []
        for moment in MOMENTS:  # of a clock, of a smooth signal, of what was held until its row
            error = self._simulated(values, moment) - log.outputs[self.name]
            if drifting:
                error = _beside_lines(error)
            seen = error[log.fitted] / self.sigma
            squares.append(float(seen @ seen))
        return min(squares)

    def _simulated(self, values: Mapping[str, float], moment: float, offset: float = 0.0) -> Array:
        """The output with these parameters, measured wires shifted by a part of their range."""
        run, log, model = self.run, self.run.log, self.run.model
        plant = opened(model.plant, self.led)
        variant = replace(model.actuator.variant(model.variant), plant=plant)
        actuator = replace(model.actuator, plant=plant, variants=(variant,))
        switches = {
            f"{measured_name(model.plant, name)}.on": float(name in self.others)
            for name in self.led
        }
        known = {**run.with_constants(values), **switches}
        chosen = Model(
            actuator,
            variant.name,
            {name: known[name] for name in plant.parameters},
            flat_of(plant, actuator.name),
        )
        wires = np.zeros((len(log.times), len(self.led)))
        for i, name in enumerate(self.led):
            if name in self.others:
                now = log.outputs[name]
                following = np.append(now[1:], now[-1])
                wires[:, i] = now + moment * (following - now) + offset * np.ptp(now)
        if len(run.times) > len(wires):
            wires = np.vstack([wires[:1], wires])
        given, after = np.column_stack([run.inputs, wires]), log.after_command(plant.outputs)
        out = at_readings(chosen.run, run.times, given, after)
        return np.asarray(out[-len(log.times) :, plant.outputs.index(self.name)])


def _writes(link: Block | Placement) -> tuple[str, ...]:
    return link.on if isinstance(link, Placement) else link.gives


def _reads(link: Block | Placement, wire: str) -> bool:
    if isinstance(link, Placement):
        return wire in (link.wire_of(argument) for argument in link.effect.wires)
    return wire in link.wires


def _drifts(moved: Array) -> bool:
    """Whether an offset of the measured wires moves the output further and further."""
    first, second = np.array_split(moved**2, 2)
    return float(np.mean(second)) > DRIFTS**2 * float(np.mean(first))


def _beside_lines(error: Array) -> Array:
    """An error without the straight line that fits it best in each block of time."""
    pieces = []
    for piece in np.array_split(error, BLOCKS):
        count = np.arange(float(len(piece)))
        base = np.column_stack([np.ones(len(piece)), count])
        pieces.append(piece - base @ np.linalg.lstsq(base, piece, rcond=None)[0])
    return np.concatenate(pieces)
