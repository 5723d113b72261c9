"""An actuator as a simulator sees it: a goal angle and a load in, an angle out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.analysis.simulate import simulate
from servo_models.core.block import Block
from servo_models.core.plant import Wire
from servo_models.core.simulate import Model, with_output
from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.effects import effects
from servo_models.errors import UserError
from servo_models.identification.simulation import prepared
from servo_models.simulators.simulator import EXACT, NO_FIELD, OF_JOINTS

INERTIA = "shaft_inertia"  # wire of every plant with a shaft, see ``actuators/shaft.py``
LOAD = "load"  # wire of every plant with a shaft
SMALL_STEP = 0.1  # small step over the standard step
SWEEP_PERIODS = 8.0  # periods of the sweep
LOAD_SHARE = 0.2  # load over its full scale
LONGEST_STEP_S = 0.005  # longest communication step


@dataclass(frozen=True)
class Run:
    """A run of an actuator.

    Attributes:
        name: of the log, "" for the standard excitation.
        times: rows [s], shape (n,).
        goal, load: angle [rad] and torque against positive motion [N m], held from each row on.
        angle: of the diagnosed model [rad] at each row.
        counted: rows that a fit and a score see.
        measured, nominal: angles [rad] that the log has and the nominal model gives; None without.
    """

    name: str
    times: Array
    goal: Array
    load: Array
    angle: Array
    counted: Mask
    measured: Array | None = None
    nominal: Array | None = None


@dataclass(frozen=True)
class Servo:
    """A model with its command and angle.

    Attributes:
        model: diagnosed.
        command: the input that it follows.
        angle: the output.
        slope, zero: constants of goal [rad] = slope (command - zero).
        inertia: of all that turns [kg m^2].
    """

    model: Model
    command: Wire
    angle: str
    slope: float
    zero: float
    inertia: float

    def goal(self, command: Array) -> Array:
        """Return the goal angle [rad] of a command [SI]."""
        return np.asarray(self.slope * (command - self.zero))

    def active(self) -> dict[str, str]:
        """Return the catalogue's name of each effect that is on, by the name of its place."""
        plant, values = self.model.plant, self.model.values
        on = [it for it in plant.placements if any(values[n] for n in _switches(self.model, it))]
        return {name: _catalogued(plant.main(name).effect) for name in on}

    def loads(self) -> Model:
        """Return the model whose wire ``load`` is the load of other bodies on a joint."""
        plant = self.model.plant
        off = {
            switch: 0.0
            for name, effect in self.active().items()
            if any(LOAD in link.on for link in plant.placements[name])
            and OF_JOINTS.get(effect, NO_FIELD).degree != EXACT
            for switch in _switches(self.model, name)
        }
        return with_output(replace(self.model, values={**self.model.values, **off}), LOAD)


def _catalogued(effect: Block) -> str:
    """The catalogue's name of an effect; for an effect of the user its own name."""
    return next((name for name, blocks in effects().items() if effect in blocks), effect.name)


def _switches(model: Model, place: str) -> list[str]:
    """Names of the parameters that are all 0 where an effect is off."""
    known = dict(zip(model.flat.params, model.values))
    return [known[text] for text in model.flat.switches.get(place, ())]


def servo_of(model: Model, logged: Sequence[Log] = ()) -> Servo:
    """Return a model as a servo."""
    plant = model.plant
    wires = {wire.name: wire for wire in plant.inputs}
    given = [it for log in logged for it in log.inputs if wires[it].unit in ("rad", "s")]
    command = wires[next((it for it in given if not wires[it].flag), model.step[0])]
    shaft = plant.terminals.get("shaft", ())
    angles = [it for it in shaft if it in plant.outputs and plant.wire[it].unit == "rad"]
    if command.unit not in ("rad", "s") or not angles or INERTIA not in plant.wire:
        raise UserError(
            f"'{model.actuator.name}' is no servo that takes a goal angle, or a pulse, and moves a"
            f" shaft (its command is '{command.name}' [{command.unit}]): build its FMU"
            " ('servo-models build --params')"
        )
    inertia = float(simulate(with_output(model, INERTIA), [0.0])[INERTIA][0])
    if command.unit == "rad":
        return Servo(model, command, angles[0], 1.0, 0.0, inertia)
    size = _step_size(model, command)
    off = {switch: 0.0 for place in plant.placements for switch in _switches(model, place)}
    plain = replace(model, values={**model.values, **off})
    ends = [float(command.rest) + side * size for side in (-1.0, 1.0)]
    times = [0.0, model.stop_time]
    low, high = (float(simulate(plain, times, {command.name: it})[angles[0]][-1]) for it in ends)
    if low == high:
        raise UserError(f"'{command.name}' moves nothing: correct the parameters")
    slope = (high - low) / (ends[1] - ends[0])
    return Servo(model, command, angles[0], slope, ends[0] - low / slope, inertia)


def _step_size(model: Model, command: Wire) -> float:
    return model.actuator.step_of(model.variant, command.name)[1] - float(command.rest)


def excited(servo: Servo, loaded: bool) -> Run:
    """Return the response to large and small steps, one of them under load, and to a sine sweep.

    Without ``loaded`` there is no load.
    """
    model, wire = servo.model, servo.command
    step = min(model.step_size, LONGEST_STEP_S)
    count = int(np.ceil(0.5 * model.stop_time / step))
    size = _step_size(model, wire)
    held = (1.0, -1.0, -1.0 + SMALL_STEP, 0.0, 0.0, SMALL_STEP)
    steps = np.repeat(held, count)
    share = np.linspace(0.0, 1.0, 2 * count)
    sweep = 0.5 * np.sin(2.0 * np.pi * SWEEP_PERIODS * share**2)
    shape = np.concatenate([np.zeros(1), steps, sweep])
    times = step * np.arange(len(shape), dtype=float)
    command = float(wire.rest) + size * shape
    inputs = {wire.name: command}
    load = model.plant.terminals["shaft"][0]
    torque = model.plant.wire[load]
    inputs[load] = np.zeros(len(shape))
    if loaded:
        inputs[load][1 + 4 * count : 1 + 5 * count] = LOAD_SHARE * torque.scale
    angle = simulate(model, times, inputs)[servo.angle]
    loads = simulate(servo.loads(), times, inputs)[LOAD]
    every = np.ones(len(times), dtype=bool)
    return Run("", times, servo.goal(command), loads, angle, every)


def logged(servo: Servo, nominal: Model, log: Log) -> Run:
    """Return the measured angle, and those of the diagnosed and the nominal model."""
    wires = nominal.plant.wire
    place = next((k for k, it in enumerate(log.outputs) if wires[it].unit == "rad"), None)
    if place is None:
        raise UserError(f"log '{log.name}' has no angle to compare with: add a column of one")
    run, before = prepared(servo.model, log), prepared(nominal, log)
    return Run(
        log.name,
        log.times,
        servo.goal(run.signal(servo.command.name, {})),
        prepared(servo.loads(), log).signal(LOAD, {}),
        run.outputs({})[:, place],
        log.fitted | log.checked,
        [*log.outputs.values()][place],
        before.outputs({})[:, place],
    )
