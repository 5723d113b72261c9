"""Step an FMU in a master written by other people, and print what it reads.

    python -m tests.support.masters MASTER FMU < run.json

A process of its own: two masters in one process free the same library at its end.  The run says
the communication step in s, the value of every input at every step, and which outputs are read
after every step, all by name.  Printed is a list of rows as JSON, on the last line.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import fmpy
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Values = dict[str, float]


class Master:
    """One FMU, not yet loaded; ``flags`` are its Booleans."""

    def __init__(self, fmu: Path, step: float) -> None:
        self.fmu = fmu
        self.step = step
        self.description = fmpy.read_model_description(str(fmu))
        self.identifier = self.description.coSimulation.modelIdentifier
        variables = self.description.modelVariables
        self.reference = {v.name: v.valueReference for v in variables}
        self.flags = {v.name for v in variables if v.type == "Boolean"}

    def references(self, names: Sequence[str]) -> list[int]:
        return [self.reference[name] for name in names]


class Fmpy(Master):
    def start(self, values: Values) -> None:
        from tests.support.fmu_host import Host

        self.time = 0.0
        self.host = Host(Path(fmpy.extract(str(self.fmu))))
        self.host.start(values)

    def do_step(self, values: Values) -> None:
        self.host.set(values)
        self.host.fmu.doStep(self.time, self.step)
        self.time += self.step

    def read(self, names: Sequence[str]) -> list[float]:
        shown = dict(zip(self.host.outputs, self.host.get()))
        return [shown[name] for name in names]


class Container(Fmpy):
    """The FMU in an FMU of the FMU manipulation toolbox, whose C library is its master."""

    def __init__(self, fmu: Path, step: float) -> None:
        super().__init__(fmu, step)
        self.folder = TemporaryDirectory()
        version = self.description.fmiVersion[0]
        wanted = {"name": "outer.fmu", "step_size": step, "fmu": [str(fmu.resolve())]}
        automatic = {"auto_input": True, "auto_output": True, "auto_parameter": False}
        place = Path(self.folder.name)
        (place / "outer.json").write_text(json.dumps(wanted | automatic))
        program = Path(sys.executable).with_name("fmucontainer")
        words = ["-fmu-directory", ".", "-container", "outer.json", "-fmi", version]
        subprocess.run([program, *words], cwd=place, check=True)
        super().__init__(place / "outer.fmu", step)


class Libcosim(Master):
    """Its clock counts nanoseconds."""

    def start(self, values: Values) -> None:
        from libcosimpy.CosimExecution import CosimExecution
        from libcosimpy.CosimManipulator import CosimManipulator
        from libcosimpy.CosimObserver import CosimObserver
        from libcosimpy.CosimSlave import CosimLocalSlave

        self.execution = CosimExecution.from_step_size(step_size=round(1e9 * self.step))
        local = CosimLocalSlave(fmu_path=str(self.fmu), instance_name="servo")
        self.slave = self.execution.add_local_slave(local)
        for reference, value in zip(self.references(list(values)), values.values()):
            self.execution.real_initial_value(self.slave, reference, value)
        self.manipulator = CosimManipulator.create_override()
        self.observer = CosimObserver.create_last_value()
        self.execution.add_manipulator(self.manipulator)
        self.execution.add_observer(self.observer)

    def do_step(self, values: Values) -> None:
        names = self.references(list(values))
        self.manipulator.slave_real_values(self.slave, names, list(values.values()))
        assert self.execution.step(1)

    def read(self, names: Sequence[str]) -> list[float]:
        get = self.observer
        return [
            float(
                (get.last_boolean_values if name in self.flags else get.last_real_values)(
                    self.slave, [self.reference[name]]
                )[0]
            )
            for name in names
        ]


class Ecos(Master):
    def start(self, values: Values) -> None:
        from ecospy import EcosSimulation, EcosSimulationStructure

        self.structure = EcosSimulationStructure()
        self.structure.add_model("servo", str(self.fmu))
        started = {f"servo::{name}": value for name, value in values.items()}
        self.structure.add_parameter_set("start", started)
        self.simulation = EcosSimulation(structure=self.structure, step_size=self.step)
        self.simulation.init(parameter_set="start")

    def do_step(self, values: Values) -> None:
        for name, value in values.items():
            self.simulation.set_real(f"servo::{name}", value)
        self.simulation.step()

    def read(self, names: Sequence[str]) -> list[float]:
        get = self.simulation
        return [
            float((get.get_bool if name in self.flags else get.get_real)(f"servo::{name}"))
            for name in names
        ]


class FmiPlusPlus(Master):
    def start(self, values: Values) -> None:
        from fmipp import FMUCoSimulationV2

        self.time = 0.0
        folder = Path(fmpy.extract(str(self.fmu)))
        self.slave = FMUCoSimulationV2(folder.as_uri(), self.identifier)
        assert self.slave.instantiate("servo", 0.0, False, False) == 0
        self.set(values)
        assert self.slave.initialize(0.0, False, 0.0) == 0

    def set(self, values: Values) -> None:
        for name, value in values.items():
            assert self.slave.setRealValue(name, value) == 0

    def do_step(self, values: Values) -> None:
        self.set(values)
        assert self.slave.doStep(self.time, self.step, True) == 0
        self.time += self.step

    def read(self, names: Sequence[str]) -> list[float]:
        get = self.slave
        return [
            float((get.getBooleanValue if name in self.flags else get.getRealValue)(name))
            for name in names
        ]


class Fmuloader(Master):
    """FMI 3.0 alone: for FMI 2.0 it asks for the functions of model exchange too."""

    def start(self, values: Values) -> None:
        from fmuloader.fmi3 import Fmi3Slave

        self.time = 0.0
        self.slave = Fmi3Slave(self.fmu, model_identifier=self.identifier)
        token = self.description.instantiationToken
        self.slave.instantiate_co_simulation("servo", instantiation_token=token)
        self.slave.enter_initialization_mode(start_time=0.0)
        self.set(values)
        self.slave.exit_initialization_mode()

    def set(self, values: Values) -> None:
        self.slave.set_float64(self.references(list(values)), list(values.values()))

    def do_step(self, values: Values) -> None:
        self.set(values)
        self.slave.do_step(self.time, self.step)
        self.time += self.step

    def read(self, names: Sequence[str]) -> list[float]:
        get = self.slave
        return [
            float(
                (get.get_boolean if name in self.flags else get.get_float64)(
                    [self.reference[name]]
                )[0]
            )
            for name in names
        ]


MASTERS: dict[str, Any] = {
    "fmpy": Fmpy,
    "fmucontainer": Container,
    "libcosim": Libcosim,
    "ecos": Ecos,
    "FMI++": FmiPlusPlus,
    "fmuloader": Fmuloader,
}


def rows(name: str, fmu: Path, run: dict[str, Any]) -> list[list[float]]:
    """Outputs after every step; the inputs of the first step are the start values too."""
    steps = [dict(zip(run["inputs"], values)) for values in zip(*run["inputs"].values())]
    master = MASTERS[name](fmu, run["step"])
    master.start(steps[0])
    read = []
    for values in steps:
        master.do_step(values)
        read.append(master.read(run["outputs"]))
    return read


def stepped(
    name: str, fmu: Path, step: float, inputs: Mapping[str, Array], outputs: Sequence[str]
) -> Array:
    """Return what a master reads after every step, run in a process of its own.

    Raises:
        subprocess.CalledProcessError: the master refused the FMU, or crashed.
    """
    values = {key: column.tolist() for key, column in inputs.items()}
    asked = json.dumps({"step": step, "inputs": values, "outputs": list(outputs)})
    words = [sys.executable, "-m", __name__, name, str(fmu.resolve())]
    root = Path(__file__).parents[2]
    done = subprocess.run(words, input=asked, capture_output=True, text=True, check=True, cwd=root)
    return np.array(json.loads(done.stdout.splitlines()[-1]))


if __name__ == "__main__":
    found = rows(sys.argv[1], Path(sys.argv[2]), json.load(sys.stdin))
    print(f"\n{json.dumps(found)}", flush=True)
