"""What steps an FMU in a process of its own, by FMPy's calls of FMI 2.0 and 3.0.

``fmu.py`` calls it through a ``Child``.  It shuts itself in before it loads the FMU: that finds
the standard library and what lies beside it, as in a host where nothing else is installed.
"""

from __future__ import annotations

import array
import ast
import copy
import ctypes
import math
import os
import re
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.machinery import BuiltinImporter, FrozenImporter, PathFinder
from pathlib import Path
from typing import Any

from servo_models.errors import UserError

if sys.platform != "win32":
    import resource

SET, STEP, ENDS, EARLY, GET = range(1, 6)  # what failed in ``drive.c``
ENDED, REACHED = "asks to end the simulation", "says that the step ended at t ="
ERROR = 3  # status from which messages are kept
LARGEST_FILE = 1 << 28  # bytes that an FMU may write to a file
PASSED_ON = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")
"""Environment variables that the FMU gets."""
TEMPORARY = ("HOME", "TMPDIR", "TEMP", "TMP")  # variables that name its working folder
NUMBERS: dict[str, Callable[[Any], Any]] = {
    "Real": float,
    "Float64": float,
    "Float32": float,
    "Boolean": bool,
    "String": str,
}
"""Conversion of a value before it is set, by type; other types are integers."""

Variables = Sequence[tuple[int, str]]  # value reference, and type by which it is set or got


class RefusedError(UserError):
    """A call of the FMU failed; the text is its own message where it gave one."""


class _Driven(ctypes.Structure):
    """``Fmu`` of ``drive.c``."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("component", "set", "step", "get")),
        *((name, ctypes.c_int) for name in ("is_fmi3", "failed", "status")),
        ("reached", ctypes.c_double),
    )


class _Exports:
    """A library whose missing functions fail when they are called; FMPy loads all of them."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self.library = library

    def __getattr__(self, name: str) -> Any:
        try:
            return getattr(self.library, name)
        except AttributeError as error:
            reason = str(error)

        def missing(*_: Any) -> None:
            raise AttributeError(reason)

        return missing


class _Lenient:
    @property
    def dll(self) -> _Exports:
        return self._dll

    @dll.setter
    def dll(self, library: ctypes.CDLL) -> None:
        self._dll = _Exports(library)


class Side:
    """Variables that are set or got together: by type, their places among all and references."""

    def __init__(self, variables: Variables) -> None:
        self.size = len(variables)
        kinds = [kind for _, kind in variables]
        self.parts = [
            (kind, places, [variables[k][0] for k in places])
            for kind in dict.fromkeys(kinds)
            for places in [[k for k in range(self.size) if kinds[k] == kind]]
        ]
        self.all_double = {*kinds} <= {"Real", "Float64"}
        self.references = (ctypes.c_uint * self.size)(*(number for number, _ in variables))


