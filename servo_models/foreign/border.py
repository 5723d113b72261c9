"""The plant around a box: effects on what it is sent and on what is read."""

from __future__ import annotations

import copy
import functools
from collections.abc import Set
from dataclasses import replace
from pathlib import Path

import numpy as np

from servo_models.actuators.wiring import input_scale, outside_sensor
from servo_models.core.block import Block, Param
from servo_models.core.own_actuator import executed
from servo_models.core.plant import (
    STEP_IN_SCALES,
    Actuator,
    Placement,
    Plant,
    State,
    Variant,
    Wire,
    internal_step,
)
from servo_models.effects import effects_on
from servo_models.errors import UserError
from servo_models.foreign.box import Around, Box, Signal

COMMAND = (
    "transport_delay",
    "command_lag",
    "sample_hold",
    "dead_band",
    "command_quantisation",
    "command_offset",
    "command_saturation",
    "rate_limit",
    "motion_profile",
)
"""Effects on a command, in the order in which they act."""
LOADS = ("N.m", "N")  # units of inputs that are no commands
DISPLAY = {"rad": "deg", "rad/s": "deg/s"}
RANGE = 10.0  # start values to either side up to which a parameter without bounds may go
FASTEST = 100.0  # full scales a second that hardly any actuator moves
SETTLED = 0.02  # of a step
SETTLING_TIMES = 3.0  # full scale of time
ROWS = 501  # of a step
PASSED = '''
from servo_models.core.block import block

@block("{given}")
def pass_{given}({taken}: float) -> float:
    """What it is, unless an effect changes it."""
    return {taken}

PASSED = pass_{given}
'''


def actuator_around(
    box: Box, file: Path, settled: float = 0.0, idle: Set[str] = frozenset()
) -> Actuator:
    """Return the actuator of a box, which ``file`` calls, and the effects around it.

    ``settled`` [s] is its settling time, where that is known; ``idle`` are inputs that nobody
    gives: a command among them has no effects.

    Raises:
        ValueError: a signal or a parameter has a name that none can have.
    """
    settled = settled or settling_time(box)

    def only(names: frozenset[str]) -> Actuator:
        less = copy.copy(box)
        less.outputs = (box.outputs[0], *(it for it in box.outputs[1:] if it.name in names))
        return actuator_around(less, file, settled, {it.name for it in box.inputs} - names)

    plant = Plant(
        inputs=(
            *map(_wire, box.inputs),
            *(replace(_wire(one, f"simulated_{one.name}"), inner=True) for one in box.outputs),
            *(replace(_rate(one, f"simulated_{one.name}_rate"), inner=True) for one in box.outputs),
        ),
        wires=(
            *map(_wire, box.outputs),
            *(_rate(one, f"{one.name}_rate") for one in box.outputs),
            *(_wire(one, f"sent_{one.name}") for one in box.inputs),
        ),
        chain=(*_sent(box.inputs, idle), *_read(box.outputs)),
        states=tuple(_total(one) for one in box.inputs),
        outputs=(
            *(it.name for it in box.outputs),
            *(f"sent_{it.name}" for it in box.inputs),
            *(f"total_{it.name}" for it in box.inputs),
        ),
        constants={
            **internal_step(box.step, high=0.1),
            **{it.name: _param(it) for it in box.parameters},
        },
        time_scale=SETTLING_TIMES * settled,
    )
    command = box.inputs[0]
    return Actuator(
        name=box.name,
        title=box.title,
        about="a simulation that is not ours, with effects before and behind it",
        source="the file that was given",
        plant=plant,
        variants=(Variant("given", "as the file has it", {}, "the file"),),
        stop_time=box.stop_time,
        step_size=box.step,
        step=(command.name, command.rest + STEP_IN_SCALES * command.size),
        file=file,
        inner=Around(box, functools.cache(only)),
    )


def settling_time(box: Box) -> float:
    """Return how long a step of the command takes to settle [s], or as long as it is looked at."""
    times = np.linspace(0.0, box.stop_time, ROWS)
    inputs = np.tile([it.rest for it in box.inputs], (ROWS, 1))
    inputs[:, 0] += STEP_IN_SCALES * box.inputs[0].size
    try:
        out = box.run({it.name: it.size for it in box.parameters}, times, inputs)[:, 0]
    except UserError:  # whoever simulates it is told
        return box.stop_time
    away = np.abs(out - out[-1]) > SETTLED * np.abs(out - out[-1]).max()
    return float(times[np.flatnonzero(away)[-1] + 1]) if away.any() else box.stop_time


def _sent(inputs: tuple[Signal, ...], idle: Set[str]) -> tuple[Block | Placement, ...]:
    found: list[Block | Placement] = []
    commands = [one.name for one in inputs if one.unit not in LOADS]
    for name in (it for it in commands if it not in idle):
        prefix = f"{name}_" if len(commands) > 1 else ""
        found.append(input_scale(f"{prefix}command_gain", name))
        found += effects_on(name, *(f"{prefix}{effect}" for effect in COMMAND))
    for one in inputs:
        found += effects_on(one.name, f"{one.name}_offset") if one.unit in LOADS else ()
        found.append(_passed(f"sent_{one.name}", one.name))
    return tuple(found)


def _read(outputs: tuple[Signal, ...]) -> tuple[Block | Placement, ...]:
    found: list[Block | Placement] = []
    for one in outputs:
        rate = f"{one.name}_rate"
        found += [_passed(one.name, f"simulated_{one.name}"), _passed(rate, f"simulated_{rate}")]
    first, *others = (one.name for one in outputs)
    found += effects_on((first, f"{first}_rate"), "backlash")
    found += effects_on(first, "hysteresis", "sensor_nonlinearity")
    for prefix, name in (("sensor", first), *((other, other) for other in others)):
        found += outside_sensor(prefix, name)
    return tuple(found)


def _passed(given: str, taken: str) -> Block:
    """A block that gives a wire what another one has; its text is what is printed."""
    module = executed(PASSED.format(given=given, taken=taken), f"<{given} around a box>")
    found: Block = module.PASSED
    return found


def _wire(one: Signal, name: str = "") -> Wire:
    about = one.about or one.name.replace("_", " ")
    return Wire(
        name or one.name, one.unit, about, one.size, one.rest, display=DISPLAY.get(one.unit)
    )


def _total(one: Signal) -> State:
    """What is sent, integrated: its mean over an interval is exact, wherever it jumps in there."""
    unit = "s" if one.unit == "1" else f"{one.unit}.s"
    return State(
        Wire(f"total_{one.name}", unit, f"{one.name} in all", one.size), f"sent_{one.name}"
    )


def _rate(one: Signal, name: str) -> Wire:
    unit = "1/s" if one.unit == "1" else f"{one.unit}/s"
    return Wire(name, unit, f"rate of {one.name}", FASTEST * one.size)


def _param(one: Signal) -> Param:
    reach = RANGE * (abs(one.size) or 1.0)
    low, high = max(one.low, min(one.size, 0.0) - reach), min(one.high, max(one.size, 0.0) + reach)
    if one.size > 0.0 and one.low < 0.0:
        low = 0.0  # of one sign, as far as is known
    return Param(one.unit, one.about or one.name, one.size, low, high)
