"""What an FMU costs: a step, an instance, its memory; all ratios within one run.

The yardstick is a trivial slave built by pythonfmu's own builder: as many inputs, outputs and
parameters as the SG90, and outputs that copy an input.

Run: ``python benchmarks/bench_fmu.py`` (about half a minute).
"""

from __future__ import annotations

import gc
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave
from pythonfmu import FmuBuilder

import servo_models as sm
from fmu_src.variables import Variable, variables

STEPS = 2000
ROUNDS = 15

TRIVIAL = """
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Trivial(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name, causality, flag in {variables!r}:
            setattr(self, name, False if flag else 0.0)
            kind = Boolean if flag else Real
            other = dict(variability=Fmi2Variability.discrete) if flag else dict()
            if causality == "parameter":
                other = dict(variability=Fmi2Variability.tunable)
            self.register_variable(kind(name, causality=Fmi2Causality[causality], **other))

    def do_step(self, t, dt):
        {body}
        return True
"""


def trivial(every: list[Variable], folder: Path) -> Path:
    """Build the yardstick with the variables of another FMU."""
    rows = [(v.name.replace(".", "_"), v.causality, v.flag) for v in every]
    first = rows[0][0]
    body = "; ".join(
        f"self.{name} = self.{first}"
        for name, causality, flag in rows
        if causality == "output" and not flag
    )
    script = folder / "trivial.py"
    script.write_text(TRIVIAL.format(variables=rows, body=body))
    return Path(FmuBuilder.build_FMU(script, dest=folder))


class Instance:
    """An initialised instance of an FMU, driven at fmpy's low level."""

    def __init__(self, folder: str, parameters: dict[str, float] | None = None) -> None:
        description = fmpy.read_model_description(folder)
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="bench",
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        reference = {v.name: v.valueReference for v in description.modelVariables}
        for name, value in (parameters or {}).items():
            self.fmu.setReal([reference[name]], [value])
        self.fmu.exitInitializationMode()
        of = {
            kind: [v for v in description.modelVariables if v.causality == kind]
            for kind in ("input", "output")
        }
        self.inputs = [v.valueReference for v in of["input"]]
        self.reals = [v.valueReference for v in of["output"] if v.type == "Real"]
        self.flags = [v.valueReference for v in of["output"] if v.type == "Boolean"]
        self.time = 0.0

    def run(self, values: list[float], size: float) -> float:
        """Seconds for a set + step + get, mean over STEPS."""
        fmu, now = self.fmu, self.time
        begin = time.perf_counter()
        for _ in range(STEPS):
            fmu.setReal(self.inputs, values)
            fmu.doStep(now, size)
            fmu.getReal(self.reals)
            fmu.getBoolean(self.flags)
            now += size
        self.time = now
        return (time.perf_counter() - begin) / STEPS

    def free(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()


def interleaved(calls: dict[str, Callable[[], float]]) -> dict[str, float]:
    """Median of each call, taken in turn so that a slow moment hits all of them."""
    found: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(ROUNDS):
        for name, call in calls.items():
            found[name].append(call())
    return {name: statistics.median(times) for name, times in found.items()}


def resident() -> int:
    """Resident memory of this process in bytes (Linux)."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096


def stepped(chosen: sm.Model, excited: float) -> list[float]:
    """Inputs at rest but for the first one."""
    return [excited, *(float(wire.rest) for wire in chosen.plant.inputs[1:])]


def all_effects(chosen: sm.Model) -> dict[str, float]:
    """Every effect switched on at its typical value."""
    parameters = chosen.plant.parameters.items()
    return {name: p.param.typical for name, p in parameters if p.param.switch}


def steps(folders: dict[str, str], servo: sm.Model, motor: sm.Model) -> None:
    """Print the cost of a step against the yardstick and against real time."""
    pulse, volts = stepped(servo, 2e-3), stepped(motor, 30.0)
    sg90, torque_motor = folders["sg90"], folders["torque_motor"]
    at = {
        "sg90, 1 ms": (Instance(sg90), pulse, 1e-3),
        "sg90, all effects": (Instance(sg90, all_effects(servo)), pulse, 1e-3),
        "torque_motor, 0.1 ms": (Instance(torque_motor), volts, 1e-4),
        "torque_motor, 1 ms": (Instance(torque_motor), volts, 1e-3),
        "trivial": (Instance(folders["trivial"]), pulse, 1e-3),
    }
    cost = interleaved(
        {name: partial(made.run, values, size) for name, (made, values, size) in at.items()}
    )
    print(f"{'set + step + get':24}{'us':>8}{'x trivial':>11}{'x real time':>13}")
    for name, seconds in cost.items():
        ratio = seconds / cost["trivial"]
        print(f"{name:24}{seconds * 1e6:8.1f}{ratio:11.2f}{at[name][2] / seconds:13.0f}")
    for made, _, _ in at.values():
        made.free()


def instances(folders: dict[str, str]) -> None:
    """Print the cost in time and memory of further instances."""
    print(f"\n{'instance':24}{'ms':>8}{'kB each':>11}")
    for name, folder in folders.items():
        held: list[Any] = [Instance(folder) for _ in range(3)]
        before = resident()
        begin = time.perf_counter()
        held += [Instance(folder) for _ in range(50)]
        spent = (time.perf_counter() - begin) / 50
        print(f"{name:24}{spent * 1e3:8.1f}{(resident() - before) / 50 / 1024:11.0f}")
        for instance in held:
            instance.free()


def main() -> None:
    folder = Path(tempfile.mkdtemp())
    servo, motor = sm.model("sg90"), sm.model("torque_motor")
    built = {
        "sg90": sm.build(servo, folder / "sg90.fmu"),
        "torque_motor": sm.build(motor, folder / "torque_motor.fmu"),
        "trivial": trivial(variables(servo), folder),
    }
    folders = {name: fmpy.extract(str(path)) for name, path in built.items()}
    steps(folders, servo, motor)
    instances(folders)
    for used in (folder, *folders.values()):
        shutil.rmtree(used)


if __name__ == "__main__":
    main()

# Result: two cores, CPython 3.11, pythonfmu 0.7.0, fmpy 0.3.32.  Earlier, while other work kept
# the cores busy, the SG90's ratio to the trivial slave was 1.12 to 1.53, median 1.28.
#
# set + step + get              us  x trivial  x real time
# sg90, 1 ms                  12.6       1.19           80
# sg90, all effects           20.0       1.90           50
# torque_motor, 0.1 ms        11.2       1.06            9
# torque_motor, 1 ms          22.4       2.13           45
# trivial                     10.6       1.00           95
#
# instance                      ms    kB each
# sg90                        15.2        272
# torque_motor                14.9        240
# trivial                      4.8         99
