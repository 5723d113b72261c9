"""A small host on fmpy's lowest level, which keeps the messages of the FMU."""

from __future__ import annotations

import itertools
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar

import fmpy
import numpy as np
from fmpy.fmi2 import (
    FMU2Slave,
    calloc,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    free,
)
from fmpy.fmi3 import FMU3Slave

from servo_models.catalogue import model
from servo_models.core.types import Array

Messages = list[tuple[int, str]]

_numbers = itertools.count()
_messages: dict[bytes, Messages] = {}


def _log(_: Any, name: bytes, status: int, category: bytes, text: bytes) -> None:
    """The text is a printf format without arguments, to be expanded as a C host does."""
    _messages.setdefault(name, []).append((status, text.decode() % ()))


CALLBACKS = fmi2CallbackFunctions()
CALLBACKS.logger = fmi2CallbackLoggerTYPE(_log)
CALLBACKS.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
CALLBACKS.freeMemory = fmi2CallbackFreeMemoryTYPE(free)


class Calls3:
    """The calls of FMI 2.0 by those of FMI 3.0, on fmpy's slave."""

    OTHERWISE: ClassVar = {
        **{"getReal": "getFloat64", "setReal": "setFloat64", "getInteger": "getInt32"},
        **{f"{verb}FMUstate": f"{verb}FMUState" for verb in ("get", "set", "free", "serialize")},
        "deSerializeFMUstate": "deserializeFMUState",
    }

    def __init__(self, slave: Any) -> None:
        self.slave = slave
        self.setupExperiment()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.slave, self.OTHERWISE.get(name, name))

    def setupExperiment(self, startTime: float = 0.0, stopTime: float | None = None) -> None:  # noqa: N802, N803
        """Keep what the next call takes along: FMI 3.0 has none of its own for it."""
        self.times = {"startTime": startTime, "stopTime": stopTime}

    def enterInitializationMode(self) -> None:  # noqa: N802
        self.slave.enterInitializationMode(**self.times)

    def reset(self) -> None:
        self.setupExperiment()
        self.slave.reset()


class Host:
    """One instance of the FMU extracted in ``folder``.

    Attributes:
        messages: (status, text) of every message logged so far.
        prefix: of its calls, in messages: ``fmi2`` or ``fmi3``.
        fmu: fmpy's slave, for the calls that need no comfort; FMI 3.0 behind those of FMI 2.0.
    """

    def __init__(self, folder: Path) -> None:
        self.description = fmpy.read_model_description(str(folder))
        variables = self.description.modelVariables
        self.reference = {v.name: v.valueReference for v in variables}
        self.flags = {v.name for v in variables if v.type == "Boolean"}
        self.outputs = [v.name for v in variables if v.causality == "output"]
        self.inputs = [v.name for v in variables if v.causality == "input"]
        name = f"instance {next(_numbers)}"
        self.messages: Messages = _messages.setdefault(name.encode(), [])
        about = {
            "guid": self.description.guid,
            "unzipDirectory": str(folder),
            "modelIdentifier": self.description.coSimulation.modelIdentifier,
            "instanceName": name,
        }
        self.fmu: Any
        if self.description.fmiVersion.startswith("3."):
            self.prefix = "fmi3"
            self.fmu = Calls3(FMU3Slave(**about))
            self.fmu.instantiate(logMessage=self._hear, loggingOn=True)
        else:
            self.prefix = "fmi2"
            self.fmu = FMU2Slave(**about)
            self.fmu.instantiate(callbacks=CALLBACKS, loggingOn=True)

    def _hear(self, _: Any, status: int, category: bytes, text: bytes) -> None:
        self.messages.append((status, text.decode()))

    def __enter__(self) -> Host:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.fmu.freeInstance()

    def start(
        self, values: dict[str, float] | None = None, time: float = 0.0, stop: float | None = None
    ) -> None:
        """Initialise with start values for inputs and parameters."""
        self.fmu.setupExperiment(startTime=time, stopTime=stop)
        self.fmu.enterInitializationMode()
        self.set(values or {})
        self.fmu.exitInitializationMode()

    def set(self, values: dict[str, float]) -> None:
        self.fmu.setReal([self.reference[name] for name in values], list(values.values()))

    def get(self) -> list[float]:
        """All outputs in order, a flag as 0 or 1."""
        return [
            float(self.fmu.getBoolean([self.reference[name]])[0])
            if name in self.flags
            else self.fmu.getReal([self.reference[name]])[0]
            for name in self.outputs
        ]

    def run(self, times: Array, inputs: Array) -> Array:
        """Step along ``times``, the inputs of a row held from it on; outputs at every row.

        The first row is what the FMU shows now, so the inputs of row 0 must be set already.
        """
        rows = [self.get()]
        for k in range(len(times) - 1):
            self.set(dict(zip(self.inputs, inputs[k])))
            self.fmu.doStep(times[k], times[k + 1] - times[k])
            rows.append(self.get())
        return np.array(rows)

    def simulate(
        self, times: Array, inputs: Array, parameters: dict[str, float] | None = None
    ) -> Array:
        """Initialise at the first of ``times`` and run to the last."""
        self.start({**dict(zip(self.inputs, inputs[0])), **(parameters or {})}, times[0])
        return self.run(times, inputs)


def place_in_x(memory: str) -> int:
    """Where in a saved state vector of the torque motor a memory is."""
    flat = model("torque_motor").flat
    return len(flat.states) + [name for name, _ in flat.memory].index(memory)
