"""Random parameter vectors of a variant: does a run diverge, and does it say so?

A vector changes a few, half or all of the parameters of a variant, effects included: to a
bound, or log-uniformly between the bounds.  Each is simulated over 60 communication steps with
a random command.  A run is *refused*, *told* (it has warnings of its numbers) or *quiet*.  Quiet
runs are judged by a run with 1/2 of the internal step.  Wrong is a quiet run that the half step
changes, that is not finite or goes beyond 100 full scales, and one that takes longer than 10 s.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from servo_models.analysis.simulate import Result, simulate
from servo_models.catalogue import model
from servo_models.core.block import Param
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.errors import UserError

STEPS = 60  # communication steps of a run
SMALLEST = 1e-4  # smallest magnitude that is drawn where a bound is 0 or below, of the largest
ALLOWED = 1e-3  # change with half the internal step that a quiet run may show, in full scales
BEYOND = "went beyond the range of its curve"
"""A warning that doubts no number: a curve of a residual map is held, or its ends are crossed."""
UNCHECKED = "checked against measurements"
"""Another one: an input left what a variant was checked at."""
FAR = 100.0  # full scales that no quiet run may pass
LONGEST = 10.0  # seconds of processor time that a run may take


def drawn(param: Param, rng: np.random.Generator) -> float:
    """A value of a parameter [SI]: two of five times a bound, else log-uniform between them."""
    kind = rng.integers(5)
    if kind < 2:
        return (param.low, param.high)[kind]
    largest = max(abs(param.low), abs(param.high))
    smallest = param.low if param.low > 0.0 else SMALLEST * largest
    size = float(np.exp(rng.uniform(np.log(smallest), np.log(largest))))
    sign = -1.0 if param.low < 0.0 and rng.random() < 0.5 else 1.0
    return min(max(sign * size, param.low), param.high)


def vector(chosen: Model, rng: np.random.Generator) -> dict[str, float]:
    """Changes of a model's parameters: of one to three of them, of about half, or of all."""
    parameters = chosen.plant.parameters
    names = list(parameters)
    share = rng.choice([0.0, 0.5, 1.0])
    few = set(rng.choice(names, size=rng.integers(1, 4), replace=False))
    changed = [n for n in names if n in few or rng.random() < share]
    return {n: drawn(parameters[n].param, rng) for n in changed}


def experiment(chosen: Model, rng: np.random.Generator) -> tuple[Array, dict[str, Array]]:
    """Communication points, and a command that jumps now and then, up to its standard step."""
    times = chosen.step_size * np.arange(STEPS + 1)
    name, size = chosen.actuator.step
    rest = float(chosen.plant.wire[name].rest)
    levels = np.repeat(rng.uniform(-1.0, 1.0, len(times) // 10 + 1), 10)[: len(times)]
    return times, {name: rest + levels * (size - rest)}


@dataclass
class Found:
    """What became of the vectors of one variant."""

    counts: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)


def attempted(chosen: Model, times: Array, inputs: dict[str, Array]) -> Result | None:
    try:
        return simulate(chosen, times, inputs)
    except UserError:
        return None


def change(chosen: Model, result: Result) -> float:
    """Largest change of an output that is no flag with half the internal step."""
    inputs = np.column_stack(list(result.inputs.values()))
    step = 0.5 * min(chosen.values["internal_step"], chosen.step_size)
    finer = np.array(list({**chosen.values, "internal_step": step}.values()))
    try:
        other = chosen.from_rest(finer, result.times, inputs)
    except UserError:
        return np.inf
    wires = [chosen.plant.wire[name] for name in chosen.plant.outputs]
    gaps = [
        np.abs(result[wire.name] - column).max() / wire.scale
        for wire, column in zip(wires, other.T)
        if not wire.flag
    ]
    return float(max(gaps))


def judged(chosen: Model, rng: np.random.Generator, found: Found) -> None:
    """Simulate one vector and count what became of it."""
    changes = vector(chosen, rng)
    tried = model(chosen.actuator.name, chosen.variant, changes)
    times, inputs = experiment(tried, rng)
    begin = time.process_time()
    result = attempted(tried, times, inputs)
    took = time.process_time() - begin
    if took > LONGEST:
        found.wrong.append(f"{took:.0f} s: {changes}")
    if result is None:
        found.counts["refused"] += 1
        return
    if not all(np.isfinite(result[name]).all() for name in result.outputs):
        found.wrong.append(f"not finite: {changes}")
    known = (BEYOND, UNCHECKED)
    if not all(any(it in text for it in known) for text in result.warnings):
        found.counts["told"] += 1
        return
    found.counts["quiet"] += 1
    wires = [tried.plant.wire[name] for name in result.outputs]
    if any(np.abs(result[wire.name]).max() > FAR * wire.scale for wire in wires):
        found.wrong.append(f"silently far: {changes}")
    if change(tried, result) > ALLOWED:
        found.wrong.append(f"silently rough: {changes}")