class Instance:
    """One instance of an FMU of FMPy, stepped with held inputs."""

    def __init__(self, fmu: Any, loop: ctypes.CDLL | None) -> None:
        self.fmu, self.loop = fmu, loop
        self.is_fmi3 = hasattr(fmu, "fmi3DoStep")
        self.heard: list[str] = []
        self._held: Sequence[float] | None = None

    def begin(
        self,
        values: Sequence[tuple[int, str, Any]],
        time: float,
        inputs: Variables,
        row: Sequence[float],
        outputs: Variables,
        tolerance: float,
    ) -> None:
        """Initialise at ``time`` [s] with ``values`` and a row of inputs; 0 is no tolerance."""
        told = {"tolerance": tolerance or None, "startTime": time}
        self.inputs, self.given = Side(inputs), Side(outputs)
        self._instantiate()
        if self.is_fmi3:
            self.fmu.enterInitializationMode(**told)
        else:
            self.fmu.setupExperiment(**told)
            self.fmu.enterInitializationMode()
        self._set(Side([value[:2] for value in values]), [value[2] for value in values])
        self._set(self.inputs, row)
        self.fmu.exitInitializationMode()

    def _instantiate(self) -> None:
        self.fmu.component = None
        if self.is_fmi3:
            how: dict[str, Any] = {"logMessage": self._hear}
        else:
            usual = self.fmu.usual
            logger = type(usual.logger)(self._hear)
            how = {"callbacks": type(usual)(logger, usual.allocateMemory, usual.freeMemory)}
        try:
            self.fmu.instantiate(loggingOn=True, **how)
        finally:
            if not self.fmu.component:
                raise RefusedError(self.heard[0] if self.heard else "no instance, and no reason")

    def _set(self, side: Side, row: Sequence[Any]) -> None:
        for kind, places, references in side.parts:
            number = NUMBERS.get(kind, round)
            getattr(self.fmu, f"set{kind}")(references, [number(row[k]) for k in places])

    def step(self, time: float, size: float, row: Sequence[float]) -> None:
        """Hold a row of inputs and advance by ``size`` [s]."""
        self.attempt(f"stops at t = {time:g} s: ", self._step, time, size, row)

    def _step(self, time: float, size: float, row: Sequence[float]) -> None:
        if row != self._held:  # the FMU holds them
            self._set(self.inputs, row)
            self._held = row
        if told := self.fmu.doStep(time, size):  # of FMI 3.0
            _, ends, _, reached = told
            if ends:
                raise RefusedError(ENDED)
            if not math.isclose(reached, time + size, rel_tol=1e-9, abs_tol=1e-9):
                raise RefusedError(f"{REACHED} {reached:g} s")

    def outputs(self) -> list[float]:
        row = [math.nan] * self.given.size
        for kind, places, references in self.given.parts:
            for k, value in zip(places, getattr(self.fmu, f"get{kind}")(references)):
                row[k] = float(value)
        return row

    def drive(self, times: bytes, inputs: bytes, first: int) -> bytes:
        """Step from row ``first``, where the instance is, to the end; outputs of these rows.

        Times, inputs and outputs are rows of doubles.
        """
        clock, table, width = array.array("d", times), array.array("d", inputs), self.inputs.size
        rows = array.array("d", self.outputs())
        if self.loop and self.inputs.all_double and self.given.all_double:
            return (rows + self._driven(clock[first:], table[first * width :])).tobytes()
        for k in range(first, len(clock) - 1):
            self.step(clock[k], clock[k + 1] - clock[k], table[k * width : (k + 1) * width])
            rows.extend(self.outputs())
        return rows.tobytes()

    def _driven(self, clock: array.array[float], table: array.array[float]) -> array.array[float]:
        """Outputs after each step, see ``drive.c``."""
        prefix, real = ("fmi3", "Float64") if self.is_fmi3 else ("fmi2", "Real")
        calls = [f"{prefix}{name}" for name in (f"Set{real}", "DoStep", f"Get{real}")]
        exported = (self.fmu.dll.library[call] for call in calls)
        told = _Driven(
            self.fmu.component,
            *(ctypes.cast(call, ctypes.c_void_p) for call in exported),
            is_fmi3=self.is_fmi3,
        )
        out = array.array("d", bytes(8 * (len(clock) - 1) * self.given.size))
        drive: Any = self.loop and self.loop.drive
        drive.restype = ctypes.c_size_t
        row = drive(
            ctypes.byref(told),
            *(it for side in (self.inputs, self.given) for it in (side.references, _size(side))),
            ctypes.c_size_t(len(clock)),
            *(ctypes.c_void_p(each.buffer_info()[0]) for each in (clock, table, out)),
        )
        self._held = None  # they are others now
        if told.failed:
            name = calls[{SET: 0, GET: 2}.get(told.failed, 1)]
            why = {ENDS: ENDED, EARLY: f"{REACHED} {told.reached:g} s"}.get(told.failed)
            said = why or self._said(f"{name} gives status {told.status}")
            raise RefusedError(f"stops at t = {clock[row]:g} s: {said}")
        return out

    def saved(self) -> bytes:
        """The complete state."""
        state = self.fmu.getFMUState()
        try:
            return bytes(self.fmu.serializeFMUState(state))
        finally:
            self.fmu.freeFMUState(state)

    def restore(self, saved: bytes) -> None:
        """Go back to a state from ``saved``, also that of another instance."""
        state = self.fmu.deserializeFMUState(saved)
        try:
            self.fmu.setFMUState(state)
            self._held = None
        finally:
            self.fmu.freeFMUState(state)

    def free(self) -> None:
        """End it; its library stays, which other instances may use."""
        try:
            self.fmu.terminate()
        finally:
            getattr(self.fmu, "fmi3FreeInstance" if self.is_fmi3 else "fmi2FreeInstance")(
                self.fmu.component
            )

    def attempt(self, doing: str, call: Callable[..., Any], *args: Any) -> Any:
        """Return what a call returns.

        Raises:
            RefusedError: the call failed; ``doing`` and the reason.
        """
        try:
            return call(*args)
        except RefusedError as error:
            raise RefusedError(f"{doing}{error}") from error
        except Exception as error:
            if function := getattr(error, "function", ""):  # FMPy's, of a call of the FMU
                reason = self._said(f"{function} gives status {error.status}")  # type: ignore[attr-defined]
            else:  # a MemoryError, say: the limit is the FMU's as well
                reason = f"{type(error).__name__}: {error}"
            raise RefusedError(f"{doing}{reason}") from error

    def _said(self, unsaid: str) -> str:
        """First message of the FMU, without the frame that pythonfmu puts around an exception."""
        said = self.heard[0] if self.heard else unsaid
        quoted = re.search(r"RuntimeError\((.*)\)", said)
        with suppress(ValueError, SyntaxError, RecursionError, MemoryError):
            return str(ast.literal_eval(quoted[1])) if quoted else said
        return said

    def _hear(self, *said: Any) -> None:
        status, _, text = said[-3:]
        if status >= ERROR:
            text = text.decode(errors="replace")
            # in FMI 2.0 it is a printf format, without arguments
            self.heard.append(text if self.is_fmi3 else text.replace("%%", "%"))


