"""Three masters that run one package: fmpy with a loop of our own, libcosim, and ecos.

Each of them steps every FMU with the outputs that the others had at the beginning of the step, so
they give the same numbers, but for the last digits of their clocks.

    python masters.py libcosim servo.ssp 5.0 airframe.roll airframe.pitch

prints the values after every step as JSON.  libcosim and ecos need a process of their own.
"""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from systems import System, read_ssp

Array = NDArray[np.float64]
Signal = tuple[str, str]
"""Instance and variable."""
Signals = dict[Signal, Array]
"""Values after every step."""
Clock = Callable[[float, int], Iterator[tuple[float, float]]]
"""Begin and length [s] of each step, from the step size and the number of steps."""


def multiples(step: float, count: int) -> Iterator[tuple[float, float]]:
    """The clock of our own loop."""
    return ((k * step, step) for k in range(count))


def nanoseconds(step: float, count: int) -> Iterator[tuple[float, float]]:
    """The clock of libcosim."""
    points = [k * round(1e9 * step) / 1e9 for k in range(count + 1)]
    return ((begin, end - begin) for begin, end in itertools.pairwise(points))


def sums(step: float, count: int) -> Iterator[tuple[float, float]]:
    """The clock of ecos."""
    time = 0.0
    for _ in range(count):
        yield time, step
        time += step


class Master:
    """Our own: fmpy loads the FMUs, and the loop is that of ``simulate``."""

    def __init__(self, system: System) -> None:
        """Unpack and load the FMUs."""
        from fmpy import extract, read_model_description
        from fmpy.fmi2 import FMU2Slave

        self.system = system
        self._folder = tempfile.TemporaryDirectory()
        self._fmus: dict[str, Any] = {}
        self._references = {fmu: references(fmu) for fmu in system.components.values()}
        for instance, fmu in system.components.items():
            folder = Path(self._folder.name) / fmu.name
            if not folder.exists():
                extract(fmu, str(folder))
            description = read_model_description(str(folder))
            self._fmus[instance] = FMU2Slave(
                guid=description.guid,
                unzipDirectory=str(folder),
                modelIdentifier=description.coSimulation.modelIdentifier,
                instanceName=instance,
            )
            self._fmus[instance].instantiate()
        self._sources = self._grouped([source for source, _ in system.connections])
        self._sinks = self._grouped([sink for _, sink in system.connections])

    def simulate(
        self,
        stop: float,
        wanted: Sequence[Signal],
        driven: Mapping[Signal, Array] | None = None,
        clock: Clock = multiples,
    ) -> Signals:
        """Return ``wanted`` after every step, from rest.

        Args:
            stop: end [s].
            wanted: ``(instance, variable)``.
            driven: values [SI] of inputs during every step, where they are not constant.
            clock: of another master, to meet its numbers to the last bit.
        """
        self._initialise()
        steps = round(stop / self.system.step)
        rows = np.empty((steps, len(wanted)))
        outputs, inputs = self._grouped(wanted), self._grouped([*(driven or {})])
        values = np.column_stack([*driven.values()]) if driven else np.empty((steps, 0))
        for k, (time, length) in enumerate(clock(self.system.step, steps)):
            self._set(inputs, values[k])
            for fmu in self._fmus.values():
                fmu.doStep(time, length)
            self._transfer()
            rows[k] = self._get(outputs, len(wanted))
        return {signal: rows[:, k] for k, signal in enumerate(wanted)}

    def close(self) -> None:
        """Free the FMUs and their files."""
        for fmu in self._fmus.values():
            fmu.freeInstance()
        self._folder.cleanup()

    def __enter__(self) -> Master:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _initialise(self) -> None:
        for instance, fmu in self._fmus.items():
            fmu.reset()
            fmu.setupExperiment(startTime=0.0)
            starts = self.system.starts_of(instance)
            self._set(self._grouped([(instance, name) for name in starts]), [*starts.values()])
            fmu.enterInitializationMode()
        for _ in self._fmus:  # what an output at 0 depends on may lie behind all other FMUs
            self._transfer()
        for fmu in self._fmus.values():
            fmu.exitInitializationMode()

    def _transfer(self) -> None:
        self._set(self._sinks, self._get(self._sources, len(self.system.connections)))

    def _grouped(self, signals: Sequence[Signal]) -> dict[str, tuple[list[int], list[int]]]:
        """Value references by instance, and where these signals stand in ``signals``."""
        found: dict[str, tuple[list[int], list[int]]] = {}
        for k, (instance, name) in enumerate(signals):
            known, places = found.setdefault(instance, ([], []))
            known.append(self._references[self.system.components[instance]][name])
            places.append(k)
        return found

    def _get(self, grouped: Mapping[str, tuple[list[int], list[int]]], count: int) -> list[float]:
        values = [0.0] * count
        for instance, (known, places) in grouped.items():
            for k, value in zip(places, self._fmus[instance].getReal(known)):
                values[k] = value
        return values

    def _set(
        self, grouped: Mapping[str, tuple[list[int], list[int]]], values: Sequence[float] | Array
    ) -> None:
        for instance, (known, places) in grouped.items():
            self._fmus[instance].setReal(known, [values[k] for k in places])


