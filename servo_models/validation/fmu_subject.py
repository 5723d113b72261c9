"""An FMU under validation: unpacked within limits, run in a process of its own."""

from __future__ import annotations

import base64
import functools
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.core.catalogue import of_catalogue
from servo_models.core.compilers import cached_library, here, host
from servo_models.core.plant import Actuator
from servo_models.core.simulate import Model, model
from servo_models.core.types import Array
from servo_models.errors import CuredError, UserError
from servo_models.validation.archive import DESCRIPTION, unpacked
from servo_models.validation.host_process import (
    LIMITS,
    DeadHostError,
    HostProcess,
    Limits,
    RefusedError,
)

REWRITE = "write it again with the tool that made it"
ANY = "it is of another maker: name a --reference ref.csv, or take --static-only"
LONGEST_REASON = 300  # characters of an FMU's message that are shown at most


class FmuError(UserError):
    """An FMU stopped, or its process did; the text names the FMU and the reason."""


class OpenFmu(ABC):
    """An unpacked FMU behind a process in which its code runs.

    Attributes:
        path: of the FMU.
        name: file name.
        folder: with its files.
        description: what fmpy reads of its model description.
        over: why it cannot be run, or cannot any more; "" while it can.
    """

    strict = True
    """Whether a description that breaks rules of FMI is refused."""

    def __init__(self, path: str | Path, limits: Limits = LIMITS) -> None:
        """Unpack and read an FMU.

        Raises:
            UserError: no such file, no FMU, or one too large.
        """
        from fmpy import read_model_description

        self.path = Path(path)
        self.name = self.path.name
        self.limits = limits
        self._host: HostProcess | None = None
        self._files = ExitStack()
        self.folder = Path()
        self._started = 0
        self.over = ""
        if not os.path.isfile(self.path):
            raise UserError(
                f"no FMU '{path}': correct the name, or build one of ours with servo-models build"
            )
        try:
            self.folder = self._files.enter_context(unpacked(self.path, limits.unpacked_megabytes))
        except Exception as error:  # zip and XML errors of many kinds
            raise self._unreadable(error) from error
        try:
            self.description: Any = read_model_description(str(self.folder), validate=self.strict)
            self._understand()
        except Exception as error:  # fmpy raises many kinds
            refused = self._unreadable(error)
            self.close()
            raise refused from error

    @property
    def is_fmi3(self) -> bool:
        return bool(self.description.fmiVersion.startswith("3."))

    @property
    def is_ours(self) -> bool:
        """Whether its description says that servo-models built it."""
        path = self.folder / DESCRIPTION
        return path.is_file() and b'generationTool="servo-models ' in path.read_bytes()

    @abstractmethod
    def _understand(self) -> None:
        """Take from the description what a run needs; any exception in here refuses the FMU."""

    @abstractmethod
    def _about(self) -> dict[str, Any]:
        """Arguments of ``bare_host.Fmu`` beside the library."""

    def close(self) -> None:
        """End the process and remove the unpacked files."""
        self.end_process()
        self._files.close()

    def end_process(self) -> None:
        """End the process; the next call starts another."""
        if self._host:
            self._host.close()
        self._host = None

    def call(self, *request: Any) -> Any:
        """Return the answer of the FMU's process to a request; see ``bare_host.Session``.

        Raises:
            FmuError: with the reason.
        """
        self._check()
        try:
            return self._running().call(*request)
        except DeadHostError as error:
            self.over = str(error)
            raise FmuError(f"FMU '{self.name}' {self.over}") from error
        except RefusedError as error:
            raise FmuError(f"FMU '{self.name}' {self.clean(str(error))}") from error

    def rows(self, shape: tuple[int, int], *request: Any) -> Array:
        """Return the answer to a request for rows of doubles.

        Raises:
            FmuError: it stops, or gives other outputs than it was asked for.
        """
        answer = self.call(*request)
        try:
            return np.frombuffer(base64.b64decode(answer)).reshape(shape).copy()
        except (ValueError, TypeError):
            raise self.unlike() from None

    def unlike(self) -> FmuError:
        """Return the error of an answer that is none."""
        return FmuError(f"FMU '{self.name}' gives other outputs than it was asked for")

    def clean(self, said: str) -> str:
        """Return the words of an FMU as one short line."""
        return _one_line(said.replace(str(self.folder), ""))

    def _check(self) -> None:
        if self.over:
            raise FmuError(f"FMU '{self.name}' {self.over}")

    def _running(self) -> HostProcess:
        if self._host is None:
            self._host = HostProcess(self.folder, self.limits)
            about = self._about() | {
                "fmi": self.description.fmiVersion,
                "folder": str(self.folder),
                "guid": self.description.guid,
                "identifier": self.description.coSimulation.modelIdentifier,
                "loop": _loop(),
            }
            try:
                self._host.call("open", about, self.limits.seconds, self.limits.megabytes)
            except RefusedError as error:
                self.over = self.clean(str(error))
                raise
        return self._host

    def _library_obstacle(self) -> str:
        """Why no library can be loaded, by the description."""
        interface = self.description.coSimulation
        if interface is None or not str(interface.modelIdentifier or "").isidentifier():
            return "names no library for co-simulation"
        return ""

    def _unreadable(self, error: Exception) -> UserError:
        cause = _one_line(str(error)) or type(error).__name__
        if isinstance(error, CuredError):
            return UserError(f"cannot read FMU '{self.path}': {cause}")
        cure = "build it again with servo-models build" if self.is_ours else REWRITE
        return UserError(f"cannot read FMU '{self.path}' ({cause}): {cure}")