class Session:
    """The FMU and its instances by number; a call names a method, and gives its arguments."""

    def __init__(self) -> None:
        self.instances: dict[int, Instance] = {}

    def __call__(self, name: str, *args: Any) -> Any:
        return getattr(self, name)(*args)

    def open(
        self, version: str, folder: str, guid: str, identifier: str, loop: str, megabytes: float
    ) -> None:
        """Load the library of an unpacked FMU; ``loop`` is ``drive.c`` where it is compiled."""
        from fmpy import fmi2, fmi3, platform, platform_tuple, sharedLibraryExtension

        three = version.startswith("3.")
        kind = fmi3.FMU3Slave if three else fmi2.FMU2Slave
        shut_in(folder, megabytes)
        self.loop = ctypes.CDLL(loop) if loop else None
        place = platform_tuple if three else platform
        library = f"binaries/{place}/{identifier}{sharedLibraryExtension}"
        if not Path(folder, library).is_file():
            raise RefusedError(f"has no library {library}")
        try:
            self.fmu = type(kind.__name__, (_Lenient, kind), {"usual": fmi2.defaultCallbacks})(
                instanceName="validated",
                guid=guid,
                modelIdentifier=identifier,
                unzipDirectory=folder,
            )
            _ = self.fmu.dll.library["fmi3InstantiateCoSimulation" if three else "fmi2Instantiate"]
        except Exception as error:  # FMPy raises any kind
            reason = str(error).replace(folder, "").split(". ", 1)[-1].strip("/: ")
            raise RefusedError(f"has a library that cannot be loaded: {reason}") from error

    def start(self, number: int, *how: Any) -> None:
        """Make an instance; see ``Instance.begin``."""
        made = self.instances[number] = Instance(copy.copy(self.fmu), self.loop)
        made.attempt("cannot be initialised: ", made.begin, *how)

    def instance(self, number: int, name: str, *args: Any) -> Any:
        """Call a method of an instance."""
        running = self.instances[number]
        return running.attempt("", getattr(running, name), *args)

    def run(self, how: Sequence[Any], times: bytes, inputs: bytes) -> bytes:
        """Outputs of a new instance at every row, see ``Instance.drive``."""
        self.start(0, *how)
        rows: bytes = self.instance(0, "drive", times, inputs, 0)
        with suppress(RefusedError):  # what it says at its end changes no figure
            self.instance(0, "free")
        return rows


def shut_in(folder: str, megabytes: float) -> None:
    """Leave the process with the standard library, a folder and the environment of a host."""
    os.chdir(folder)
    os.dup2(os.open(os.devnull, os.O_RDWR), 2)
    for name in os.environ.keys() - {*PASSED_ON}:
        del os.environ[name]
    os.environ.update(dict.fromkeys(TEMPORARY, folder))
    known = [it for it in sys.path if it.startswith(sys.base_prefix) and "-packages" not in it]
    sys.path[:], sys.meta_path[:] = known, [BuiltinImporter, FrozenImporter, PathFinder]
    for name in [*sys.modules]:  # what is imported already would be found too
        if name != "__main__" and name.partition(".")[0] not in sys.stdlib_module_names:
            del sys.modules[name]
    if sys.platform != "win32":
        _limit(resource.RLIMIT_AS, int(megabytes * 2**20))
        _limit(resource.RLIMIT_CORE, 0)
        _limit(resource.RLIMIT_FSIZE, LARGEST_FILE)


def _limit(which: int, most: int) -> None:
    """Set a limit if the system permits it."""
    if sys.platform != "win32":
        with suppress(ValueError, OSError):
            ceiling = resource.getrlimit(which)[1]
            most = most if ceiling == resource.RLIM_INFINITY else min(most, ceiling)
            resource.setrlimit(which, (most, most))


def _size(side: Side) -> ctypes.c_size_t:
    return ctypes.c_size_t(side.size)