def references(fmu: Path) -> dict[str, int]:
    """Return the value references of an FMU by name."""
    with zipfile.ZipFile(fmu) as archive:
        tree = ElementTree.fromstring(archive.read("modelDescription.xml"))
    variables = tree.iter("ScalarVariable")
    return {v.attrib["name"]: int(v.attrib["valueReference"]) for v in variables}


def by_fmpy(package: Path, stop: float, wanted: Sequence[Signal]) -> Signals:
    """Run an SSP archive in our own loop."""
    with tempfile.TemporaryDirectory() as folder, Master(read_ssp(package, Path(folder))) as master:
        return master.simulate(stop, wanted)


def by_libcosim(package: Path, stop: float, wanted: Sequence[Signal]) -> Signals:
    """Run an SSP archive, or a folder with ``OspSystemStructure.xml``, in libcosim."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    with tempfile.TemporaryDirectory() as folder:
        if package.is_dir():
            execution = CosimExecution.from_osp_config_file(str(package))
        else:
            read_ssp(package, Path(folder))
            execution = CosimExecution.from_ssp_file(folder)
        observer = CosimObserver.create_last_value()
        execution.add_observer(observer)
        places = []
        for owner, name in wanted:
            slave = execution.slave_index_from_instance_name(owner)
            (found,) = (v for v in execution.slave_variables(slave) if v.name.decode() == name)
            places.append((slave, found.reference))
        rows: list[list[float]] = []
        while execution.status().current_time < round(1e9 * stop):
            if not execution.step():
                raise SystemExit(f"libcosim fails after {len(rows)} steps")
            rows.append([observer.last_real_values(slave, [vr])[0] for slave, vr in places])
    return {signal: np.array(column) for signal, column in zip(wanted, zip(*rows))}


def by_ecos(package: Path, stop: float, wanted: Sequence[Signal]) -> Signals:
    """Run an SSP archive in ecos."""
    from ecospy import EcosSimulation

    with tempfile.TemporaryDirectory() as folder:
        step = read_ssp(package, Path(folder)).step
    with EcosSimulation(step, ssp_path=str(package)) as simulation:
        simulation.init(parameter_set="initial_values")
        rows = []
        for _ in range(round(stop / step)):
            simulation.step()
            rows.append([simulation.get_real(f"{owner}::{name}") for owner, name in wanted])
        simulation.terminate()
    return {signal: np.array(column) for signal, column in zip(wanted, zip(*rows))}


MASTERS = {"fmpy": by_fmpy, "libcosim": by_libcosim, "ecos": by_ecos}
CLOCKS: dict[str, Clock] = {"fmpy": multiples, "libcosim": nanoseconds, "ecos": sums}


def apart(master: str, package: Path, stop: float, wanted: Sequence[Signal]) -> Signals:
    """Run a master in a process of its own.

    Raises:
        RuntimeError: it fails; with what it wrote last.
    """
    names = [".".join(signal) for signal in wanted]
    command = [sys.executable, __file__, master, str(package), repr(stop), *names]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{master} fails on '{package}': {done.stderr[-500:]}")
    columns = json.loads(done.stdout.splitlines()[-1])
    return {signal: np.array(columns[name]) for signal, name in zip(wanted, names)}


def main() -> None:
    master, package, stop, *names = sys.argv[1:]
    wanted = [(owner, name) for owner, _, name in (text.partition(".") for text in names)]
    found = MASTERS[master](Path(package), float(stop), wanted)
    print(json.dumps({".".join(signal): values.tolist() for signal, values in found.items()}))


if __name__ == "__main__":
    main()
