"""An FMU for co-simulation, whoever made it: unpacked within limits, run in a process of its own.

It guards against faults, not against malice: the code of an FMU runs with the rights of whoever
runs it.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.core.compilers import cached_library, here, host
from servo_models.core.types import Array
from servo_models.errors import CuredError, UserError, did_you_mean, printable
from servo_models.fmu.archive import DESCRIPTION, unpacked
from servo_models.fmu.child import Child, ChildError
from servo_models.fmu.host import Session

REWRITE = "write it again with the tool that made it"
LONGEST_REASON = 300  # characters of an FMU's message that are shown at most
ENUMERATION = {False: "Integer", True: "Int64"}  # type of enumerations in FMI 2.0 and 3.0
REAL = ("Real", "Float64", "Float32")
NOT_RUN = ("Binary", "Clock")


class FmuError(UserError):
    """An FMU stopped, or its process did; the text names the FMU and the reason."""


@dataclass(frozen=True)
class Limits:
    """Limits of time and size for one FMU.

    Attributes:
        seconds: for one comparison, wall-clock time.
        megabytes: of address space; not kept on Windows and macOS.
        unpacked_megabytes: of all its files.
    """

    seconds: float = 120.0
    megabytes: float = 1024.0
    unpacked_megabytes: float = 256.0


LIMITS = Limits()  # ours take a tenth of each


@dataclass(frozen=True)
class Variable:
    """A variable of the model description.

    Attributes:
        name, reference: of it.
        kind: the type by which it is set and got, such as "Real", "Float64" or "Boolean".
        causality: "input", "output", "parameter" and others.
        continuous: it may move between two communication points.
        unit: as the description writes it, "" for none.
        scalar: it is one number, a truth value or a text, no array.
    """

    name: str
    reference: int
    kind: str
    causality: str
    continuous: bool
    unit: str
    scalar: bool

    @property
    def real(self) -> bool:
        return self.kind in REAL

    @property
    def numeric(self) -> bool:
        """Whether its values are numbers, true or false."""
        return self.scalar and self.kind not in ("String", *NOT_RUN)


class Fmu:
    """An unpacked FMU of FMI 2.0 or 3.0 behind a process in which its code runs.

    Attributes:
        path: of the FMU.
        name: file name.
        folder: with its files.
        description: what fmpy reads of its model description.
        variables: by name.
        over: why it cannot be run, or cannot any more; "" while it can.
    """

    strict = False
    """Whether a description that breaks rules of FMI is refused; most public FMUs do, and run."""

    def __init__(self, path: str | Path, limits: Limits = LIMITS) -> None:
        """Unpack and read an FMU.

        Raises:
            UserError: no such file, no FMU, one too large, or one of another version of FMI.
        """
        from fmpy import read_model_description

        self.path = Path(path)
        self.name = self.path.name
        self.limits = limits
        self._child: Child | None = None
        self._files = ExitStack()
        self.folder = Path()
        self._started = 0
        if not os.path.isfile(self.path):
            raise UserError(
                f"no FMU '{path}': correct the name, or build one of ours with servo-models build"
            )
        try:
            self.folder = self._files.enter_context(unpacked(self.path, limits.unpacked_megabytes))
            self.description: Any = read_model_description(str(self.folder), validate=self.strict)
            self._understand()
        except Exception as error:  # zip, XML and FMPy raise many kinds
            refused = self._unreadable(error)
            self.close()
            raise refused from error
        interface = self.description.coSimulation
        named = interface and str(interface.modelIdentifier or "").isidentifier()
        self.over = "" if named else "names no library for co-simulation"

    def _understand(self) -> None:
        """Take from the description what a run needs; any exception in here refuses the FMU."""
        version = self.description.fmiVersion
        if not version.startswith(("2.", "3.")):
            raise UserError(f"it is of FMI {version}; 2.0 and 3.0 are validated")
        self.variables = {
            variable.name: _variable(variable, self.is_fmi3)
            for variable in self.description.modelVariables
        }

    def _unreadable(self, error: Exception) -> UserError:
        cause = self.clean(str(error)) or type(error).__name__
        if isinstance(error, CuredError):
            return UserError(f"cannot read FMU '{self.path}': {cause}")
        cure = "build it again with servo-models build" if self.is_ours else REWRITE
        return UserError(f"cannot read FMU '{self.path}' ({cause}): {cure}")

    @property
    def is_fmi3(self) -> bool:
        return bool(self.description.fmiVersion.startswith("3."))

    @property
    def is_ours(self) -> bool:
        """Whether its description says that servo-models built it."""
        path = self.folder / DESCRIPTION
        return path.is_file() and b'generationTool="servo-models ' in path.read_bytes()

    @property
    def title(self) -> str:
        """Name of the model, in print."""
        return self.clean(str(self.description.modelName))

    @property
    def any_step(self) -> bool:
        """Whether communication steps of one run may differ."""
        return bool(self.description.coSimulation.canHandleVariableCommunicationStepSize)

    def named(self, name: str, place: str) -> Variable:
        """Return a variable whose values are numbers.

        Raises:
            UserError: there is none, or one of another type.
        """
        if name not in self.variables:
            raise UserError(
                f"{place}: FMU '{self.name}' has no variable '{name}';"
                f" {did_you_mean(name, self.variables)}"
            )
        variable = self.variables[name]
        if not variable.numeric:
            kind = variable.kind if variable.scalar else "array"
            raise UserError(
                f"{place}: '{name}' is of type {kind}, which is not compared: leave its column out"
            )
        return variable

    def simulate(
        self,
        times: Array,
        inputs: Mapping[str, Array],
        outputs: Sequence[str],
        start: Mapping[str, Any],
        tolerance: float = 0.0,
    ) -> Array:
        """Return outputs at ``times``, shape (n, outputs), of a new instance.

        Args:
            times: communication points [s], shape (n,).
            inputs: values by name, shape (n,), each held until the next point; inputs that are
                not named keep the start value of the description.
            outputs: names of variables to read.
            start: start values by name.
            tolerance: of the solver in the FMU, 0 for its own.

        Raises:
            FmuError: it stops, or its process does.
        """
        if self.description.coSimulation.canBeInstantiatedOnlyOncePerProcess:
            self._end_process()
        columns = np.column_stack([inputs[name] for name in inputs] or [np.empty((len(times), 0))])
        how = self._how(start, times[0], dict(zip(inputs, columns[0])), outputs, tolerance)
        answer = self.call("run", how, packed(times), packed(columns))
        return self.table(answer, len(times), len(outputs))

    @contextmanager
    def started(
        self,
        values: Mapping[str, float],
        start: float,
        inputs: Mapping[str, float],
        outputs: Sequence[str],
    ) -> Iterator[Instance]:
        """Yield a new instance, initialised at ``start`` [s]; free it afterwards."""
        self._started += 1
        self.call("start", self._started, *self._how(values, start, inputs, outputs))
        running = Instance(self, self._started, len(outputs))
        try:
            yield running
        except BaseException:
            with suppress(FmuError):  # the first failure is the one to tell
                running.free()
            raise
        running.free()

    def _how(
        self,
        values: Mapping[str, Any],
        start: float,
        inputs: Mapping[str, float],
        outputs: Sequence[str],
        tolerance: float = 0.0,
    ) -> tuple[Any, ...]:
        """Arguments of ``host.Instance.begin``, plain: its process has no NumPy."""
        self._check()
        known = {name: (it.reference, it.kind) for name, it in self.variables.items()}
        plain = (it.item() if isinstance(it, np.generic) else it for it in values.values())
        given = [(*known[name], value) for name, value in zip(values, plain)]
        row = [float(value) for value in inputs.values()]
        ins, outs = ([known[name] for name in side] for side in (inputs, outputs))
        return given, float(start), ins, row, outs, float(tolerance)

    def close(self) -> None:
        """End the process and remove the unpacked files."""
        self._end_process()
        self._files.close()

    def _end_process(self) -> None:
        """End the process; the next call starts another."""
        if self._child:
            self._child.close()
        self._child = None

    def call(self, *request: Any) -> Any:
        """Return the answer of the FMU's process to a request; see ``host.Session``.

        Raises:
            FmuError: with the reason.
        """
        self._check()
        try:
            return self._running()(*request)
        except ChildError as error:
            why = self.clean(error.why)
            if error.ended:
                self.over = why
            raise FmuError(f"FMU '{self.name}' {why}") from error

    def _check(self) -> None:
        if self.over:
            raise FmuError(f"FMU '{self.name}' {self.over}")

    def _running(self) -> Child:
        if self._child is None:
            self._child = Child(Session, (), self.limits.seconds, self.name, cure="")
            about = self.description
            library = (about.guid, about.coSimulation.modelIdentifier, _loop())
            place = (about.fmiVersion, str(self.folder))
            try:
                self._child("open", *place, *library, self.limits.megabytes)
            except ChildError as error:
                self.over = self.clean(error.why)
                raise
        return self._child

    def table(self, answer: Any, rows: int, width: int) -> Array:
        """Return an answer that is rows of doubles.

        Raises:
            FmuError: it is another one.
        """
        try:
            return np.frombuffer(answer).reshape(rows, width).copy()
        except (ValueError, TypeError):
            raise FmuError(f"FMU '{self.name}' gives other outputs than it was asked for") from None

    def clean(self, said: str) -> str:
        """Return the words of an FMU as one short line."""
        said = said.replace(str(self.folder), "") if self.folder.name else said
        return printable(" ".join(said.split()), LONGEST_REASON)


class Instance:
    """One instance of an FMU, stepped like ``Model.run`` does.

    ``step`` and ``outputs`` take and give floats in the order of the inputs and outputs with which
    it was started.  Every method raises ``FmuError`` where the FMU fails.
    """

    def __init__(self, fmu: Fmu, number: int, width: int) -> None:
        self._fmu, self._number, self._width = fmu, number, width

    def step(self, time: float, size: float, inputs: Array) -> None:
        """Hold the inputs and advance by ``size`` [s]."""
        row = np.asarray(inputs, dtype=float).tolist()
        self._call("step", float(time), float(size), row)

    def outputs(self) -> list[float]:
        """Return the outputs."""
        try:
            answer = np.array(self._call("outputs"), dtype=float)
        except (ValueError, TypeError):
            answer = np.empty(0)
        row: list[float] = self._fmu.table(answer, 1, self._width)[0].tolist()
        return row

    def drive(self, times: Array, inputs: Array, first: int = 0) -> Array:
        """Step from row ``first``, where it is, to the end; return the rows from there on."""
        answer = self._call("drive", packed(times), packed(inputs), first)
        return self._fmu.table(answer, len(times) - first, self._width)

    def saved(self) -> bytes:
        """Return the complete state."""
        state = self._call("saved")
        if not isinstance(state, bytes):
            raise FmuError(f"FMU '{self._fmu.name}' gives no saved state")
        return state

    def restore(self, saved: bytes) -> None:
        """Go back to a state from ``saved``, also that of another instance."""
        self._call("restore", saved)

    def free(self) -> None:
        """End the instance."""
        self._call("free")

    def _call(self, name: str, *args: Any) -> Any:
        return self._fmu.call("instance", self._number, name, *args)


@functools.cache
def _loop() -> str:
    """The library of ``drive.c``, "" where there is no C compiler."""
    compiler, target = host(), here()
    source = Path(__file__).with_name("drive.c").read_bytes()
    if compiler is None or target not in compiler.targets:
        return ""
    try:
        made_of = ["drive.c", source.decode()]
        return str(
            cached_library(compiler, target, made_of, "drive.c", lambda: {"drive.c": source})
        )
    except UserError:
        return ""


def packed(values: Array) -> bytes:
    """Return rows of doubles as the FMU's process takes them."""
    return np.ascontiguousarray(values, dtype=float).tobytes()


def _variable(variable: Any, is_fmi3: bool) -> Variable:
    kind = ENUMERATION[is_fmi3] if variable.type == "Enumeration" else variable.type
    unit = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    return Variable(
        variable.name,
        variable.valueReference,
        kind,
        variable.causality or "local",
        kind in REAL and variable.variability in (None, "continuous"),
        unit or "",
        not variable.dimensions,
    )
