"""A diagnosed actuator as the native fields of a simulator, and what is lost on the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from servo_models.analysis.statistics import rms
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.description import Description, read_description
from servo_models.data.log import Log
from servo_models.data.parameters import ParameterSet, read_parameters
from servo_models.errors import UserError
from servo_models.identification.starts import with_starts
from servo_models.report.document import Document, Figure
from servo_models.report.result import Result
from servo_models.simulators import simulator as find_simulator
from servo_models.simulators.refit import refitted
from servo_models.simulators.servo import Run, Servo, excited, logged, servo_of
from servo_models.simulators.simulator import Held, Simulator
from servo_models.units import parse

SHORTEST_S = 1e-4  # shortest time step of a simulator
LONGEST_S = 0.1  # longest time step of a simulator


class Errors(Document, frozen=True):
    """RMS errors [rad] against the measured angle of a log, null without logs, and of the native
    law against the diagnosed model."""

    log: str
    native_to_diagnosed: float
    nominal: Figure
    diagnosed: Figure
    native: Figure


@dataclass(frozen=True, eq=False, repr=False)
class Export(Result):
    """An actuator as a simulator takes it.

    Attributes:
        simulator: which.
        servo: what was exported.
        values: native fields by name; ``delay`` in time steps of ``step`` [s].
        held: how the law holds each effect that is on, by the name of its place.
        errors: one for each log, or one for the standard excitation.
    """

    simulator: Simulator
    servo: Servo
    values: Mapping[str, float]
    step: float
    held: Mapping[str, Held]
    errors: tuple[Errors, ...]

    @property
    def lines(self) -> str:
        """Lines to paste into the simulator's file."""
        return self.simulator.lines(self.values, self.step, self.servo.inertia)

    @property
    def kept(self) -> float | None:
        """Fraction of the closed gap that the native law keeps in all logs; None without a gap."""
        told = [it for it in self.errors if it.nominal is not None]
        if not told:
            return None
        nominal, diagnosed, native = (
            float(np.sqrt(np.mean([getattr(it, name) ** 2 for it in told])))
            for name in ("nominal", "diagnosed", "native")
        )
        return (nominal - native) / (nominal - diagnosed) if nominal > diagnosed else None


def export(
    params: str | Path,
    to: str,
    log: str | Path | None = None,
    time_step: float | str | None = None,
    trust: bool = False,
) -> Export:
    """Refit the native fields of a simulator to a parameter file.

    Args:
        params: a parameter file, as ``diagnose --out`` writes it.
        to: name of the simulator, see ``simulators``.
        log: a description; its logs are what the law is fitted and judged on, and its model is the
            nominal one.  Without it a standard excitation is.
        time_step: of the simulator, in s or with a unit; default its own.
        trust: run the actuator's Python file wherever it lies.

    Raises:
        UserError: an unknown simulator, an actuator that no goal angle drives, a description of
            another actuator, logs with several values of a parameter, or one without an angle; see
            also ``read_parameters``.

    Example:
        >>> import servo_models as sm
        >>> print(sm.export("servo.toml", "mujoco").lines)  # doctest: +SKIP
        <option integrator="implicitfast" timestep="0.002"/>
    """
    simulator, given = find_simulator(to), read_parameters(params, trust)
    step = parse(simulator.step if time_step is None else time_step, "s")
    if not SHORTEST_S <= step <= LONGEST_S:
        raise UserError(
            f"a time step of {step:g} s: give one from {SHORTEST_S:g} to {LONGEST_S:g} s"
        )
    model = given.model()
    if log:
        described = _described(Path(log), given, trust)
        logs = with_starts(described.model, described.logs)
        model = replace(model, values={**model.values, **_stated(model, logs)})
        servo = servo_of(model, logs)
        runs = [logged(servo, described.model, it) for it in logs]
    else:
        servo = servo_of(model)
        runs = [excited(servo, simulator.loaded)]
    values, fit = refitted(simulator, runs, step, servo.inertia, model.values)
    return Export(
        simulator,
        servo,
        values,
        step,
        {place: simulator.held(place, effect, values) for place, effect in servo.active().items()},
        tuple(map(_errors, runs, fit.angles(values))),
    )


def _described(path: Path, given: ParameterSet, trust: bool) -> Description:
    described = read_description(path, trust)
    told = described.model, given.model()
    here, there = (f"'{it.actuator.name}', variant '{it.variant}'" for it in told)
    if here != there:
        raise UserError(
            f"'{path}' is of {here}, but '{given.file}' of {there}: give the description that it"
            " was made with"
        )
    return described


def _stated(model: Model, logs: Sequence[Log]) -> dict[str, float]:
    """Parameters that all logs state, as one joint cannot have several."""
    stated = {
        name: log.constants[name] for log in logs for name in log.constants.keys() & model.values
    }
    for name, value in stated.items():
        if any(log.constants.get(name, model.values[name]) != value for log in logs):
            raise UserError(
                f"logs state several '{name}': describe those of one value by themselves"
            )
    return stated


def _errors(run: Run, native: Array) -> Errors:
    def left(angle: Array | None) -> float | None:
        if angle is None or run.measured is None:
            return None
        return rms((angle - run.measured)[run.counted])

    exported = rms((native - run.angle)[run.counted])
    return Errors(run.name, exported, *map(left, (run.nominal, run.angle, native)))
