"""Sane logs of every actuator, and the same with one column in a unit that is not the one told."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuators, model
from servo_models.core.bounds import is_outside
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.description import Description
from servo_models.data.log import Channel, Log
from servo_models.data.schema import Section
from servo_models.identification.plausibility import implausible, implausible_clocks
from servo_models.identification.problem import free_parameter
from servo_models.units import WRITTEN_IN, factor
from tests.support.logs import log_of

ROWS = 400
ANSWERS = 12.0  # length of a log in answers to a step of the actuator
NOISE = 0.01  # of the full range
TRUE_TO = 0.2  # relative deviation of the rig's parameters from the nominal ones
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6}


@dataclass(frozen=True)
class Misread:
    """``signal`` is written in ``written`` and described as being in ``told``."""

    signal: str
    written: str
    told: str

    @property
    def ratio(self) -> float:
        return factor(self.told, self.written)


def answer(chosen: Model) -> float:
    """Time [s] of the standard step from 0 to 90 %."""
    name, size = chosen.actuator.step
    times = np.linspace(0.0, chosen.stop_time, 2001)
    response = simulate(chosen, times, {name: size})[chosen.plant.outputs[0]]
    return float(times[np.argmax(np.abs(response - response[0]) > 0.9 * np.ptp(response))])


def rig(chosen: Model, random: np.random.Generator) -> Model:
    """A servo that is not quite the nominal one."""
    known = chosen.plant.parameters
    values = dict(chosen.values)
    for name in chosen.actuator.variant(chosen.variant).uncertainty:
        free = free_parameter(known[name], values[name], None)
        drawn = values[name] * (1.0 + TRUE_TO * random.uniform(-1.0, 1.0))
        values[name] = min(max(drawn, free.low), free.high)
    return replace(chosen, values=values)


def command(chosen: Model, times: Array, random: np.random.Generator) -> Array:
    """Steps of many sizes, or sines of several frequencies, of up to the standard step."""
    name, size = chosen.actuator.step
    rest = float(chosen.plant.wire[name].rest)
    reach = (size - rest) * random.uniform(0.3, 1.0)
    if random.random() < 0.5:
        levels = random.uniform(-1.0, 1.0, 8)
        shape = levels[np.minimum((8.0 * times / times[-1]).astype(int), 7)]
        shape[times < times[-1] / 8.0] = 0.0
    else:
        waves = random.uniform(0.5, 3.0, 3) * 2.0 * np.pi / times[-1]
        shape = np.sin(np.outer(times, waves)).mean(axis=1)
    return np.asarray(rest + reach * shape)


def sane(name: str, variant: str, seed: int) -> tuple[Model, Log]:
    """A log of a rig near this variant, all signals logged in SI, and the nominal model."""
    random = np.random.default_rng(seed)
    chosen = model(name, variant)
    true = rig(chosen, random)
    times = np.linspace(0.0, ANSWERS * answer(chosen), ROWS)
    main, _ = chosen.actuator.step
    inputs = {main: command(chosen, times, random)}
    for wire in chosen.plant.inputs:
        if wire.name != main and not wire.flag and wire.rest:
            ripple = 0.02 * random.standard_normal(ROWS)
            inputs[wire.name] = float(wire.rest) * (1.0 + ripple)
    response = simulate(true, times, inputs)
    outputs = {}
    for output in chosen.plant.outputs:
        if chosen.plant.wire[output].flag or not np.ptp(response[output]):
            continue
        noise = NOISE * np.ptp(response[output]) * random.standard_normal(ROWS)
        outputs[output] = response[output] + noise
    wires = {wire: chosen.plant.wire[wire] for wire in (*inputs, *outputs)}
    channels = {wire: Channel(wire, f"c_{wire}", wires[wire].unit) for wire in wires}
    channels["time"] = Channel("time", "c_time", "s")
    return chosen, log_of(times, inputs, outputs, channels=channels)


def with_outputs(log: Log, names: list[str]) -> Log:
    """The log with these outputs only."""
    return replace(log, outputs={name: log.outputs[name] for name in names})


def misread(log: Log, wrong: Misread) -> Log:
    """The log as a description with the wrong unit makes it."""
    channel = replace(log.channels[wrong.signal], unit=wrong.told)
    channels = {**log.channels, wrong.signal: channel}
    if wrong.signal == "time":
        return replace(log, times=wrong.ratio * log.times, channels=channels)
    inputs, outputs = dict(log.inputs), dict(log.outputs)
    for values in (inputs, outputs):
        if wrong.signal in values:
            values[wrong.signal] = wrong.ratio * values[wrong.signal]
    return replace(log, inputs=inputs, outputs=outputs, channels=channels)


def mistakes(chosen: Model, log: Log) -> Iterator[Misread]:
    """Every way to mistake the unit of one column, to and fro."""
    for signal in (*log.inputs, *log.outputs):
        unit = chosen.plant.wire[signal].unit
        for other in WRITTEN_IN.get(unit, ()):
            if other != unit:
                yield Misread(signal, other, unit)
                yield Misread(signal, unit, other)
    for other in ("ms", "us"):
        yield Misread("time", other, "s")
        yield Misread("time", "s", other)


def described(chosen: Model, log: Log) -> Description:
    """A description of that log alone."""
    document = Section(Path("rig.toml"), "", {})
    return Description(Path("rig.toml"), document, chosen, {}, {}, (log,))


def subjects() -> list[tuple[str, str]]:
    """Every variant that settles."""
    return [
        (a.name, v.name)
        for a in actuators().values()
        for v in a.variants
        if v.name != "oscillatory_motor"
    ]


def names(said: str, signal: str, unit: str) -> bool:
    """Whether a text names the column of ``plausible_logs`` and the unit that it is in."""
    return f"'c_{signal}'" in said and (f'"{unit}"' in said or f"read in {unit} it" in said)


def doubts(chosen: Model, log: Log) -> tuple[str, ...]:
    """What ``check`` says of a log's units; it simulates nothing where the time makes no sense."""
    told = described(chosen, log)
    return implausible_clocks(told) or implausible(told)


def is_refused(chosen: Model, log: Log) -> bool:
    """Whether a description of it is refused, which names the row and the bounds."""
    wires = chosen.plant.wire
    return any(is_outside(values, wires[name]).any() for name, values in log.inputs.items())
