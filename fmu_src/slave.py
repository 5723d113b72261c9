"""The slave of every FMU, in the standard library and pythonfmu only.

``source.py`` pastes this file behind the stepper and puts ``Servo.content = Content(...)`` after
it, so that an FMU is one self-contained file.  Value references count inputs, outputs,
parameters, in this order.

**Errors.**  pythonfmu knows two failures of a call: an exception, which the host sees as
fmi2Fatal and whose text goes through the logger, and ``False`` from ``do_step``, which fmpy
takes for a silent early end.  So every failure is an exception.  A line of our own before it
would be lost: the binary delivers it with the exception pending, and a host that is Python
itself cannot listen in that state (CPython 3.13).  Many hosts show no logger's lines unless
asked, so the text of a failure goes to standard error as well, once.

After a failure only ``reset`` or restoring a state helps: an instance that went on with the old
value of a refused input would give wrong numbers.  Every call that the binary makes is
``guarded``: whatever is raised in it leaves by one door, which keeps the host alive.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import hashlib
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, NoReturn

from pythonfmu.enums import Fmi2Status
from pythonfmu.fmi2slave import Fmi2Slave

from servo_models.core.flat import Flat, neutral_effects, noticed, trouble
from servo_models.core.printer import FURTHEST
from servo_models.core.stepper import step_text

SLACK = 1e-9
"""Rounding allowed in a master's clock, relative to 1 s or to the time; but never half a step, or
one could be repeated or left out."""

MOST_SUB_STEPS = 1_000_000
"""Internal steps in a communication step: some ten seconds of work; what is longer never ends."""

INSTANTIATED, INITIALISING, RUNNING, TERMINATED = PHASES = (
    "before initialisation",
    "in initialisation",
    "between communication steps",
    "after termination",
)
"""Where an instance is in the state machine of FMI 2.0 (fig. 11), as errors say it."""

SAVED = {"phase": str, "begins": float, "last": float, "time": float, "trouble": str}
"""What a saved state holds beside its vectors, with types."""


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
    flags: frozenset[int]
    """Value references of Boolean variables; the others are Real."""
    checked: list[tuple[float, float, str]]
    """Of every input, or of none: where it was checked, and what beyond means."""


class RefusedError(RuntimeError):
    """A call fails; the text is for the host."""


def guarded(method: Callable[..., Any]) -> Callable[..., Any]:
    """Let every exception of a call of the binary leave as one that keeps the host alive."""

    @functools.wraps(method)
    def call(self: Servo, *arguments: Any) -> Any:
        try:
            return method(self, *arguments)
        except BaseException as error:
            message = str(error) if isinstance(error, RefusedError) else self.surprised(error)
            # On an exception pythonfmu's binary gives back references that it still uses, and the
            # host crashes at the next call; so give it one of each to lose.
            for held in (self, type(self), self.log_queue):
                ctypes.pythonapi.Py_IncRef(ctypes.py_object(held))
            raise RefusedError(message.replace("%", "%%")) from None

    return call


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
        self.phase = INSTANTIATED
        self.stale = True  # parameters (until the run begins: inputs too) have changed since
        self.begins = 0.0
        self.last = math.inf
        self.time = math.nan  # no step may begin
        self.longest = 0.0  # communication step [s]
        self.furthest = 0.0  # end of a step from time 0 [s]
        self.trouble = ""  # what has failed, until reset or a restored state
        self.warned: set[str] = set()  # in which words

    @property
    def begun(self) -> bool:
        """False until initialisation ends: outputs are looked up when read."""
        return self.phase in (RUNNING, TERMINATED)

    def only(self, call: str, *phases: str) -> None:
        """Refuse a call that is out of order, or of an instance that has failed."""
        if self.trouble:
            raise RefusedError(
                f"{call} after a failure ({self.trouble}): reset or restore a state first"
            )
        if self.phase not in phases:
            self.fail(f"{call} {self.phase}: it belongs {' or '.join(phases)}")

    @guarded
    def setup_experiment(
        self, start_time: float, stop_time: float | None, tolerance: float | None
    ) -> None:
        self.only("fmi2SetupExperiment", INSTANTIATED)
        if not math.isfinite(start_time):
            self.fail(f"the start time {start_time:g} is not finite: give a time in seconds")
        self.begins = start_time
        self.stale = True
        if stop_time is not None:
            if not stop_time >= start_time:
                self.fail(f"the stop time {stop_time:g} s is not after the start {start_time:g} s")
            self.last = stop_time + SLACK * (1.0 + abs(stop_time))

    @guarded
    def enter_initialization_mode(self) -> None:
        self.only("fmi2EnterInitializationMode", INSTANTIATED)
        self.phase = INITIALISING

    @guarded
    def exit_initialization_mode(self) -> None:
        self.only("fmi2ExitInitializationMode", INITIALISING)
        if self.stale:
            self.prepare_start()
        self.phase = RUNNING
        self.time = self.begins
        self.low = self.content.low_later

    @guarded
    def do_step(self, current_time: float, step_size: float) -> bool:
        end = current_time + step_size
        if self.stale and self.phase == RUNNING and not self.trouble:
            self.retune()  # first, since it says how long a step may be
        if not (
            abs(current_time - self.time) <= min(SLACK * (1.0 + abs(current_time)), 0.5 * step_size)
            and 0.0 < step_size <= self.longest
            and end <= self.last
            and abs(current_time) + step_size <= self.furthest
        ):
            self.refuse_step(current_time, step_size)
        self.advance(self.x, current_time, step_size)
        self.time = end
        if self.content.flat.notices or self.content.checked:
            self.warn()
        return True

    @guarded
    def terminate(self) -> None:
        if not self.trouble:  # a host may end a run that has failed
            self.only("fmi2Terminate", RUNNING)
            self.phase = TERMINATED
            self.time = math.nan

    @guarded
    def get_real(self, vrs: list[int]) -> list[float]:
        return self.look_up(vrs, flags=False)

    @guarded
    def get_boolean(self, vrs: list[int]) -> list[bool]:
        return [value != 0.0 for value in self.look_up(vrs, flags=True)]

    def look_up(self, vrs: list[int], flags: bool) -> list[float]:
        values, known = self.values, self.content.flags
        if self.trouble:
            self.only("reading values", *PHASES)
        for vr in vrs:
            if not 0 <= vr < len(values):  # from 2^31 on they arrive as negative numbers
                self.unknown(vr)
            if (vr in known) is not flags:
                self.no_such_type([vr], "Boolean" if flags else "Real")
        if self.stale and not self.begun:
            self.prepare_start()
        return [values[vr] for vr in vrs]

    @guarded
    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set all of them, or none where one is refused."""
        if self.trouble or self.phase == TERMINATED:
            self.only("setting values", *PHASES[:3])
        low, high, mine, first_parameter = self.low, self.high, self.values, self.first_parameter
        for vr, value in zip(vrs, values):
            if not 0 <= vr < len(mine):
                self.unknown(vr)
            if not low[vr] <= value <= high[vr]:
                self.refuse_value(vr, value)
        for vr, value in zip(vrs, values):
            mine[vr] = value
            if vr >= first_parameter:
                self.stale = True
        if not self.begun:
            self.stale = True

    @guarded
    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self.no_such_type(vrs, "Boolean that can be set")

    @guarded
    def get_integer(self, vrs: list[int]) -> list[int]:
        return self.no_such_type(vrs, "Integer")

    @guarded
    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        self.no_such_type(vrs, "Integer")

    @guarded
    def get_string(self, vrs: list[int]) -> list[str]:
        return self.no_such_type(vrs, "String")

    @guarded
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
        self.longest = MOST_SUB_STEPS * self.step.internal_step
        self.furthest = FURTHEST * self.step.internal_step
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
            self.fail(f"{trouble(self.content.flat, code, x)}, at t = {time + size:g} s")
        self.values[self.inputs : self.first_parameter] = outputs

    def warn(self) -> None:
        """Tell the host, once, of what a run that goes on has noticed."""
        texts = [*noticed(self.content.flat, self.x).values()]
        for value, (low, high, text) in zip(self.values, self.content.checked):
            if not low <= value <= high:
                texts.append(text)
        for text in texts:
            if text not in self.warned:
                self.warned.add(text)
                message = f"{text}, at t = {self.time:g} s".replace("%", "%%")
                self.log(message, Fmi2Status.warning, "logStatusWarning")

    def refuse_step(self, time: float, size: float) -> NoReturn:
        self.only("fmi2DoStep", RUNNING)
        if not 0.0 < size < math.inf:
            self.fail(f"communication step of {size:g} s: it must be positive and finite")
        if size > self.longest:
            self.fail(
                f"communication step of {size:g} s: it may hold {MOST_SUB_STEPS} internal steps,"
                f" that is {self.longest:g} s; make several of it"
            )
        if time + size > self.last:
            self.fail(f"the step to t = {time + size:g} s goes beyond the stop time")
        if abs(time) + size > self.furthest:
            self.fail(
                f"the step to t = {time + size:g} s ends more than {self.furthest:g} s from 0,"
                " where numbers are too coarse for the internal step: let time begin nearer to 0"
            )
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

    def unknown(self, vr: int) -> NoReturn:
        sent = vr % 2**32
        self.fail(f"value reference {sent}: this FMU has 0 to {len(self.values) - 1} only")

    def no_such_type(self, vrs: list[int], kind: str) -> list[Any]:
        if vrs:
            self.fail(f"value references {vrs}: this FMU has no {kind} there")
        return []

    def fail(self, message: str) -> NoReturn:
        """Let nothing follow but a reset or a restored state, and tell the host and the person."""
        self.time = math.nan
        if not self.trouble:
            self.trouble = message
            with contextlib.suppress(AttributeError, OSError, ValueError):  # without such a stream
                print(f"{self.instance_name}: {message}", file=sys.stderr, flush=True)
        raise RefusedError(message)

    def surprised(self, error: BaseException) -> str:
        """Text of a failure that nobody has foreseen."""
        try:
            self.fail(f"the model fails inside: {type(error).__name__}: {error}")
        except RefusedError as told:
            return str(told)

    @guarded
    def _get_fmu_state(self) -> dict[str, Any]:
        """Everything that the next step depends on, as plain data that JSON keeps exactly."""
        return {
            "identity": self.content.identity,
            "values": list(self.values),
            "x": list(self.x),
            "dropped": sorted(self.dropped),
            **{name: getattr(self, name) for name in SAVED},
        }

    @guarded
    def _set_fmu_state(self, state: Any) -> None:
        if not isinstance(state, dict) or state.get("identity") != self.content.identity:
            self.fail("the state to restore is damaged or was saved by another FMU")
        if not self.is_whole(state):
            self.fail("the state to restore is damaged")
        self.values = list(state["values"])
        self.x = list(state["x"])
        self.dropped = frozenset(state["dropped"])
        for name in SAVED:
            setattr(self, name, state[name])
        self.low = self.content.low_later if self.begun else self.content.low
        self.stale = True

    def is_whole(self, state: dict[str, Any]) -> bool:
        """Whether a state has the parts, types, lengths and bounds that this instance gives it."""
        content = self.content
        values: Any = state.get("values")
        x: Any = state.get("x")
        dropped: Any = state.get("dropped")
        if not all(type(state.get(name)) is kind for name, kind in SAVED.items()):
            return False
        if not (_numbers(values) and _numbers(x) and isinstance(dropped, list)):
            return False
        return (
            state["phase"] in PHASES
            and len(values) == len(content.names)
            and (len(x) == content.flat.size or (not x and state["phase"] in PHASES[:2]))
            and all(name in list(content.flat.switches) for name in dropped)
            and all(map(math.isfinite, [state["begins"], *x[: len(content.flat.states)]]))
            and all(
                low <= value <= high or low > high  # an output has its bounds crossed over
                for low, value, high in zip(content.low, values, content.high)
            )
        )

    @staticmethod
    def _fmu_state_to_bytes(state: dict[str, Any]) -> bytes:
        text = json.dumps(state, sort_keys=True)
        return json.dumps({"state": text, "digest": _digest(text)}).encode()

    @staticmethod
    def _fmu_state_from_bytes(content: bytes) -> dict[str, Any]:
        """Damaged bytes give an empty state, which ``_set_fmu_state`` refuses in words: this
        call itself has no instance that could raise safely."""
        try:
            found = json.loads(content)
            if found["digest"] == _digest(found["state"]):
                state = json.loads(found["state"])
                return state if isinstance(state, dict) else {}
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            pass
        return {}


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _numbers(values: Any) -> bool:
    """Whether these are a list of numbers; a clock without a next event stands at infinity."""
    return isinstance(values, list) and all(
        isinstance(value, (int, float)) and not math.isnan(value) for value in values
    )
