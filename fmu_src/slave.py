"""The slave of every FMU, in the standard library and pythonfmu only.

``source.py`` pastes this file behind the stepper and puts ``Servo.content = Content(...)`` after
it, so that an FMU is one self-contained file.  Value references count inputs, outputs,
parameters, in this order.

**Errors.**  pythonfmu knows two failures of a call: an exception, which the host sees as
fmi2Fatal and whose text goes through the logger, and ``False`` from ``do_step``, which fmpy
takes for a silent early end.  So every failure is an exception.  A line of our own before it
would be lost: the binary delivers it with the exception pending, and a host that is Python
itself cannot listen in that state (CPython 3.13).  After a failure only
``reset`` or restoring a state helps: an instance that went on with the old value of a
refused input would give wrong numbers.
"""

from __future__ import annotations

import atexit
import ctypes
import functools
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, NoReturn

from pythonfmu.fmi2slave import Fmi2Slave

from servo_models.flat import Flat, neutral_effects, trouble
from servo_models.stepper import step_text

SLACK = 1e-9
"""Rounding allowed in a master's clock, relative to 1 s or to the time."""

SAVED = ("begun", "begins", "last", "time", "trouble")


class Content(NamedTuple):
    """What one FMU is; the lists are by value reference."""

    identity: str
    """Hash of the rest of the file: whose saved states it understands."""
    flat: Flat
    inputs: int
    first_parameter: int
    names: list[str]
    units: list[str]
    start: list[float]
    low: list[float]
    """What may be set, inclusive; an output has its bounds crossed over: nothing fits."""
    low_later: list[float]
    """The same once a run has begun: a fixed parameter cannot be set either."""
    high: list[float]


@functools.cache
def _compiled(dropped: frozenset[str]) -> Callable[[list[float]], Any]:
    """Return ``make`` of the text without the dropped effects, once for all instances."""
    namespace: dict[str, Any] = {}
    exec(compile(step_text(Servo.content.flat, dropped), "<flat text>", "exec"), namespace)
    make: Callable[[list[float]], Any] = namespace["make"]
    return make


def _let_the_process_end(resources: str | None) -> None:
    """Make pythonfmu's library of this FMU let go of its state while it still may.

    At the end of a process that library (0.7.0, Linux) counts down a reference in memory
    that it has given back, and glibc aborts the process: sometimes, after all results.
    Asked in time it lets go once and for all.
    """
    if sys.platform != "linux":
        return
    for library in Path(resources or "").parent.glob("binaries/linux64/*.so"):
        atexit.register(ctypes.CDLL(str(library)).finalizePythonInterpreter)