class Subject(OpenFmu):
    """An FMU of ours, and the model that it says it is, with the start values as parameters.

    The model description names the actuator and holds every parameter's start value; the
    variant is the one that differs from these in the fewest parameters.
    """

    def __init__(
        self, path: str | Path, own: Actuator | None = None, limits: Limits = LIMITS
    ) -> None:
        """Unpack and read an FMU, of the actuator ``own`` if that is not in the catalogue.

        Raises:
            UserError: no such file, no FMU, one too large, or one of an unknown actuator.
        """
        super().__init__(path, limits)
        try:
            self.model = self._named_model(own)
        except UserError as error:
            self.close()
            raise UserError(f"FMU '{path}': {error}") from error
        self.over = self._obstacle()

    def _understand(self) -> None:
        self._reference = {v.name: v.valueReference for v in self.description.modelVariables}
        self._starts = {
            v.name: float(v.start)
            for v in self.description.modelVariables
            if v.causality == "parameter" and v.type in ("Real", "Float64")
        }

    def run(self, chosen: Model, times: Array, inputs: Array) -> Array:
        """Return what ``chosen.run`` returns, with the FMU at the parameters of ``chosen``.

        Raises:
            FmuError: it stops, or its process does.
        """
        with self.instance(chosen.values, float(times[0]), inputs[0]) as running:
            return running.drive(times, inputs)

    @contextmanager
    def instance(
        self, values: Mapping[str, float], start: float, inputs: Array
    ) -> Iterator[Instance]:
        """Yield a new instance that has left initialisation; free it afterwards."""
        self._check()
        self._started += 1
        running = Instance(self, self._started, values, start, inputs)
        try:
            yield running
        except BaseException:
            with suppress(FmuError):  # the first failure is the one to tell
                running.free()
            raise
        running.free()

    def _obstacle(self) -> str:
        """Why it cannot be run, by its description."""
        plant = self.model.plant
        wanted = {wire.name for wire in plant.inputs} | {*plant.outputs, *plant.parameters}
        named = {v.name for v in self.description.modelVariables if v.causality != "independent"}
        if unlike := sorted(wanted ^ named):
            names = ", ".join(repr(name[:60]) for name in unlike[:3])
            more = f" and {len(unlike) - 3} more" if len(unlike) > 3 else ""
            cure = "build it again with this version" if self.is_ours else ANY
            return (
                f"has not the variables of actuator '{self.model.actuator.name}'"
                f" ({names}{more}): {cure}"
            )
        return self._library_obstacle()

    def references(self, values: Mapping[str, float]) -> list[tuple[int, str, float]]:
        """Return values with value reference and type."""
        real = "Float64" if self.is_fmi3 else "Real"
        return [(self._reference[name], real, float(value)) for name, value in values.items()]

    def _about(self) -> dict[str, Any]:
        plant = self.model.plant
        real = "Float64" if self.is_fmi3 else "Real"
        return {
            "inputs": [(self._reference[wire.name], real) for wire in plant.inputs],
            "outputs": [
                (self._reference[name], "Boolean" if plant.wire[name].flag else real)
                for name in plant.outputs
            ],
        }

    def _named_model(self, own: Actuator | None) -> Model:
        """Find the variant and the parameters by the start values."""
        name = self.description.modelName
        actuator = own if own and own.name == name else of_catalogue(name)
        differing = {
            variant.name: sum(
                value != self._starts.get(name)
                for name, value in actuator.values(variant.name).items()
            )
            + len(self._starts.keys() - actuator.plant_of(variant.name).parameters.keys())
            for variant in actuator.variants
        }
        variant = min(differing, key=lambda name: differing[name])
        known = actuator.plant_of(variant).parameters
        return model(actuator, variant, {n: v for n, v in self._starts.items() if n in known})


