"""What a native FMU costs beside one written by hand in C; all ratios within one run.

The yardstick is ``hand_written.c``: the equations of an actuator without effects and nothing else,
compiled by the compiler and with the flags of the native FMU, whose effects are all off.

Run: ``python -m benchmarks.bench_native`` (Linux on x86-64 with a C compiler; about a minute).  The
extra ``benchmark`` brings MuJoCo, whose row is nan without it.
"""

from __future__ import annotations

import math
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import fmpy
import numpy as np

import servo_models as sm
from benchmarks.bench_fmu import Instance
from benchmarks.bench_simulation import mujoco_servo
from fmu_src.native.archive import headers
from servo_models.core.compilers import TARGETS, compile_library, needed_compiler

HERE = Path(__file__).parent
(LINUX,) = (target for target in TARGETS if target.name == "linux-x86_64")
STEPS = 2000  # about a millisecond, so that some repeat of many is left undisturbed
FMPY_STEPS = 50
REPEATS = 10
ROUNDS = 40
SWITCHED = 64  # steps between two jumps of the main input, in step_time.c as well
AGREEMENT = 1e-9  # of the summed outputs; with more it is another model, and no yardstick


class Cost(NamedTuple):
    """What ``step_time`` prints, by the units it prints in."""

    ns: float
    kb_each: float
    kb_growth: float
    summed: float


@dataclass(frozen=True)
class Subject:
    """An FMU that has been extracted, and the two values of its main input."""

    folder: str
    low: float
    high: float

    @cached_property
    def about(self) -> Any:
        return fmpy.read_model_description(self.folder)

    @property
    def library(self) -> Path:
        return next(Path(self.folder).glob("binaries/linux64/*.so"))

    def reals(self, causality: str) -> list[Any]:
        every = self.about.modelVariables
        return [v for v in every if v.causality == causality and v.type == "Real"]

    def in_c(
        self,
        host: Path,
        size: float,
        steps: int = STEPS,
        instances: int = 1,
        repeats: int = REPEATS,
    ) -> Cost:
        """Step it from the C host."""
        wanted = self.reals("input"), self.reals("output")
        listed = [",".join(str(v.valueReference) for v in some) for some in wanted]
        run = [self.about.guid, instances, steps, repeats, size, self.low, self.high, *listed]
        command = list(map(str, [host, self.library, *run]))
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        return Cost(*map(float, done.stdout.split()))

    def seconds_in_c(self, host: Path, size: float) -> float:
        return 1e-9 * self.in_c(host, size).ns


def effects_off(name: str) -> sm.Model:
    """The default variant of an actuator with every switch at 0."""
    parameters = sm.model(name).plant.parameters.items()
    return sm.model(name, parameters={key: 0.0 for key, p in parameters if p.param.switch})


def built(chosen: sm.Model, work: Path, kind: str) -> Subject:
    """Build an FMU and extract it."""
    path = sm.build(chosen, work / "built.fmu", kind)
    rest, step = float(chosen.plant.inputs[0].rest), chosen.actuator.step[1]
    return Subject(fmpy.extract(str(path), str(Path(tempfile.mkdtemp(dir=work)))), rest, step)


def by_hand(native: Subject, name: str, work: Path) -> Subject:
    """A copy of a native FMU with the yardstick for its library: the same description."""
    made = replace(native, folder=shutil.copytree(native.folder, work / f"{name}_by_hand"))
    sources = {
        "hand_written.c": (HERE / "hand_written.c").read_bytes(),
        "equations.h": (HERE / f"hand_written_{name}.h").read_bytes(),
    }
    library = compile_library(needed_compiler(), LINUX, sources, "hand_written.c", [headers()])
    made.library.write_bytes(library)
    return made


def c_host(work: Path) -> Path:
    host = work / "step_time"
    files = ["-I", headers(), HERE / "step_time.c", "-o", host, "-ldl"]
    command = [*needed_compiler().command, "-O2", "-std=c99", *map(str, files)]
    subprocess.run(command, check=True)
    return host


def fmpy_step(instance: Instance, values: list[float], size: float) -> float:
    """Seconds for a set + step + get through fmpy, mean of FMPY_STEPS."""
    fmu, now = instance.fmu, instance.time
    begin = time.perf_counter()
    for _ in range(FMPY_STEPS):
        fmu.setReal(instance.inputs, values)
        fmu.doStep(now, size)
        fmu.getReal(instance.reals)
        now += size
    instance.time = now
    return (time.perf_counter() - begin) / FMPY_STEPS


def best(calls: dict[str, Callable[[], float]]) -> dict[str, float]:
    """Least of each call, taken in turn so that a slow moment hits all of them."""
    found = dict.fromkeys(calls, float("inf"))
    for _ in range(ROUNDS):
        for name, call in calls.items():
            found[name] = min(found[name], call())
    return found


def rows(head: str, seconds: dict[str, float]) -> None:
    """Print times beside the first of them."""
    print(f"\n{head:40}{'us':>9}{'ratio':>8}")
    yardstick = next(iter(seconds.values()))
    for name, spent in seconds.items():
        print(f"{name:40}{spent * 1e6:9.3f}{spent / yardstick:8.2f}", flush=True)


def steps_in_c(host: Path, name: str, subjects: dict[str, Subject], size: float) -> None:
    """Print the cost of a step in a C host."""
    summed = {how: subject.in_c(host, size).summed for how, subject in subjects.items()}
    least, most = min(summed.values()), max(summed.values())
    assert most - least <= AGREEMENT * abs(most), summed
    calls = {how: partial(subject.seconds_in_c, host, size) for how, subject in subjects.items()}
    rows(f"C host: {name}, step of {size * 1e3:g} ms", best(calls))