class Servo(Fmi2Slave):  # type: ignore[misc]
    """One instance: ``values`` by value reference, the state vector ``x``, the time."""

    content: ClassVar[Content]

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        _let_the_process_end(self.resources)
        content = self.content
        self.inputs, self.first_parameter = content.inputs, content.first_parameter
        self.values = list(content.start)
        self.low, self.high = content.low, content.high
        self.x: list[float] = []
        self.dropped: frozenset[str] = frozenset()
        self.begun = False  # false until initialisation ends: outputs are looked up when read
        self.stale = True  # parameters (until begun: inputs too) have changed since
        self.begins = 0.0
        self.last = math.inf
        self.time = math.nan  # no step may begin
        self.trouble = "it is not initialised"

    def setup_experiment(
        self, start_time: float, stop_time: float | None, tolerance: float | None
    ) -> None:
        if not math.isfinite(start_time):
            self.fail(f"the start time {start_time:g} is not finite: give a time in seconds")
        self.begins = start_time
        self.stale = True
        if stop_time is not None:
            if not stop_time >= start_time:
                self.fail(f"the stop time {stop_time:g} s is not after the start {start_time:g} s")
            self.last = stop_time + SLACK * (1.0 + abs(stop_time))

    def exit_initialization_mode(self) -> None:
        if self.stale:
            self.prepare_start()
        self.begun = True
        self.time = self.begins
        self.low = self.content.low_later

    def do_step(self, current_time: float, step_size: float) -> bool:
        end = current_time + step_size
        if not (
            abs(current_time - self.time) <= SLACK * (1.0 + abs(current_time))
            and step_size > 0.0
            and end <= self.last
            and end < math.inf
        ):
            self.refuse_step(current_time, step_size)
        if self.stale:
            self.retune()
        self.advance(self.x, current_time, step_size)
        self.time = end
        return True

    def terminate(self) -> None:
        self.time = math.nan
        self.trouble = "it was terminated"

    def get_real(self, vrs: list[int]) -> list[float]:
        if self.stale and not self.begun:
            self.prepare_start()
        values = self.values
        try:
            return [values[vr] for vr in vrs]
        except IndexError:
            self.unknown(vrs)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        return [value != 0.0 for value in self.get_real(vrs)]

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        low, high, mine, first_parameter = self.low, self.high, self.values, self.first_parameter
        try:
            for vr, value in zip(vrs, values):
                if not low[vr] <= value <= high[vr]:
                    self.refuse_value(vr, value)
                mine[vr] = value
                if vr >= first_parameter:
                    self.stale = True
        except IndexError:
            self.unknown(vrs)
        if not self.begun:
            self.stale = True

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self.no_such_type(vrs, "Boolean that can be set")

    def get_integer(self, vrs: list[int]) -> list[int]:
        return self.no_such_type(vrs, "Integer")

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        self.no_such_type(vrs, "Integer")

    def get_string(self, vrs: list[int]) -> list[str]:
        return self.no_such_type(vrs, "String")

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        self.no_such_type(vrs, "String")

    def prepare_start(self) -> None:
        """Build the step for the present parameters and look at the outputs at the start."""
        self.x, self.dropped = [], frozenset()
        self.retune()
        self.advance(list(self.x), self.begins, 0.0)

    def retune(self) -> None:
        """Build the step for the present parameters, without the neutral effects.

        The state stays as it is; an effect that wakes up begins at rest.
        """
        parameters = self.values[self.first_parameter :]
        dropped = frozenset(neutral_effects(self.content.flat, parameters))
        try:
            start, self.step = _compiled(dropped)(parameters)
        except (ArithmeticError, ValueError) as error:
            self.fail(f"the parameters do not go together ({error}): change the latest one back")
        rest = start()
        if not self.x:
            self.x = rest
        for i, (_, owner) in enumerate(self.content.flat.start):
            if owner in self.dropped and owner not in dropped:
                self.x[i] = rest[i]
        self.dropped = dropped
        self.stale = False

    def advance(self, x: list[float], time: float, size: float) -> None:
        """Step ``x`` and keep the outputs; a size of 0 only looks at them."""
        try:
            code, outputs = self.step(x, self.values[: self.inputs], time, size)
        except (ArithmeticError, ValueError) as error:
            self.fail(
                f"arithmetic fails ({error}) in the step from t = {time:g} s:"
                " a parameter or the internal step is too large"
            )
        if code:
            self.fail(f"{trouble(self.content.flat, code)}, at t = {time + size:g} s")
        self.values[self.inputs : self.first_parameter] = outputs

    def refuse_step(self, time: float, size: float) -> NoReturn:
        if math.isnan(self.time):
            self.refuse(f"the instance cannot step: {self.trouble}; initialise or reset it")
        if not 0.0 < size < math.inf:
            self.fail(f"communication step of {size:g} s: it must be positive and finite")
        if time + size > self.last:
            self.fail(f"the step to t = {time + size:g} s goes beyond the stop time")
        self.fail(
            f"the step begins at t = {time!r} s, but the last one ended at t = {self.time!r} s:"
            " steps must follow each other"
        )

    def refuse_value(self, vr: int, value: float) -> NoReturn:
        content = self.content
        name, unit = content.names[vr], content.units[vr]
        low, high = content.low[vr], content.high[vr]
        if self.inputs <= vr < self.first_parameter:
            self.fail(f"'{name}' is an output: it cannot be set")
        if not math.isfinite(value):
            self.fail(f"'{name}' = {value:g} is not finite: give a number in {unit}")
        if not low <= value <= high:
            self.fail(
                f"'{name}' = {value:g} is outside [{low:g}, {high:g}] {unit}: choose a value inside"
            )
        self.fail(f"'{name}' is a fixed parameter: set it before initialisation ends, or reset")

    def unknown(self, vrs: list[int]) -> NoReturn:
        self.fail(f"value references {vrs}: this FMU has 0 to {len(self.values) - 1} only")

    def no_such_type(self, vrs: list[int], kind: str) -> list[Any]:
        if vrs:
            self.fail(f"value references {vrs}: this FMU has no {kind}")
        return []

    def fail(self, message: str) -> NoReturn:
        """Let no step follow, and tell the host."""
        self.time = math.nan
        self.trouble = f"it has failed ({message})"
        self.refuse(message)

    def refuse(self, message: str) -> NoReturn:
        """Raise, which tells the host what is wrong; % is a format to its logger."""
        # On an exception pythonfmu's binary gives back references that it still uses, and the
        # host crashes at the next call; so give it one of each to lose.
        for held in (self, type(self), self.log_queue):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(held))
        raise RuntimeError(message.replace("%", "%%"))

    def _get_fmu_state(self) -> dict[str, Any]:
        """Everything that the next step depends on, as plain data that JSON keeps exactly."""
        return {
            "identity": self.content.identity,
            "values": list(self.values),
            "x": list(self.x),
            "dropped": sorted(self.dropped),
            **{name: getattr(self, name) for name in SAVED},
        }

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        if state.get("identity") != self.content.identity:
            self.fail("the state to restore is damaged or was saved by another FMU")
        self.values = list(state["values"])
        self.x = list(state["x"])
        self.dropped = frozenset(state["dropped"])
        for name in SAVED:
            setattr(self, name, state[name])
        self.low = self.content.low_later if self.begun else self.content.low
        self.stale = True

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> dict[str, Any]:
        """Damaged bytes give an empty state, which ``_set_fmu_state`` refuses in words."""
        try:
            found = json.loads(state)
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}
