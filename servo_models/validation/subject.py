"""An FMU under validation, run with fmpy's low-level interface."""

from __future__ import annotations

import ast
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servo_models.actuator import Actuator
from servo_models.catalogue import actuator as find_actuator
from servo_models.errors import UserError
from servo_models.simulate import Model, model

Array = NDArray[np.float64]

FMI_ERROR = 3
"""fmi2Error; what is below it is no failure."""


class Subject:
    """An unpacked FMU, and the model that it says it is.

    The model description names the actuator and holds every parameter's start value; the
    variant is the one that differs from these in the fewest parameters.

    Attributes:
        name: file name.
        model: with the start values as parameters.
    """

    def __init__(self, path: str | Path, own: Actuator | None = None) -> None:
        """Unpack and read an FMU, of the actuator ``own`` if that is not in the catalogue.

        Raises:
            UserError: no such file, no FMU, or one of an unknown actuator.
        """
        from fmpy import extract, read_model_description

        self.path = Path(path)
        self.name = self.path.name
        if not self.path.is_file():
            raise UserError(f"no FMU '{path}': build it with servo-models build")
        self._folder = tempfile.mkdtemp(prefix="servo-models-")
        try:
            extract(str(self.path), unzipdir=self._folder)
            self._description: Any = read_model_description(self._folder)
        except Exception as error:  # zip, XML and validation errors of many kinds
            self.close()
            cause = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise UserError(
                f"cannot read FMU '{path}' ({cause}): build it again with servo-models build"
            ) from error
        try:
            self.model = self._named_model(own)
        except UserError as error:
            self.close()
            raise UserError(f"FMU '{path}': {error}") from error
        self._reference = {v.name: v.valueReference for v in self._description.modelVariables}

    def close(self) -> None:
        """Remove the unpacked files."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def run(self, chosen: Model, times: Array, inputs: Array) -> Array:
        """Return what ``chosen.run`` returns, with the FMU at the parameters of ``chosen``."""
        with self.instance(chosen.values, float(times[0]), inputs[0]) as one:
            return drive(one, times, inputs)

    @contextmanager
    def instance(
        self, values: Mapping[str, float], start: float, inputs: Array
    ) -> Iterator[Instance]:
        """Yield a new instance that has left initialisation; free it afterwards."""
        one = Instance(self, values, start, inputs)
        try:
            yield one
        finally:
            one.free()

    def _named_model(self, own: Actuator | None) -> Model:
        """Find the variant and the parameters by the start values."""
        name = self._description.modelName
        found = own if own and own.name == name else find_actuator(name)
        starts = {
            v.name: float(v.start)
            for v in self._description.modelVariables
            if v.causality == "parameter"
        }
        differing = {
            variant.name: sum(
                value != starts[name] for name, value in found.values(variant.name).items()
            )
            for variant in found.variants
            if found.plant_of(variant.name).parameters.keys() == starts.keys()
        }
        if not differing:
            raise UserError(
                f"its parameters are not those of actuator '{found.name}':"
                " build it again with this version"
            )
        return model(found, min(differing, key=lambda name: differing[name]), starts)


class Instance:
    """One instance of an FMU, stepped like ``Model.run`` does.

    ``step`` and ``outputs`` take and give SI floats in the order of the plant.
    """

    def __init__(
        self, subject: Subject, values: Mapping[str, float], start: float, inputs: Array
    ) -> None:
        from fmpy.fmi2 import FMU2Slave

        reference = subject._reference
        plant = subject.model.plant
        self._said: list[str] = []
        self._name = subject.name
        self._inputs = [reference[wire.name] for wire in plant.inputs]
        self._outputs = [reference[name] for name in plant.outputs]
        self._flags = [plant.wire[name].flag for name in plant.outputs]
        try:
            description = subject._description
            self._fmu: Any = FMU2Slave(
                guid=description.guid,
                unzipDirectory=subject._folder,
                modelIdentifier=description.coSimulation.modelIdentifier,
            )
            self._fmu.instantiate(callbacks=_callbacks(self._hear), loggingOn=True)
            self._fmu.setupExperiment(startTime=start)
            self._fmu.enterInitializationMode()
            self._fmu.setReal([reference[name] for name in values], list(values.values()))
            self._fmu.setReal(self._inputs, list(inputs))
            self._fmu.exitInitializationMode()
        except Exception as error:  # fmpy raises bare Exceptions
            raise self._complaint("cannot be initialised", error) from error

    def step(self, time: float, size: float, inputs: Array) -> None:
        """Hold the inputs and advance by ``size`` [s]."""
        try:
            self._fmu.setReal(self._inputs, list(inputs))
            self._fmu.doStep(time, size)
        except Exception as error:  # fmpy raises bare Exceptions
            raise self._complaint(f"stops at t = {time:g} s", error) from error

    def outputs(self) -> list[float]:
        """Return the outputs."""
        reals = [r for r, flag in zip(self._outputs, self._flags) if not flag]
        flags = [r for r, flag in zip(self._outputs, self._flags) if flag]
        real = iter(self._fmu.getReal(reals))
        boolean = iter(self._fmu.getBoolean(flags) if flags else [])
        return [float(next(boolean)) if flag else next(real) for flag in self._flags]

    def saved(self) -> bytes:
        """Return the complete state as bytes."""
        state = self._fmu.getFMUstate()
        try:
            return bytes(self._fmu.serializeFMUstate(state))
        finally:
            self._fmu.freeFMUstate(state)

    def restore(self, saved: bytes) -> None:
        """Go back to a state from ``saved``, also that of another instance."""
        state = self._fmu.deSerializeFMUstate(saved)
        try:
            self._fmu.setFMUstate(state)
        finally:
            self._fmu.freeFMUstate(state)

    def free(self) -> None:
        """End the instance."""
        self._fmu.terminate()
        self._fmu.freeInstance()

    def _hear(
        self, environment: Any, instance: bytes, status: int, category: bytes, text: bytes
    ) -> None:
        if status >= FMI_ERROR:
            self._said.append(text.decode(errors="replace").replace("%%", "%"))

    def _complaint(self, what: str, error: Exception) -> UserError:
        said = self._said[0] if self._said else str(error)
        quoted = re.search(r"RuntimeError\((.*)\)", said)  # pythonfmu's frame around our words
        if quoted:
            said = str(ast.literal_eval(quoted[1]))
        return UserError(f"FMU '{self._name}' {what}: {said}")


def _callbacks(hear: Callable[..., None]) -> Any:
    """Return FMI's callbacks with a logger of their own: ``hear`` gets printf formats.

    ``fmpy.instantiate_fmu(logger=...)`` would expand these natively, by way of one pointer for
    the process: the latest logger hears all instances, those of other hosts too, and once it
    is freed their next message ends in lost memory.
    """
    from fmpy import calloc, fmi2, free

    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(hear)
    callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
    callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
    return callbacks


def drive(one: Instance, times: Array, inputs: Array, first: int = 0) -> Array:
    """Step an instance that is at row ``first`` to the end; return the rows from there on."""
    out = [one.outputs()]
    for k in range(first, len(times) - 1):
        one.step(float(times[k]), float(times[k + 1] - times[k]), inputs[k])
        out.append(one.outputs())
    return np.array(out)