def steps_in_fmpy(name: str, subjects: dict[str, Subject], size: float) -> None:
    """Print the cost of a step through fmpy."""
    made = {how: Instance(subject.folder) for how, subject in subjects.items()}
    values = [float(v.start) for v in next(iter(subjects.values())).reals("input")]
    calls = {how: partial(fmpy_step, instance, values, size) for how, instance in made.items()}
    rows(f"fmpy: {name}, step of {size * 1e3:g} ms", best(calls))
    for instance in made.values():
        instance.free()


def many(host: Path, name: str, subjects: dict[str, Subject]) -> None:
    """Print what a thousand instances cost, each stepped 10 000 times."""
    print(f"\n{f'{name}: 1000 instances, 10 000 steps':40}{'us':>9}{'kB each':>9}{'growth kB':>11}")
    for how, subject in subjects.items():
        cost = subject.in_c(host, 1e-3, steps=10, instances=1000, repeats=1000)
        print(f"{how:40}{cost.ns / 1e3:9.3f}{cost.kb_each:9.1f}{cost.kb_growth:11.0f}", flush=True)


def simulations(host: Path, name: str, work: Path) -> None:
    """Print the cost of a step of the default variant, which has some effects on."""
    chosen = sm.model(name)
    native = built(chosen, work, "native")
    times = 1e-3 * np.arange(STEPS + 1)
    inputs = np.tile([float(wire.rest) for wire in chosen.plant.inputs], (len(times), 1))
    inputs[np.arange(len(times)) // SWITCHED % 2 == 0, 0] = native.high
    flags = [chosen.plant.wire[output].flag for output in chosen.plant.outputs]
    summed = float(chosen.run(times, inputs)[1:, np.logical_not(flags)].sum())
    told = native.in_c(host, 1e-3, repeats=1).summed
    assert abs(told - summed) <= AGREEMENT * abs(summed), (told, summed)

    def numba() -> float:
        seconds = []
        for _ in range(REPEATS):  # as many as in the C host, since the first one is cold
            start = chosen.start()
            begin = time.perf_counter()
            chosen.run(times, inputs, start)
            seconds.append((time.perf_counter() - begin) / STEPS)
        return min(seconds)

    def mujoco() -> float:
        return (mujoco_servo(STEPS) or math.nan) / STEPS

    calls = {"native in the C host": partial(native.seconds_in_c, host, 1e-3), "numba": numba}
    rows(f"simulation: {name}, steps of 1 ms", best({**calls, "MuJoCo's servo": mujoco}))


def main() -> None:
    work = Path(tempfile.mkdtemp())
    host = c_host(work)
    print(needed_compiler().version.splitlines()[0])
    for name, sizes in (("torque_motor", (1e-3, 1e-4)), ("sg90", (1e-3,))):
        chosen = effects_off(name)
        native = built(chosen, work, "native")
        in_c = {"by hand": by_hand(native, name, work), "native": native}
        for size in sizes:
            steps_in_c(host, name, in_c, size)
        steps_in_fmpy(name, {**in_c, "Python FMU": built(chosen, work, "python")}, 1e-3)
        many(host, name, in_c)
        simulations(host, name, work)
    shutil.rmtree(work)


if __name__ == "__main__":
    main()

# Result: two cores that other work kept busy, CPython 3.11, fmpy 0.3.32, numba 0.68, MuJoCo 4.0.
#
# By hand divides by inductance and inertia, as the equations do.  With reciprocals, whose results
# have other last bits, it takes 0.68 of its time at 1 ms, and native 1.75 times as long as that.
# In a step that is one sub-step (the torque motor's at 0.1 ms, the SG90's) the fifth evaluation of
# the right-hand side, the error control and the checks of the calls weigh more than in one of ten.
#
# cc (Debian 12.2.0-14+deb12u1) 12.2.0
#
# C host: torque_motor, step of 1 ms             us   ratio
# by hand                                     0.361    1.00
# native                                      0.430    1.19
#
# C host: torque_motor, step of 0.1 ms           us   ratio
# by hand                                     0.041    1.00
# native                                      0.066    1.62
#
# fmpy: torque_motor, step of 1 ms               us   ratio
# by hand                                     5.398    1.00
# native                                      5.506    1.02
# Python FMU                                 29.850    5.53
#
# torque_motor: 1000 instances, 10 000 steps       us  kB each  growth kB
# by hand                                     0.353      0.2          0
# native                                      0.434     10.2          0
#
# simulation: torque_motor, steps of 1 ms        us   ratio
# native in the C host                        0.425    1.00
# numba                                       0.567    1.33
# MuJoCo's servo                              2.371    5.58
#
# C host: sg90, step of 1 ms                     us   ratio
# by hand                                     0.048    1.00
# native                                      0.079    1.67
#
# fmpy: sg90, step of 1 ms                       us   ratio
# by hand                                     5.769    1.00
# native                                      5.860    1.02
# Python FMU                                 13.759    2.39
#
# sg90: 1000 instances, 10 000 steps             us  kB each  growth kB
# by hand                                     0.047      0.4          0
# native                                      0.080     10.6          0
#
# simulation: sg90, steps of 1 ms                us   ratio
# native in the C host                        0.087    1.00
# numba                                       0.095    1.08
# MuJoCo's servo                              2.357   26.97
#
# The steps in the C host with the compiler of the extra ``native``, zig 0.17.1:
#
# C host: torque_motor, step of 1 ms             us   ratio
# by hand                                     0.392    1.00
# native                                      0.434    1.11
# C host: torque_motor, step of 0.1 ms           us   ratio
# by hand                                     0.055    1.00
# native                                      0.070    1.28
# C host: sg90, step of 1 ms                     us   ratio
# by hand                                     0.045    1.00
# native                                      0.086    1.90