class Instance:
    """One instance of an FMU, stepped like ``Model.run`` does.

    ``step`` and ``outputs`` take and give SI floats in the order of the plant.  Every method
    raises ``FmuError`` where the FMU fails.
    """

    def __init__(
        self,
        subject: Subject,
        number: int,
        values: Mapping[str, float],
        start: float,
        inputs: Array,
    ) -> None:
        self._subject = subject
        self._number = number
        self._width = len(subject.model.plant.outputs)
        subject.call("start", number, subject.references(values), start, _plain(inputs))

    def step(self, time: float, size: float, inputs: Array) -> None:
        """Hold the inputs and advance by ``size`` [s]."""
        self._call("step", time, size, _plain(inputs))

    def outputs(self) -> list[float]:
        """Return the outputs."""
        try:
            row = np.array(self._call("outputs"), dtype=float)
        except (ValueError, TypeError):
            row = np.empty(0)
        if row.shape != (self._width,):
            raise self._subject.unlike()
        return [float(value) for value in row]

    def drive(self, times: Array, inputs: Array, first: int = 0) -> Array:
        """Step from row ``first``, where it is, to the end; return the rows from there on."""
        table = (packed(times), packed(inputs), first)
        shape = (len(times) - first, self._width)
        return self._subject.rows(shape, "instance", self._number, "drive", *table)

    def saved(self) -> bytes:
        """Return the complete state as bytes."""
        try:
            return base64.b64decode(self._call("saved"))
        except (ValueError, TypeError):
            raise FmuError(f"FMU '{self._subject.name}' gives no saved state") from None

    def restore(self, saved: bytes) -> None:
        """Go back to a state from ``saved``, also that of another instance."""
        self._call("restore", base64.b64encode(saved).decode())

    def free(self) -> None:
        """End the instance."""
        self._subject.call("free", self._number)

    def _call(self, name: str, *args: Any) -> Any:
        return self._subject.call("instance", self._number, name, *args)


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


def _one_line(said: str) -> str:
    """Foreign text for print: shortened, and without control codes of a terminal."""
    text = " ".join(said.split())
    text = "".join(letter if letter.isprintable() else "?" for letter in text)
    return text if len(text) <= LONGEST_REASON else f"{text[:LONGEST_REASON]}..."


def packed(values: Array) -> str:
    """Return rows of doubles as the FMU's process takes them."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=float).tobytes()).decode()


def _plain(values: Array) -> Any:
    return np.asarray(values, dtype=float).tolist()
